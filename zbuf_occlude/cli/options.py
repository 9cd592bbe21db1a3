"""Options that several commands share: meshes, method, camera; and how key=value becomes Python."""

import ast
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from zbuf_occlude.errors import OptionError
from zbuf_occlude.visibility import METHODS, find_method

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


def method_options(default: str = "depth_buffer") -> Decorator:
    """--method and --set, passed on as `method` and `settings`."""

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        function = click.option(
            "--set",
            "settings",
            metavar="KEY=VALUE",
            multiple=True,
            help="An option of the method, e.g. --set resolution=1024; repeatable. `zbuf-occlude methods` lists them.",
        )(function)
        return click.option(
            "--method",
            type=click.Choice([method.name for method in METHODS]),
            default=default,
            show_default=True,
            help="How hidden surfaces are removed.",
        )(function)

    return decorate


def _finite(context: click.Context, parameter: click.Parameter, value: float) -> float:
    if not math.isfinite(value):
        raise click.BadParameter(f"{value} is not a finite number.")
    return value


def camera_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """--azimuth, --elevation, --distance of a single view."""
    function = click.option(
        "--distance",
        type=click.FloatRange(0, min_open=True),
        default=4.0,
        show_default=True,
        callback=_finite,
        help="From the mesh's centre, in multiples of its longest side.",
    )(function)
    function = click.option(
        "--elevation",
        type=click.FloatRange(-90, 90),
        required=True,
        callback=_finite,
        help="Degrees above the xy plane; 90 is +z.",
    )(function)
    return click.option("--azimuth", type=float, required=True, callback=_finite, help="Degrees from +x towards +y.")(
        function
    )


up_option = click.option(
    "--up",
    type=click.Choice(["z", "y"]),
    default=None,
    help="The axis that points up in the files. [default: y for glTF, else z]",
)


def parse_settings(method: str, settings: tuple[str, ...]) -> dict[str, Any]:
    """Turn ("resolution=512", "refine=none") into a dict and check it against the method's options.

    Raises
    ------
    OptionError
        Not KEY=VALUE, not an option of the method, or a value of another kind than its default.
    """
    options: dict[str, Any] = {}
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals or not key or not text:
            raise OptionError(f"--set must be given KEY=VALUE; got {setting!r}.")
        options[key.strip()] = literal(text.strip())
    find_method(method).check_options(options)
    for name, default in find_method(method).options().items():
        if not _is_like(options.get(name, default), default):
            kind = {int: "a whole number", str: "a word"}.get(type(default), "a finite number")
            raise OptionError(f"--set {name} must be {kind}, like {default}; got {options[name]!r}.")
    return options


def _is_like(value: Any, default: Any) -> bool:
    """Whether an option's value is of its default's kind; where the default is None, a number is meant."""
    if isinstance(default, (str, int)) or value is None:
        return isinstance(value, type(default)) and isinstance(value, bool) == isinstance(default, bool)
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def literal(text: str) -> Any:
    """Read a number, None, True or False as such; anything else is a string."""
    try:
        value = ast.literal_eval(text)
    except (ValueError, SyntaxError):
        return text
    return value if isinstance(value, (int, float, bool, type(None))) else text


def suffix_of(path: Path, known: tuple[str, ...]) -> str:
    """Return the suffix of an output file, or raise OptionError that says which there are."""
    suffix = path.suffix.lower()
    if suffix not in known:
        raise OptionError(f"--out must end in {', '.join(known)}; got {path.name!r}.")
    return suffix
