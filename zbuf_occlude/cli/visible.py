"""`zbuf-occlude visible`: the occluded cloud that one camera sees of one mesh."""

from pathlib import Path

import click
import numpy as np

from zbuf_occlude import Views, load_mesh, prepare, sample_surface
from zbuf_occlude.cli.options import camera_options, method_options, parse_settings, suffix_of, up_option
from zbuf_occlude.dataset.ply import write_ply


@click.command()
@click.argument("mesh", type=click.Path(path_type=Path))
@camera_options
@method_options()
@click.option("--points", type=click.IntRange(1), default=50_000, show_default=True, help="Sampled before HSR.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
@up_option
@click.option("--out", type=click.Path(path_type=Path), required=True, help="cloud.ply, .npy or .csv")
def command(
    mesh: Path,
    azimuth: float,
    elevation: float,
    distance: float,
    method: str,
    settings: tuple[str, ...],
    points: int,
    seed: int,
    up: str | None,
    out: Path,
) -> None:
    """Write the occluded cloud that one camera sees of MESH, in the mesh's own coordinates.

    PLY holds positions and normals (turned towards the camera); .npy and .csv hold (n, 3) positions.

    \b
    Example:
      zbuf-occlude visible chair.off --azimuth 30 --elevation 20 --out cloud.ply
    """
    suffix = suffix_of(out, (".ply", ".npy", ".csv"))
    options = parse_settings(method, settings)
    view = Views(np.radians([azimuth]), np.radians([elevation]), np.array([distance]))
    loaded = load_mesh(mesh, up=up)
    eyes = view.around(loaded.centre, loaded.longest_side).eyes
    samples = sample_surface(loaded, n_points=points, seed=seed)
    with prepare(loaded, method, **options) as occluder:
        cloud = samples.select(occluder.visible(samples, eyes)[0])
        renderer = occluder.renderer
    if suffix == ".npy":
        np.save(out, cloud.positions)
    elif suffix == ".csv":
        np.savetxt(out, cloud.positions, delimiter=",", header="x,y,z", comments="", fmt="%.9g")
    else:
        away = (cloud.normals * (eyes[0] - cloud.positions)).sum(axis=1, keepdims=True) < 0
        write_ply(out, cloud.positions, np.where(away, -cloud.normals, cloud.normals))
    click.echo(f"{len(cloud)} of {len(samples)} points visible, by {method} on {renderer}: {out}")
