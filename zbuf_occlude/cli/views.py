"""Command `views`: the cameras of a view set about a mesh, and the coverage of its surface."""

import warnings
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from zbuf_occlude import Mesh, Views, load_mesh
from zbuf_occlude.base import atomic
from zbuf_occlude.base.errors import MeshError
from zbuf_occlude.base.limits import Limits
from zbuf_occlude.cli.file_frames import print_frame
from zbuf_occlude.cli.scan_options import parse_sensor, sensor_options
from zbuf_occlude.cli.shared_options import (
    VIEWS,
    MeshPlace,
    Settings,
    distance_option,
    explicitly_set,
    finite,
    frame_options,
    suffix_of,
)
from zbuf_occlude.cli.shell import Command, echo
from zbuf_occlude.cli.visible import warn_inside
from zbuf_occlude.meshes.load import has_metres
from zbuf_occlude.sensors import Sensor, inspection
from zbuf_occlude.sensors.inspection import Coverage
from zbuf_occlude.views import for_mesh

MAX_LABELS = 25
"""Maximum number of views that have their numbers in a plot."""


@click.command(cls=Command)
@click.argument("mesh", type=MeshPlace())
@click.option("--views", default="paper100", help=VIEWS)
@distance_option
@click.option("--coverage", is_flag=True, help="Measure the fraction of the surface that the views see.")
@click.option("--order", is_flag=True, help="Order the views: next comes the one that adds most.")
@sensor_options(None)
@click.option(
    "--min-density",
    type=click.FloatRange(0),
    default=0.0,
    callback=finite,
    help="Smallest number of the sensor's rays per square metre at which a point counts as seen.",
)
@click.option("--points", type=click.IntRange(1), default=20_000, help="Number of points sampled.")
@click.option("--seed", type=click.IntRange(0), default=0, help="Seed of all random draws.")
@frame_options
@click.option(
    "--out", type=click.Path(path_type=Path), help="Output file: views.csv, or coverage.png, a plot of the coverage."
)
@click.pass_context
def views_command(
    context: click.Context,
    /,
    mesh: Path,
    views: str,
    distance: tuple[float, float | None],
    coverage: bool,
    order: bool,
    sensor: str | None,
    set_sensor: Settings,
    camera: str | None,
    min_density: float,
    points: int,
    seed: int,
    up: str | None,
    unit: str | None,
    out: Path | None,
) -> None:
    """List the views of MESH, and with --coverage the fraction of the surface that each sees.

    "gain" is the fraction that a view sees and no view above it. "together" is the fraction that a view and those above
    it see: the coverage of a rig. With --order the best views come first: the first rows of the CSV are a rig.
    Visibility is exact; the sampling error is at most 0.4 % of the surface for 20,000 points. A --sensor sees what is
    within its field of view, range and incidence; it needs lengths in metres, of glTF or by --unit.

    \b
    Examples:
      zbuf-occlude views chair.off --views ring:8@30 --coverage
      zbuf-occlude views chair.off --views paper100 --coverage --order --out coverage.png
      zbuf-occlude views part.stl --unit mm --coverage --sensor realsense-d435 --order --out order.csv
    """
    suffix = None if out is None else suffix_of(out, (".csv", ".png"))
    check_usage(context, suffix)
    model = None if sensor is None else parse_sensor(sensor, set_sensor, camera)
    if model is not None and unit is None and not has_metres(mesh):
        raise click.UsageError("--sensor needs lengths in metres: give --unit of the file, m if it is in metres.")
    with Limits().watch():
        loaded = load_mesh(mesh, up=up, unit=unit)
    about = for_mesh(loaded, views, distance=distance[0], farthest=distance[1], seed=seed)
    if suffix == ".csv" and (about.rotations is not None or np.any(about.roll)):
        raise click.UsageError("--out .csv cannot hold cameras that are rolled or look past the mesh. Use --views.")
    warn_inside(loaded, about.eyes)
    found = None
    if coverage:
        found = measure_coverage(loaded, about, model, min_density, greedy=order, n_points=points, seed=seed)
    if out is None:
        print_views(columns_of_views(about, loaded.longest_side, found))
    elif found is not None and suffix == ".png":
        draw_coverage(out, found, about, max(n_useful(found), 1) if order else len(about))
    else:
        write_views(out, columns_of_views(about, loaded.longest_side, found), about, found)
    print_frame(mesh, loaded, up, unit)  # the sum over the views stays the last line
    seen = "" if found is None else format_coverage(found, order)
    echo(f"{len(about)} views{seen}" + (f": {out}" if out else ""))


def check_usage(context: click.Context, suffix: str | None) -> None:
    """Raise UsageError for options without those that they must go with; `suffix` is that of --out."""
    coverage, sensor = context.params["coverage"], context.params["sensor"]
    if suffix == ".png" and not coverage:
        raise click.UsageError("--out .png is a plot of the coverage; give --coverage.")
    if not coverage and (idle := explicitly_set(context, ("order", "sensor", "set_sensor", "camera", "min_density"))):
        raise click.UsageError(f"{idle[0]} must go with --coverage.")
    if sensor is None and (idle := explicitly_set(context, ("set_sensor", "camera", "min_density"))):
        raise click.UsageError(f"{idle[0]} must go with --sensor.")


def measure_coverage(mesh: Mesh, views: Views, sensor: Sensor | None, min_density: float, **options: Any) -> Coverage:
    """Return the coverage of a mesh by views, with more `options` of `sensors.inspection.coverage`.

    Raises MeshError where they see nothing.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # eyes inside the box are warned of in the command's words
        found = inspection.coverage(mesh, views, sensor=sensor, min_density=min_density, **options)
    check_seen(found, sensor, views, min_density)
    return found


def n_useful(found: Coverage) -> int:
    """Return the number of views that see what no view before them sees."""
    return int(np.count_nonzero(found.gain))


def format_coverage(found: Coverage, is_ordered: bool) -> str:
    """Return the end of the last line: the share of the surface that any view sees, and how many views suffice."""
    seen = f", {found.together[-1]:.1%} of the surface seen by any"
    return seen + (f", by the first {n_useful(found)} as by all" if is_ordered and n_useful(found) else "")


def print_views(columns: dict[str, NDArray[Any]]) -> None:
    """Print a list of views, each with its number."""
    numbers = columns.get("view", np.arange(len(columns["azimuth"])))
    others = {name: values for name, values in columns.items() if name != "view"}
    echo(f"{'view':>4} " + " ".join(f"{name:>9}" for name in others))
    for number, *row in zip(numbers, *others.values(), strict=True):
        echo(f"{number:4} " + " ".join(f"{value:9.4g}" for value in row))


def write_views(path: Path, columns: dict[str, NDArray[Any]], views: Views, found: Coverage | None) -> None:
    """Write a list of views as CSV, with the positions of the cameras beside their coverage."""
    if found is not None:  # where to put the camera, in the coordinates and unit of the mesh
        columns = columns | dict(zip("xyz", views.eyes[found.order].T, strict=True))
    digits = ["%.17g" if name in "xyz" else "%.9g" for name in columns]  # 9 digits resolve 5 mm at 1,000 km
    names, table = ",".join(columns), np.stack(list(columns.values()), axis=1)
    atomic.write(path, lambda file: np.savetxt(file, table, digits, ",", header=names, comments=""))


def columns_of_views(views: Views, longest_side: float, found: Coverage | None) -> dict[str, NDArray[Any]]:
    """Return the columns of a list of views, with their coverage in its order."""
    columns = {"azimuth": np.degrees(views.azimuth), "elevation": np.degrees(views.elevation)}
    columns["distance"] = views.distance / longest_side
    if found is None:
        return columns
    ordered: dict[str, NDArray[Any]] = {name: values[found.order] for name, values in columns.items()}
    return {"view": found.order, **ordered, "alone": found.alone, "gain": found.gain, "together": found.together}


def check_seen(found: Coverage, sensor: Sensor | None, views: Views, min_density: float) -> None:
    """Raise MeshError where views see nothing of a surface: with the limits, and what to do."""
    if found.together[-1]:
        return
    if sensor is None:
        raise MeshError("the views see nothing of the surface. Raise --distance or --points.")
    model, away = sensor.noise_model, views.distance.max()
    dense = ", or lower --min-density" if min_density else ""
    raise MeshError(
        f"{sensor.name} measures nothing of the surface. It measures at {model.range_min:g} to "
        f"{model.range_max:g} m; the farthest view is {away:.3g} m from the centre. Change --distance, or correct the "
        f"--unit of the file{dense}."
    )


def draw_coverage(path: Path, found: Coverage, views: Views, n_shown: int) -> None:
    """Plot the fraction of the surface that the first views see, alone and with those before them; write a PNG."""
    from zbuf_occlude.drawing.pictures import COLOUR, canvas

    figure, (axes,) = canvas(8.0, 4.2)
    place, rest = np.arange(n_shown), len(found.order) - n_shown
    axes.bar(place, 100 * found.alone[:n_shown], color="#d5dde3", label="this view alone")
    axes.bar(place, 100 * found.gain[:n_shown], color="#8fa3b3", label="none before it")
    together = 100 * found.together[:n_shown]
    axes.plot(place, together, color=COLOUR, marker="o", markersize=4, label="with those before it")
    axes.set_ylim(0, 103)
    some = place[:: 1 + len(place) // MAX_LABELS]
    angles = np.degrees([views.azimuth, views.elevation]).round().astype(int).T
    axes.set_xticks(some, [f"{number}\n{angles[number, 0]}°, {angles[number, 1]}°" for number in found.order[some]])
    axes.set_xlabel("view: azimuth, elevation" + (f" ({rest} others add nothing)" if rest else ""), fontsize=10)
    axes.set_ylabel("surface seen, %", fontsize=10)
    axes.legend(fontsize=9, frameon=False, loc="upper left", bbox_to_anchor=(0.0, 1.12), ncols=3)
    atomic.write(path, lambda file: figure.savefig(file, format="png", dpi=120))
