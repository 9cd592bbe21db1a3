"""What cameras have of one mesh: `zbuf-occlude visible`, a cloud; `depth`, a depth buffer; `views`, their list."""

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, Any

import click
import numpy as np
from numpy.typing import NDArray

from zbuf_occlude import Mesh, SurfacePoints, Views, load_mesh, prepare, sample_surface, visible_mesh
from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.cli.file_frames import say_frame
from zbuf_occlude.cli.shared_options import (
    VIEWS,
    MeshPlace,
    Settings,
    camera_options,
    chosen_method,
    distance_option,
    explicitly_set,
    frame_options,
    method_options,
    parse_settings,
    suffix_of,
    with_option,
)
from zbuf_occlude.cli.shell import Command, echo, on
from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.plan import ATTRIBUTES
from zbuf_occlude.dataset.point_files import write_csv, write_ply
from zbuf_occlude.errors import check_choice
from zbuf_occlude.geometry.cloud import columns_of
from zbuf_occlude.geometry.far_faces import far_faces
from zbuf_occlude.geometry.mesh import box_around
from zbuf_occlude.limits import Limits
from zbuf_occlude.meshes.load import load_cloud
from zbuf_occlude.views import for_mesh
from zbuf_occlude.visibility import find_method
from zbuf_occlude.visibility.interface import cure_of
from zbuf_occlude.visible_surface import Coverage
from zbuf_occlude.visible_surface import coverage as measure_coverage

PIXELS = click.IntRange(1, 8192)
MESHES = (".obj", ".off")
"""Endings of `--out` that hold faces."""


def scans_now(context: click.Context, parameter: click.Parameter, value: Any) -> None:
    """Refuse an option that scan has."""
    if value:
        raise click.UsageError(f"{parameter.opts[0]} is of `zbuf-occlude scan`, which takes --unit of the file.")


@click.command(cls=Command)
@click.argument("mesh", type=MeshPlace())
@camera_options
@method_options()
@click.option("--sensor", hidden=True, expose_value=False, callback=scans_now)
@click.option("--set-sensor", hidden=True, expose_value=False, callback=scans_now)
@click.option("--points", type=click.IntRange(1), default=50_000, help="Points sampled.")
@click.option("--seed", type=click.IntRange(0), default=0, help="Of all random draws.")
@with_option("Attributes of the points: normals towards the camera, base colours.")
@click.option("--union", is_flag=True, help="What any of the cameras of --cameras sees.")
@frame_options
@click.option(
    "--out", type=click.Path(path_type=Path), required=True, help="cloud.ply, .npy, .csv, or partial.obj, .off"
)
@click.pass_context
def visible_command(
    context: click.Context,
    /,
    mesh: Path,
    camera: Callable[[Mesh], Views],
    method: str,
    settings: Settings,
    points: int,
    seed: int,
    attributes: list[str],
    union: bool,
    up: str | None,
    unit: str | None,
    out: Path,
) -> None:
    """Write the occluded cloud that one camera sees of MESH, in the mesh's own coordinates.

    PLY holds positions and normals (turned towards the camera); .npy and .csv hold positions. With --method
    hidden_point_removal MESH may be a point cloud (PLY without faces, .npy or .csv); its own points are then asked.
    OBJ and OFF hold the visible part of the mesh, cut exactly along the edges of the shadows.
    `zbuf-occlude scan` has the points of a LiDAR or depth camera.

    \b
    Examples:
      zbuf-occlude visible chair.off --azimuth 30 --elevation 20 --out cloud.ply
      zbuf-occlude visible chair.off --azimuth 30 --elevation 20 --out partial.obj
      zbuf-occlude visible chair.off --cameras rig.json --union --out seen.ply
      zbuf-occlude visible chair.glb --with colors --azimuth 30 --elevation 20 --out cloud.ply
      zbuf-occlude visible scan.ply --method hidden_point_removal --azimuth 30 --elevation 20 --out cloud.ply
    """
    as_mesh = suffix_of(out, (".ply", ".npy", ".csv", *MESHES)) in MESHES
    for name in attributes:
        check_choice("attribute", name, ATTRIBUTES)
    if as_mesh:
        write_part(context, mesh, camera, (up, unit), out)
        return
    choice = chosen_method(context, method, settings)
    method = choice.method
    options = parse_settings(method, settings)
    positions = None if find_method(method).needs_faces else load_cloud(mesh)
    asked: Mesh | SurfacePoints
    if positions is not None:
        if idle := explicitly_set(context, ("points", "seed", "up", "unit", "attributes")):
            raise click.UsageError(f"{', '.join(idle)} must go with a mesh; {mesh} is a point cloud. Leave it out.")
        box, asked = box_around(positions), SurfacePoints.free(positions)
        samples = asked
    else:
        with Limits().watch():
            asked = box = load_mesh(mesh, up=up, unit=unit, colors="colors" in attributes)
        samples = sample_surface(asked, n_points=points, seed=seed)
    view = camera(box)
    eyes = view.eyes
    warn_inside(box, eyes)
    if positions is None and "contact" not in options:
        warn_of_far_faces(box)
    with prepare(asked, method, **options) as occluder:
        occluder.warns = False
        seen = occluder.visible(samples, eyes) & view.in_frustum(samples.positions)
        renderer = occluder.renderer
    cloud, by = samples.select(seen.any(axis=0)), eyes[seen.argmax(axis=0)[seen.any(axis=0)]]
    normals = cloud.normals_towards(by) if positions is None else None
    _write_cloud(out, cloud.positions, normals, cloud.colors, attributes)
    if isinstance(asked, Mesh) and asked.colors is not None and not asked.colors.is_whole:
        lacking = "; ".join(asked.colors.lacking) or "has no colours, or not for all faces; there points are grey"
        echo(f"warning: {mesh} {lacking}", err=True)
    why = f", because {choice.reason}" if choice.reason else ""
    if not len(cloud):
        echo("warning: the camera sees no point. Raise --fov or --points, or turn it by --look-at.", err=True)
    n_cameras = f" to any of {len(eyes)} cameras" if union else ""
    echo(f"{len(cloud)} of {len(samples)} points visible{n_cameras}, by {method}{on(renderer)}: {out}{why}")
    if isinstance(asked, Mesh):
        say_frame(mesh, asked, up, unit)


def write_part(
    context: click.Context,
    path: Path,
    camera: Callable[[Mesh], Views],
    frame: tuple[str | None, str | None],
    out: Path,
) -> None:
    """Write the part of a mesh that a camera sees, as a mesh; `frame` has its axis and unit."""
    if idle := explicitly_set(context, ("points", "seed", "attributes", "fov", "settings")):
        raise click.UsageError(f"{', '.join(idle)} must go with a cloud; {out} is a mesh. Leave it out.")
    if explicitly_set(context, ("method",)) and context.params["method"] != "exact":
        raise click.UsageError(f"--method must be exact, by which a mesh is cut; got {context.params['method']}.")
    with Limits().watch(), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # eyes inside the box: said below
        mesh = load_mesh(path, up=frame[0], unit=frame[1])
        views = camera(mesh)
        warn_inside(mesh, views.eyes)
        warn_of_far_faces(mesh)
        warn_of_lenses(views)
        part = visible_mesh(mesh, views.eyes)
    text = part.mesh.to_trimesh().export(file_type=out.suffix[1:].lower(), digits=17)  # small meshes: small numbers
    atomic.write(out, lambda file: file.write(text.encode()))
    share = part.mesh.areas.sum() / mesh.areas.sum()
    echo(f"{share:.1%} of the surface visible, {len(part.mesh.faces)} faces: {out}")
    say_frame(path, mesh, *frame)


def warn_of_lenses(views: Views) -> None:
    """Warn where cameras have a lens, which meshes and coverage leave out."""
    if views.fov_bounds is not None:
        echo("warning: only where cameras stand counts here, not where they look or their field of view.", err=True)


def warn_inside(mesh: Mesh, eyes: FloatArray) -> None:
    """Warn of a camera inside the bounding box."""
    if mesh.in_box(eyes).any():
        cure = "Raise --distance, or place the cameras of --cameras in its unit."
        echo(f"warning: the camera is inside the mesh's bounding box. {cure}", err=True)


def warn_of_far_faces(mesh: Mesh) -> None:
    """Warn of faces so far away that the contact tolerance is large for all others."""
    if far := far_faces(mesh):
        echo(f"warning: {far.said(mesh)}. {cure_of(far, mesh)}", err=True)


def _write_cloud(
    out: Path,
    positions: FloatArray,
    normals: FloatArray | None,
    colors: NDArray[np.uint8] | None,
    attributes: Sequence[str],
) -> None:
    """Write a cloud as its file's ending says."""
    if out.suffix.lower() == ".ply":
        write_ply(out, positions, normals, colors)
        return
    normals, colors = normals if "normals" in attributes else None, colors if "colors" in attributes else None
    if out.suffix.lower() == ".npy":
        table = np.concatenate([positions, *(each for each in (normals, colors) if each is not None)], axis=1)
        atomic.write(out, lambda file: np.save(file, table))
    else:
        write_csv(out, columns_of(positions, normals, colors))


@click.command(cls=Command)
@click.argument("mesh", type=MeshPlace())
@camera_options
@click.option("--resolution", type=PIXELS, default=512, help="Pixels along a side.")
@click.option("--size", type=PIXELS, hidden=True)  # its name before; elsewhere it is metres
@frame_options
@click.option("--out", type=click.Path(path_type=Path), required=True, help="depth.png, .npy or .exr")
def depth_command(
    mesh: Path,
    camera: Callable[[Mesh], Views],
    resolution: int,
    size: int | None,
    up: str | None,
    unit: str | None,
    out: Path,
) -> None:
    """Write the depth buffer that one camera has of MESH.

    .npy and .exr (channel Z) hold eye depth, the distance along the camera's axis in the mesh's own units, infinite
    where nothing is; the first row is the highest. .png is to look at: 16 bits, the nearest white, the farthest dark
    grey, nothing black.

    \b
    Example:
      zbuf-occlude depth chair.off --azimuth 30 --elevation 20 --out depth.png
    """
    from zbuf_occlude.gl.context import GlContext  # late: nothing touches GL before it must
    from zbuf_occlude.gl.depth_pass import render_depth

    size = size or resolution
    suffix = suffix_of(out, (".png", ".npy", ".exr"))
    with Limits().watch():
        loaded = load_mesh(mesh, up=up, unit=unit)
    with GlContext.open() as gl:
        depths = render_depth(gl, loaded, camera(loaded), size)
        renderer = gl.renderer
    if suffix == ".npy":
        atomic.write(out, lambda file: np.save(file, depths.astype(np.float32)))
    else:
        (write_png if suffix == ".png" else write_exr)(out, depths)
    seen = np.isfinite(depths)
    span = f"eye depth {depths[seen].min():.6g} to {depths[seen].max():.6g}" if seen.any() else "no pixel hits it"
    echo(f"{seen.mean():.1%} of {size} x {size} pixels show the mesh, {span}, on {renderer}: {out}")
    say_frame(mesh, loaded, up, unit)


def write_png(path: Path, depths: FloatArray) -> None:
    """Write 16-bit grey: near is white, far dark grey, nothing black."""
    from PIL import Image

    seen = np.isfinite(depths)
    grey = np.zeros(depths.shape, dtype=np.uint16)
    if seen.any():
        near, far = depths[seen].min(), depths[seen].max()
        grey[seen] = 65535 - 50000 * ((depths[seen] - near) / max(far - near, np.finfo(np.float64).tiny))
    atomic.write(path, lambda file: Image.fromarray(grey).save(file, format="PNG"))


def write_exr(path: Path, depths: FloatArray) -> None:
    """Write one float channel, Z, as compositing programs expect depth."""
    import OpenEXR

    header, wanted = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, depths.astype(np.float32)

    def fill(file: IO[bytes]) -> None:
        try:
            with OpenEXR.File(header, {"Z": wanted}) as picture:
                picture.write(file.name)
            with OpenEXR.File(file.name) as picture:  # what the disk had no room for when it was closed goes unsaid
                whole = np.array_equal(picture.channels()["Z"].pixels, wanted)
        except RuntimeError:
            whole = False
        if not whole:
            raise OSError  # without a number, as NumPy's

    atomic.write(path, fill)


@click.command(cls=Command)
@click.argument("mesh", type=MeshPlace())
@click.option("--views", default="paper100", help=VIEWS)
@distance_option
@click.option("--coverage", is_flag=True, help="Measure how much of the surface the views see.")
@click.option("--points", type=click.IntRange(1), default=20_000, help="Points sampled.")
@click.option("--seed", type=click.IntRange(0), default=0, help="Of all random draws.")
@frame_options
@click.option("--out", type=click.Path(path_type=Path), help="views.csv, or coverage.png: a picture of the shares.")
def views_command(
    mesh: Path,
    views: str,
    distance: tuple[float, float | None],
    coverage: bool,
    points: int,
    seed: int,
    up: str | None,
    unit: str | None,
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
        loaded = load_mesh(mesh, up=up, unit=unit)
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
    say_frame(mesh, loaded, up, unit)  # the views' own sum stays last
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
    atomic.write(path, lambda file: figure.savefig(file, format="png", dpi=120))
