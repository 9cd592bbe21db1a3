"""`zbuf-occlude views`: where the cameras of a view set stand about a mesh, and how much of its surface they see."""

import warnings
from pathlib import Path

import click
import numpy as np

from zbuf_occlude import load_mesh
from zbuf_occlude.cli.one_view import warn_inside, warn_of_lenses
from zbuf_occlude.cli.panels import Command
from zbuf_occlude.cli.shared_options import VIEWS, MeshPlace, distance_option, suffix_of, up_option
from zbuf_occlude.cli.shell import echo
from zbuf_occlude.dataset import atomic
from zbuf_occlude.limits import Limits
from zbuf_occlude.views import for_mesh
from zbuf_occlude.visible_surface import Coverage
from zbuf_occlude.visible_surface import coverage as measure_coverage


@click.command(cls=Command)
@click.argument("mesh", type=MeshPlace())
@click.option("--views", default="paper100", help=VIEWS)
@distance_option
@click.option("--coverage", is_flag=True, help="Measure how much of the surface the views see.")
@click.option("--points", type=click.IntRange(1), default=20_000, help="Points sampled.")
@click.option("--seed", type=click.IntRange(0), default=0, help="Of all random draws.")
@up_option
@click.option("--out", type=click.Path(path_type=Path), help="views.csv, or coverage.png: a picture of the shares.")
def views_command(
    mesh: Path,
    views: str,
    distance: tuple[float, float | None],
    coverage: bool,
    points: int,
    seed: int,
    up: str | None,
    out: Path | None,
) -> None:
    """List the views of MESH, and with --coverage how much of the surface each sees.

    "together" is the share that this view and those above it see: the coverage of a rig. The method is exact; the error
    is that of the sampling, at most 0.4 % of the surface for 20,000 points.

    \b
    Examples:
      zbuf-occlude views chair.off --views ring:8@30 --coverage
      zbuf-occlude views chair.off --views paper100 --coverage --out coverage.png
    """
    suffix = None if out is None else suffix_of(out, (".csv", ".png"))
    if suffix == ".png" and not coverage:
        raise click.UsageError("--out .png is a picture of the coverage; give --coverage.")
    with Limits().watch():
        loaded = load_mesh(mesh, up=up)
    about = for_mesh(loaded, views, distance=distance[0], farthest=distance[1], seed=seed)
    if suffix == ".csv" and (about.rotations is not None or np.any(about.roll)):
        raise click.UsageError("--out .csv holds views that look at the mesh, upright; these are turned. Use --views.")
    columns = {"azimuth": np.degrees(about.azimuth), "elevation": np.degrees(about.elevation)}
    columns["distance"] = about.distance / loaded.longest_side
    warn_inside(loaded, about.eyes)
    if coverage:
        warn_of_lenses(about)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # eyes inside the box: said above
            found = measure_coverage(loaded, about.eyes, n_points=points, seed=seed)
        columns |= {"alone": found.alone, "together": found.together}
    table = np.stack(list(columns.values()), axis=1)
    if out is not None and suffix == ".csv":
        names = ",".join(columns)
        atomic.write(out, lambda file: np.savetxt(file, table, "%.9g", ",", header=names, comments=""))
    elif out is not None:
        draw_coverage(out, found)
    else:
        echo(f"{'view':>4} " + " ".join(f"{name:>9}" for name in columns))
        for number, row in enumerate(table):
            echo(f"{number:4} " + " ".join(f"{value:9.4g}" for value in row))
    seen = f", {found.together[-1]:.1%} of the surface seen by any" if coverage else ""
    echo(f"{len(about)} views{seen}" + (f": {out}" if out else ""))


def draw_coverage(path: Path, found: Coverage) -> None:
    """Write a PNG: of each view the share of the surface that it sees, and that it and those before it see."""
    from zbuf_occlude.drawing.pictures import COLOUR, canvas

    figure, (axes,) = canvas(8.0, 4.2)
    number = np.arange(len(found.alone))
    axes.bar(number, 100 * found.alone, color="#b8c4ce", label="this view alone")
    axes.plot(number, 100 * found.together, color=COLOUR, marker="o", markersize=4, label="with those before it")
    axes.set_ylim(0, 103)
    axes.set_xlabel("view", fontsize=10)
    axes.set_ylabel("surface seen, %", fontsize=10)
    axes.legend(fontsize=9, frameon=False, loc="upper left", bbox_to_anchor=(0.0, 1.12), ncols=2)
    figure.savefig(path, format="png", dpi=120)
