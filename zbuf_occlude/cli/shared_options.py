"""Options shared by several commands (meshes, method, camera, engine), and the parsing of their values."""

import ast
import functools
import math
import os
from collections.abc import Callable, Collection
from functools import partial
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from zbuf_occlude.base.cores import n_cores
from zbuf_occlude.base.errors import MeshError, OptionError, UnavailableError, find_row
from zbuf_occlude.base.extras import missing
from zbuf_occlude.base.limits import Limits
from zbuf_occlude.cli.shell import Decorator, Name, all_of, echo
from zbuf_occlude.datasets.auto import AUTO, Choice, by_default, remark_on_renderer
from zbuf_occlude.datasets.workers import Run, from_environment, parse_shard
from zbuf_occlude.datasets.workers.local import run_local
from zbuf_occlude.datasets.workers.ray import run_ray
from zbuf_occlude.geometry.camera import FIELDS_OF_VIEW, field_of_view
from zbuf_occlude.geometry.mesh import UNITS, Mesh
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.meshes.shapes.built_in import BUILT_IN
from zbuf_occlude.views import Views, from_angles
from zbuf_occlude.views import parse as parse_views
from zbuf_occlude.visibility import METHODS, find_method

VIEWS = "Camera positions: paper100, ring:N@EL, grid:ELxAZ, random:N, drive:N (as in traffic), ..., a file."

AUTO_ELSEWHERE = f"{AUTO!r} is for `generate` only. Name a method here"


class MethodName(Name):
    """Name of a method; `AUTO` is refused with a hint where only `generate` takes it."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the name of the method."""
        if value == AUTO and AUTO not in self.choices:
            self.fail(f"{AUTO_ELSEWHERE}: {', '.join(self.choices)}.", param, ctx)
        return super().convert(value, param, ctx)


class MeshPlace(click.Path):
    """Path of a mesh file, a folder of meshes or an archive."""

    kind = "a file or folder"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Return the path."""
        name = os.fsdecode(super().convert(value, param, ctx))
        if not name:  # an unset shell variable must not mean the current folder
            self.fail(
                f"it must be the name of {self.kind}; it is empty. For the current folder, give a dot.", param, ctx
            )
        return Path(name)


class OutFolder(MeshPlace):
    """Path of an output folder, which need not exist."""

    kind = "a folder"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Return the path."""
        path = super().convert(value, param, ctx)
        if path.exists() and not path.is_dir():
            self.fail(f"it must be a folder; {str(path)!r} is a file. Choose another.", param, ctx)
        if path.is_symlink() and not path.exists():
            target = str(path.readlink())
            message = f"{str(path)!r} is a link to {target!r}, which does not exist. Make that folder first."
            self.fail(f"it must be a folder; {message}", param, ctx)
        above = nearest(path)
        if above != path.absolute() and not (above.is_dir() and os.access(above, os.W_OK | os.X_OK)):
            why = "it is not writable" if above.is_dir() else "that is a file"
            message = f"{str(path)!r} cannot be made in {str(above)!r}: {why}. Choose another."
            self.fail(f"it must be a folder that exists or can be made; {message}", param, ctx)
        return path


def nearest(path: Path) -> Path:
    """Return the path, absolute, or the nearest of its parents that exists."""
    return next(each for each in (path.absolute(), *path.absolute().parents) if os.path.exists(each))


class Setting(click.ParamType):  # type: ignore[type-arg]  # takes no parameter before click 8.2
    """Value KEY=VALUE of options such as --set, parsed to (key, text)."""

    name = "KEY=VALUE"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, str]:
        """Return key and text; ``--set key value`` is refused, since click would take the value for a mesh path."""
        if isinstance(value, tuple):
            return value
        key, equals, text = (part.strip() for part in str(value).partition("="))
        if not (equals and key and text):
            option = param.opts[0] if param is not None else "--set"
            hint = "" if equals else f" Write {option} {key or 'KEY'}=VALUE."
            raise OptionError(f"{option} must be given KEY=VALUE; got {value!r}.{hint}")
        return key, text


Settings = tuple[tuple[str, str], ...]


def method_options(default: str = "depth_buffer", also: tuple[str, ...] = ()) -> Decorator:
    """Return the options --method and --set (`method`, `settings`); `also` are values besides the methods' names."""
    return all_of(
        click.option(
            "--method",
            type=MethodName([*(method.name for method in METHODS), *also]),
            default=default,
            help="Method of hidden-surface removal; without OpenGL the default is exact.",
        ),
        click.option(
            "--set",
            "settings",
            type=Setting(),
            multiple=True,
            help="Option of the method (see `zbuf-occlude methods`); repeatable.",
        ),
    )


def chosen_method(context: click.Context, method: str, settings: Settings) -> Choice:
    """Return the method that was typed, or the default on this machine; a different default is reported."""
    default = context.get_parameter_source("method") is ParameterSource.DEFAULT
    choice = by_default() if default and not settings else Choice(method, "")
    if choice.reason:
        echo(f"method {choice.method}, because {choice.reason}", err=True)
    elif remark := remark_on_renderer(choice.method):
        echo(f"warning: {remark}", err=True)
    return choice


def finite(context: click.Context, parameter: click.Parameter, value: Any) -> Any:
    """Raise BadParameter for NaN or infinity in the value of an option, a number or several."""
    for number in value if isinstance(value, tuple) else (value,):
        if number is not None and not math.isfinite(number):
            raise click.BadParameter(f"{number} is not a finite number.")
    return value


def distances(text: str) -> tuple[float, float | None]:
    """Parse a distance D, or a range D0..D1 of random distances; return the nearest, and the farthest or None."""
    try:
        numbers = [float(part) for part in text.split("..")]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 2) or not all(math.isfinite(number) and number > 0 for number in numbers):
        raise click.BadParameter(f"it must be D or D0..D1, positive and finite; got {text!r}.")
    if len(numbers) == 2 and not numbers[0] < numbers[1]:
        raise click.BadParameter(f"distances must run upwards; got {text}.")
    return numbers[0], (numbers[1] if len(numbers) == 2 else None)


distance_option = click.option(
    "--distance",
    type=distances,
    default="4",
    metavar="D|D0..D1",
    help="Distance of the cameras from the centre, in longest sides; D0..D1: random per view.",
)


def angle_options(elevation_help: str) -> Decorator:
    """Return the options --azimuth and --elevation of a camera or sensor about the mesh."""
    return all_of(
        click.option("--azimuth", type=float, default=0.0, callback=finite, help="Degrees from +x towards +y."),
        click.option("--elevation", type=click.FloatRange(-90, 90), default=0.0, callback=finite, help=elevation_help),
    )


ANGLES = ("azimuth", "elevation", "distance", "roll")
"""Options of one camera: the arguments of `from_angles`."""


def camera_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of a camera, by angles or from a file, to a command.

    The command receives `camera`, a function that returns the view of a mesh in world units; with ``--union``, the
    views of all cameras of the file.
    """

    @functools.wraps(function)
    def command(cameras: str | None, index: int, look_at: Any, fov: float | None, **others: Any) -> Any:
        angles = [others.pop(name) for name in ANGLES]
        if cameras is None:
            _refuse_camera_options(("index", "union"), "with")
            view = from_angles(*angles)
        else:
            _refuse_camera_options(ANGLES, "without")
            view = _read_cameras(cameras, index, union=bool(others.get("union")))

        def camera(mesh: Mesh) -> Views:
            placed = view.around(mesh.centre, mesh.longest_side)
            return placed.looking(look_at, None if fov is None else field_of_view(fov))

        return function(camera=camera, **others)

    return all_of(
        angle_options("Degrees above the xy plane; 90 is +z."),
        click.option(
            "--distance",
            type=click.FloatRange(0, min_open=True),
            default=4.0,
            callback=finite,
            help="Distance of the camera from the centre, in longest sides.",
        ),
        click.option(
            "--roll",
            type=float,
            default=0.0,
            callback=finite,
            help="Roll in degrees; the top of the image turns right.",
        ),
        click.option(
            "--look-at",
            type=(float, float, float),
            metavar="X Y Z",
            callback=finite,
            help="Target of the camera, in the mesh's coordinates.  [default: centre]",
        ),
        click.option(
            "--fov",
            type=click.FloatRange(*FIELDS_OF_VIEW),
            callback=finite,
            help="Field of view, degrees.  [default: the whole mesh]",
        ),
        click.option("--cameras", metavar="FILE", help="File of cameras instead of angles: JSON, CSV, NeRF or COLMAP."),
        click.option("--index", type=click.IntRange(0), default=0, help="Index of the camera in --cameras, from 0."),
    )(command)


def _refuse_camera_options(names: Collection[str], how: str) -> None:
    """Raise UsageError for typed options that must go with, or without, --cameras."""
    if idle := explicitly_set(click.get_current_context(), names):
        raise click.UsageError(f"{', '.join(idle)} must go {how} --cameras.")


def _read_cameras(path: str, index: int, *, union: bool) -> Views:
    """Return the camera `index` of a file, or all of them with `union`."""
    if union and explicitly_set(click.get_current_context(), ("index",)):
        raise click.UsageError("--index selects one camera, --union all of them. Leave one out.")
    views = parse_views(path)
    if index >= len(views):
        raise OptionError(f"--index must be below the {len(views)} cameras of {path}; got {index}.")
    return views if union else views.select([index])


up_option = click.option(
    "--up",
    type=Name(["z", "y"]),
    default=None,
    help="Up axis of the files.  [default: y for glTF, ShapeNetCore, 3D-FUTURE; else z]",
)

frame_options = all_of(
    up_option,
    click.option(
        "--unit",
        type=Name(list(UNITS)),
        default=None,
        help="Unit of the files; lengths are then metres.  [default: none]",
    ),
)
"""Options --up and --unit: the frame of the files."""


def sample_size(value: str | int) -> int | None:
    """Parse a number of points, or ``all`` as None."""
    if value == "all":
        return None
    try:
        number = int(value)
    except ValueError:
        number = 0
    if number < 1:
        raise click.BadParameter(f"it must be a number of points, at least 1, or all; got {value!r}.")
    return number


def words(text: str) -> list[str]:
    """Parse words separated by commas."""
    found = [word.strip() for word in text.split(",") if word.strip()]
    if not found:
        raise click.BadParameter(f"it must be one or more words separated by commas; got {text!r}.")
    return found


def shares_of_splits(text: str) -> list[float]:
    """Parse numbers separated by commas."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise click.BadParameter(f"it must be three numbers, such as 0.8,0.1,0.1; got {text!r}.") from None


def with_option(help: str) -> Decorator:
    """Return the option --with (`attributes`): columns of points besides their positions."""
    return click.option(
        "--with",
        "attributes",
        type=words,
        callback=lambda context, parameter, words: words or [],
        metavar="normals,colors",
        help=help,
    )


choice_options = all_of(
    click.option(
        "--labels",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="CSV or JSON with class and split of each mesh; other meshes are left out.",
    ),
    click.option("--classes", type=words, metavar="NAME,...", help="Only meshes of these classes."),
    click.option("--splits", type=words, metavar="NAME,...", help="Only meshes of these splits: train, val, test."),
)
"""Options that select meshes and set their classes and splits."""


def explicitly_set(context: click.Context, names: Collection[str]) -> list[str]:
    """Return the typed names of those options that were given on the command line."""
    return [
        parameter.opts[0]
        for parameter in context.command.params
        if parameter.name in names and context.get_parameter_source(parameter.name) is ParameterSource.COMMANDLINE
    ]


def collect(
    paths: tuple[Path, ...],
    up: str | None,
    limit: int | None,
    *,
    unit: str | None = None,
    out: Path | None = None,
    choose: Callable[[MeshCollection], MeshCollection] = MeshCollection.interleaved,
    labels: Path | None = None,
    classes: list[str] | None = None,
    splits: list[str] | None = None,
    shapes: str = BUILT_IN[0].name,
    colors: bool = False,
    divide: Callable[[MeshCollection], MeshCollection] | None = None,
) -> MeshCollection:
    """Return the meshes of `paths`, or the built-in `shapes`; selected, ordered, at most `limit` of them.

    `divide` gives them splits, from which `splits` are selected.

    Files in `out` are left out: they may be clouds (PLY) of an earlier run in a folder among the meshes.
    """
    if paths:
        meshes = MeshCollection.from_paths(paths, up=up, unit=unit, labels=labels, colors=colors)
        if out is not None:
            own = Path(os.path.realpath(out))
            outside = (e for e in meshes if own not in Path(os.path.realpath(e.path or "")).parents)
            meshes = MeshCollection(outside, meshes.remarks)
        if not meshes:
            raise MeshError(f"--out must not be a folder of meshes; {out} has all that were given. Choose another.")
    else:
        meshes = find_row("shapes", shapes, BUILT_IN).collection()
        meshes = meshes if labels is None else meshes.labelled(labels)
    if divide is None:
        meshes = choose(meshes.select(classes=classes, splits=splits))
    else:  # ordered before they have splits, so that the first of them have the same shares
        meshes = divide(choose(meshes.select(classes=classes))).select(splits=splits)
    return meshes if limit is None else meshes.limit(limit)


def parse_settings(method: str, settings: Settings) -> dict[str, Any]:
    """Parse settings such as (("resolution", "512"),) into options that `Method.check_options` accepts."""
    options = {key: literal(text) for key, text in settings}
    find_method(method).check_options(options)
    return options


def literal(text: str) -> Any:
    """Parse a number, None, True or False; return any other text unchanged."""
    try:
        value = ast.literal_eval(text)
    except (ValueError, SyntaxError):
        return text
    return value if isinstance(value, (int, float, bool, type(None))) else text


def suffix_of(path: Path, known: tuple[str, ...]) -> str:
    """Return the suffix of an output file; raises OptionError for an unknown one, or where it cannot be written."""
    suffix = path.suffix.lower()
    if suffix not in known:
        raise OptionError(f"--out must end in {', '.join(known)}; got {path.name!r}.")
    check_place(path)
    return suffix


def check_place(path: Path, option: str = "--out") -> None:
    """Raise OptionError, before any work, where an output file cannot be written."""
    folder = path.parent
    if not folder.is_dir():
        raise OptionError(f"{option} must be in a folder that exists; {str(folder)!r} does not. Make it first.")
    if path.is_dir():
        raise OptionError(f"{option} must be a file; {str(path)!r} is a folder. Give a name within it.")
    if not os.access(path if path.exists() else folder, os.W_OK):
        raise OptionError(f"{option} must be writable; {str(path)!r} is not. Give another.")
    given = [each for value in click.get_current_context().params.values() for each in _each(value)]
    if path.exists() and any(each is not path and os.path.exists(each) and path.samefile(each) for each in given):
        raise OptionError(f"{option} must not be an input file; {str(path)!r} is. Give another.")


def _each(value: Any) -> list[str | Path]:
    """Return the parts of a parameter's value that may be paths."""
    return [each for each in (value if isinstance(value, tuple) else (value,)) if isinstance(each, str | Path) and each]


ENGINE = ("engine", "workers", "ray_address", "ray_gpus")
"""Names of the parameters of `engine_options`."""


engine_options = all_of(
    click.option("--workers", type=click.IntRange(1), help="Worker processes.  [default: one per core]"),
    click.option("--engine", type=Name(["local", "ray"]), default="local", help="Local processes, or a Ray cluster."),
    click.option("--ray-address", help="Address of a running cluster.  [default: RAY_ADDRESS, or a new local one]"),
    click.option(
        "--ray-gpus",
        type=click.FloatRange(0),
        default=0.0,
        help="GPUs per Ray worker; with 0.25, four workers share one.",
    ),
)
"""Options of the engine: local processes or a Ray cluster."""


def shard_option(help: str) -> Decorator:
    """Return the option --shard with its help text."""
    return click.option("--shard", metavar="I/N", callback=_parsed_shard, help=help)


def _parsed_shard(context: click.Context, parameter: click.Parameter, value: str | None) -> tuple[int, int] | None:
    return None if value is None else parse_shard(value)


def pop_engine(context: click.Context, options: dict[str, Any], limits: Limits) -> Run:
    """Remove the options of `engine_options` from a command's options and return the engine.

    Raises UsageError for options of the other engine.
    """
    engine, workers, address, gpus = (options.pop(name) for name in ENGINE)
    if engine != "ray" and (idle := explicitly_set(context, ("ray_address", "ray_gpus"))):
        raise click.UsageError(f"{', '.join(idle)} must go with --engine ray.")
    if engine == "ray":
        if lacking := missing("ray"):
            raise UnavailableError(f"--engine ray {lacking}")
        return partial(run_ray, n_workers=workers, limits=limits, address=address, gpus_per_worker=gpus)
    return partial(run_local, n_workers=workers or n_cores(), limits=limits)


def share_of(shard: tuple[int, int] | None) -> tuple[int, int]:
    """Return the share (i, n) of this machine, from --shard or from SLURM's environment."""
    return from_environment(os.environ) if shard is None else shard
