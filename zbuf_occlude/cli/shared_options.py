"""Options that several commands share: meshes, method, camera, engine; and how key=value becomes Python."""

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

from zbuf_occlude.cli.shell import Decorator, Name, all_of, echo
from zbuf_occlude.dataset.auto import AUTO, Choice, by_default, remark_on_renderer
from zbuf_occlude.errors import MeshError, OptionError, UnavailableError, find_row
from zbuf_occlude.extras import missing
from zbuf_occlude.geometry.camera import FIELDS_OF_VIEW, field_of_view
from zbuf_occlude.geometry.mesh import UNITS, Mesh
from zbuf_occlude.limits import Limits
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.shapes.built_in import BUILT_IN
from zbuf_occlude.views import Views, from_angles
from zbuf_occlude.views import parse as parse_views
from zbuf_occlude.visibility import METHODS, find_method
from zbuf_occlude.workers import Run, from_environment, parse_shard
from zbuf_occlude.workers.local import run_local
from zbuf_occlude.workers.ray import run_ray

VIEWS = "Camera positions: paper100, ring:N@EL, grid:ELxAZ, random:N, ..., a file."

AUTO_ELSEWHERE = f"{AUTO!r} chooses for a whole dataset: it is for `generate` only. Name a method here"


class MethodName(Name):
    """A method's name; a word that only `generate` takes is refused with that hint."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the name."""
        if value == AUTO and AUTO not in self.choices:
            self.fail(f"{AUTO_ELSEWHERE}: {', '.join(self.choices)}.", param, ctx)
        return super().convert(value, param, ctx)


class MeshPlace(click.Path):
    """Path of a mesh file, a folder or an archive."""

    kind = "a file or folder"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Return the path."""
        name = os.fsdecode(super().convert(value, param, ctx))
        if not name:  # of a variable that is not set: not the current folder
            self.fail(f"it must be the name of {self.kind}; it is empty. For this folder, write a dot.", param, ctx)
        return Path(name)


class OutFolder(MeshPlace):
    """Path of a folder to write into, which need not be there."""

    kind = "a folder"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Return the path."""
        path = super().convert(value, param, ctx)
        if path.exists() and not path.is_dir():
            self.fail(f"it must be a folder; {str(path)!r} is a file. Choose another.", param, ctx)
        if path.is_symlink() and not path.exists():
            target = str(path.readlink())
            message = f"{str(path)!r} is a link to {target!r}, which is not there. Make that folder first."
            self.fail(f"it must be a folder; {message}", param, ctx)
        above = nearest(path)
        if above != path.absolute() and not (above.is_dir() and os.access(above, os.W_OK | os.X_OK)):
            why = "it may not be written in" if above.is_dir() else "that is a file"
            message = f"{str(path)!r} cannot be made in {str(above)!r}: {why}. Choose another."
            self.fail(f"it must be a folder, or one that can be made; {message}", param, ctx)
        return path


def nearest(path: Path) -> Path:
    """Return a path, absolute, or what is there of those above it."""
    return next(each for each in (path.absolute(), *path.absolute().parents) if os.path.exists(each))


class Setting(click.ParamType):  # type: ignore[type-arg]  # takes no parameter before click 8.2
    """KEY=VALUE, of --set and its like; the value is (key, text)."""

    name = "KEY=VALUE"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, str]:
        """Return key and text; refuse here what would else be taken for the name of a mesh: ``--set key value``."""
        if isinstance(value, tuple):
            return value
        key, equals, text = (part.strip() for part in str(value).partition("="))
        if not (equals and key and text):
            option = param.opts[0] if param is not None else "--set"
            hint = "" if equals else f" In one word: {option} {key or 'KEY'}=VALUE."
            raise OptionError(f"{option} must be given KEY=VALUE; got {value!r}.{hint}")
        return key, text


Settings = tuple[tuple[str, str], ...]


def method_options(default: str = "depth_buffer", also: tuple[str, ...] = ()) -> Decorator:
    """--method and --set, passed on as `method` and `settings`; `also` are words besides the methods' names."""
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
            help="Option of the method, as `zbuf-occlude methods` lists them; repeatable.",
        ),
    )


def chosen_method(context: click.Context, method: str, settings: Settings) -> Choice:
    """Return the method that a person named, or what is taken by default here; say it first if that is another one."""
    default = context.get_parameter_source("method") is ParameterSource.DEFAULT
    choice = by_default() if default and not settings else Choice(method, "")
    if choice.reason:
        echo(f"method {choice.method}, because {choice.reason}", err=True)
    elif remark := remark_on_renderer(choice.method):
        echo(f"warning: {remark}", err=True)
    return choice


def finite(context: click.Context, parameter: click.Parameter, value: Any) -> Any:
    """Refuse NaN and infinity, of an option of one number or of several."""
    for number in value if isinstance(value, tuple) else (value,):
        if number is not None and not math.isfinite(number):
            raise click.BadParameter(f"{number} is not a finite number.")
    return value


def distances(text: str) -> tuple[float, float | None]:
    """Read a distance D, or distances D0..D1 to be drawn from: the nearest, and the farthest or None."""
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
    help="Of the cameras from the centre, in longest sides; D0..D1: random for each view.",
)


def angle_options(of_elevation: str) -> Decorator:
    """--azimuth and --elevation: where a camera or sensor stands about the mesh."""
    return all_of(
        click.option("--azimuth", type=float, default=0.0, callback=finite, help="Degrees from +x towards +y."),
        click.option("--elevation", type=click.FloatRange(-90, 90), default=0.0, callback=finite, help=of_elevation),
    )


ANGLES = ("azimuth", "elevation", "distance", "roll")
"""Options of one camera, as `from_angles` takes them."""


def camera_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """One camera, by angles or out of a file; passed on as `camera`, which makes its view of a mesh, world units.

    A command that has ``--union`` is passed the views of all cameras of the file.
    """

    @functools.wraps(function)
    def command(cameras: str | None, index: int, look_at: Any, fov: float | None, **others: Any) -> Any:
        context, angles = click.get_current_context(), [others.pop(name) for name in ANGLES]
        if idle := explicitly_set(context, ("index", "union") if cameras is None else ANGLES):
            how = "with" if cameras is None else "without"
            raise click.UsageError(f"{', '.join(idle)} must go {how} --cameras.")
        union = bool(others.get("union"))
        if union and explicitly_set(context, ("index",)):
            raise click.UsageError("--index chooses one camera, --union takes all. Leave one out.")
        if cameras is not None:
            views = parse_views(cameras)
            if index >= len(views):
                raise OptionError(f"--index must be below the {len(views)} cameras of {cameras}; got {index}.")
            view = views if union else views.select([index])
        else:
            view = from_angles(*angles)

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
            help="Of the camera from the centre, in longest sides.",
        ),
        click.option("--roll", type=float, default=0.0, callback=finite, help="Degrees; the top turns to the right."),
        click.option(
            "--look-at",
            type=(float, float, float),
            metavar="X Y Z",
            callback=finite,
            help="In the mesh's coordinates.  [default: centre]",
        ),
        click.option(
            "--fov",
            type=click.FloatRange(*FIELDS_OF_VIEW),
            callback=finite,
            help="Field of view, degrees.  [default: the whole mesh is seen]",
        ),
        click.option("--cameras", metavar="FILE", help="Instead of angles: cameras as JSON or CSV, of NeRF or COLMAP."),
        click.option("--index", type=click.IntRange(0), default=0, help="Which of the cameras, from 0."),
    )(command)


up_option = click.option(
    "--up",
    type=Name(["z", "y"]),
    default=None,
    help="Up axis of the files.  [default: y for glTF, ShapeNetCore, 3D-FUTURE; else z]",
)

frame_options = all_of(
    up_option,
    click.option(
        "--unit", type=Name(list(UNITS)), default=None, help="Unit of the files, for metres.  [default: as they are]"
    ),
)
"""--up and --unit: in what frame files are; handed on as `up` and `unit`."""


def sample_size(value: str | int) -> int | None:
    """Read a number of points, or ``all``, whose value is None."""
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
    """Read words between commas."""
    found = [word.strip() for word in text.split(",") if word.strip()]
    if not found:
        raise click.BadParameter(f"it must have a word, or several between commas; got {text!r}.")
    return found


def with_option(help: str) -> Decorator:
    """--with: what points have besides their positions; handed on as `attributes`."""
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
        help="Class and split of each mesh, as CSV or JSON; others are left out.",
    ),
    click.option("--classes", type=words, metavar="NAME,...", help="Only meshes of these classes."),
    click.option("--splits", type=words, metavar="NAME,...", help="Only meshes of these splits: train, val, test."),
)
"""Which of the meshes found, and what they are of."""


def explicitly_set(context: click.Context, names: Collection[str]) -> list[str]:
    """Return which of a command's options were typed, as one types them."""
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
) -> MeshCollection:
    """Return the meshes that a person named, or `shapes` that are built in; chosen, ordered, at most `limit` of them.

    What lies in `out` is none: the clouds of a run before, in PLY, in a folder among the meshes.
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
    meshes = choose(meshes.select(classes=classes, splits=splits))
    return meshes if limit is None else meshes.limit(limit)


def parse_settings(method: str, settings: Settings) -> dict[str, Any]:
    """Turn (("resolution", "512"), ("refine", "none")) into a dict that `Method.check_options` accepts."""
    options = {key: literal(text) for key, text in settings}
    find_method(method).check_options(options)
    return options


def literal(text: str) -> Any:
    """Read a number, None, True or False as such; anything else is a string."""
    try:
        value = ast.literal_eval(text)
    except (ValueError, SyntaxError):
        return text
    return value if isinstance(value, (int, float, bool, type(None))) else text


def suffix_of(path: Path, known: tuple[str, ...]) -> str:
    """Return the suffix of an output file, or raise OptionError: an unknown one, or a place that cannot be written."""
    suffix = path.suffix.lower()
    if suffix not in known:
        raise OptionError(f"--out must end in {', '.join(known)}; got {path.name!r}.")
    check_place(path)
    return suffix


def check_place(path: Path, option: str = "--out") -> None:
    """Raise OptionError where an output file cannot be written: said before the work, not after it."""
    folder = path.parent
    if not folder.is_dir():
        raise OptionError(f"{option} must be in a folder that there is; {str(folder)!r} is none. Make it first.")
    if path.is_dir():
        raise OptionError(f"{option} must be a file; {str(path)!r} is a folder. Give a name within it.")
    if not os.access(path if path.exists() else folder, os.W_OK):
        raise OptionError(f"{option} must be a place that can be written; {str(path)!r} is not. Give another.")
    given = [each for value in click.get_current_context().params.values() for each in _each(value)]
    if path.exists() and any(each is not path and os.path.exists(each) and path.samefile(each) for each in given):
        raise OptionError(f"{option} must not be a file that is read; {str(path)!r} is. Give another.")


def _each(value: Any) -> list[str | Path]:
    """Return what of a parameter's value may be a path."""
    return [each for each in (value if isinstance(value, tuple) else (value,)) if isinstance(each, str | Path) and each]


ENGINE = ("engine", "workers", "ray_address", "ray_gpus")
"""Names of the parameters that `engine_options` adds, and `pop_engine` takes."""


engine_options = all_of(
    click.option("--workers", type=click.IntRange(1), help="Worker processes.  [default: one per core]"),
    click.option("--engine", type=Name(["local", "ray"]), default="local", help="Processes here, or a Ray cluster."),
    click.option("--ray-address", help="Address of a running cluster.  [default: RAY_ADDRESS, or a new one here]"),
    click.option(
        "--ray-gpus", type=click.FloatRange(0), default=0.0, help="GPUs of each Ray worker; with 0.25 four share one."
    ),
)
"""Who makes the work: processes here, or a Ray cluster."""


def shard_option(what: str) -> Decorator:
    """--shard; `what` says whereof."""
    return click.option("--shard", metavar="I/N", help=what)


def pop_engine(context: click.Context, options: dict[str, Any], limits: Limits) -> Run:
    """Take the options of `engine_options` out of a command's, and return the engine that they choose.

    Options of an engine that was not chosen are a UsageError.
    """
    engine, workers, address, gpus = (options.pop(name) for name in ENGINE)
    if engine != "ray" and (idle := explicitly_set(context, ("ray_address", "ray_gpus"))):
        raise click.UsageError(f"{', '.join(idle)} must go with --engine ray.")
    if engine == "ray":
        if lacking := missing("ray"):
            raise UnavailableError(f"--engine ray {lacking}")
        return partial(run_ray, n_workers=workers, limits=limits, address=address, gpus_per_worker=gpus)
    return partial(run_local, n_workers=workers or os.cpu_count() or 1, limits=limits)


def share_of(shard: str | None) -> tuple[int, int]:
    """Return this machine's share, (i, n), as it was given, or as SLURM says."""
    return parse_shard(shard) if shard is not None else from_environment(os.environ)
