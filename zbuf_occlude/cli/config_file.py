"""Options of a command from a file: `--config FILE`, written by hand in YAML, or the manifest of a dataset."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import click

from zbuf_occlude.base.documents import parse_document, read_limited
from zbuf_occlude.base.errors import OptionError, did_you_mean
from zbuf_occlude.cli.scan_options import OF_SCANS, SCAN_OPTIONS
from zbuf_occlude.cli.shell import Command, echo
from zbuf_occlude.sensors.scan_config import SURFACE

CONFIG, MESHES = "config", "meshes"
"""Name of the option with the file, and of the argument."""
COMMAND = "zbuf_occlude.command"
"""Key of `click.Context.meta` with the options of a command, by name, as they were typed or read."""
OF_A_RUN = frozenset(
    {"out", "overwrite", "retry-failed", "dry-run", "shard", "require-gpu", "help"}
    | {"engine", "workers", "ray-address", "ray-gpus", "mesh-seconds", "mesh-gigabytes"}
)
"""Options that decide how and where a dataset is made, not what it is: a manifest has none of them."""
REPLACED = {
    "points": ("density",),
    "density": ("points",),
    MESHES: ("shapes",),
    "shapes": (MESHES, "up", "unit"),
    "unit": ("size",),
    "size": ("unit",),
    "method": ("set", "complete"),
    "complete": ("method", "set", *(name.replace("_", "-") for name in OF_SCANS)),
    **{name.replace("_", "-"): ("complete",) for name in OF_SCANS},
    "sensor": ("set-sensor", "set", "points", "density"),
    "frame": ("axes",),
    "format": ("overlap",),
}
"""Options of a file that another value of a typed option replaces: they exclude it, or belong to the file's value."""


class ConfigurableCommand(Command):
    """Command with an option `--config`; typed options override those in its file."""

    def parse_args(self, context: click.Context, args: list[str]) -> list[str]:
        """Parse the arguments, with the options of the file before them."""
        named = {_name_of(parameter): parameter for parameter in self.get_params(context)}
        typed, _, _ = self.make_parser(context).parse_args(args=list(args))
        given = {
            name: typed[parameter.name]
            for name, parameter in named.items()
            if isinstance(typed.get(str(parameter.name)), str | list | tuple | bool) and typed[parameter.name] != ()
        }
        if CONFIG in given:
            path = Path(given.pop(CONFIG))
            read = read_options(path, named)
            if idle := sorted(_replaced(read, given, named)):
                echo(f"{path}: {', '.join(idle)} left out, for typed options replace it", err=True)
            given = {**{name: value for name, value in read.items() if name not in idle}, **given}
            args = list(_arguments(given, named))
        context.meta[COMMAND] = {name: value for name, value in given.items() if name not in OF_A_RUN}
        return super().parse_args(context, args)


def _name_of(parameter: click.Parameter) -> str:
    """Return the name of an option as it is typed, without leading dashes; or the name of an argument."""
    return parameter.opts[0].lstrip("-") if isinstance(parameter, click.Option) else str(parameter.name)


config_option = click.option(
    "--config",
    expose_value=False,
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Options from a YAML file, or of a dataset by its manifest.json; those that are typed override them. "
    "Of several files the last counts.",
)


def read_options(path: Path, named: Mapping[str, click.Parameter]) -> dict[str, Any]:
    """Return the options in a file, by the names of the command's parameters.

    Raises OptionError where the file cannot be read, or has a name that is not an option of the command.
    """
    found = parse_document("JSON" if path.suffix.lower() == ".json" else "YAML", read_limited(path), path)
    if isinstance(found, Mapping) and "fingerprint" in found:
        found = found.get("command")
        if not found:
            raise OptionError(f"{path} must have the command that made its dataset; it has none. Type the options.")
    if not isinstance(found, Mapping):
        raise OptionError(f"{path} must hold options by name, such as `views: paper100`; it holds {found!r:.40}.")
    for name, value in found.items():
        if name == CONFIG:
            raise OptionError(f"{path}: a file of options cannot name another one; got {CONFIG}. Leave it out.")
        if name not in named:
            meant = did_you_mean(str(name).strip("-").replace("_", "-"), named)
            raise OptionError(f"{path}: an option must be one of `generate --help`; got {name!r:.40}.{meant}")
        if value is None or str(value).lower() in ("", "~", "null"):
            raise OptionError(f"{path}: {name} must have a value; it has none. Give one, or leave the option out.")
    return dict(found)


def _replaced(read: Mapping[str, Any], typed: Mapping[str, Any], named: Mapping[str, click.Parameter]) -> set[str]:
    """Return the options of a file that typed options replace (`REPLACED`), without those that are typed too."""
    names = {
        name
        for option, value in typed.items()
        if str(read.get(option)) != str(value)
        for name in REPLACED.get(option, ())
    }
    if typed.get("sensor") == SURFACE:
        names |= {name for name, each in named.items() if each.name in (*SCAN_OPTIONS[1:], "least_points")}
    return (names & read.keys()) - typed.keys()


def _arguments(options: Mapping[str, Any], named: Mapping[str, click.Parameter]) -> Iterator[str]:
    """Yield the arguments of a command line with these options."""
    for name, value in options.items():
        parameter = named[name]
        if not isinstance(parameter, click.Option):
            continue
        if not parameter.is_flag:
            for each in _values(parameter, value):
                yield from (parameter.opts[0], str(each))
        elif str(value).lower() not in ("true", "false"):
            raise OptionError(f"{name} must be true or false; got {value!r:.40}.")
        elif str(value).lower() == "true":
            yield parameter.opts[0]
    meshes = options.get(MESHES) or ()
    yield from ("--", *map(str, [meshes] if isinstance(meshes, str) else meshes))


def _values(parameter: click.Parameter, value: Any) -> list[Any]:
    """Return the values of an option: several where it is repeatable; a mapping is KEY=VALUE."""
    if isinstance(value, Mapping):
        value = [f"{key}={each}" for key, each in value.items()]
    if isinstance(value, list | tuple):
        return list(value) if parameter.multiple else [",".join(map(str, value))]
    return [value]
