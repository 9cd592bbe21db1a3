"""Commands `visible` (cloud seen by a camera), `depth` (depth buffer) and `views` (list of cameras) of one mesh."""

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, Any

import click
import numpy as np
from numpy.typing import NDArray

from zbuf_occlude import Mesh, SurfacePoints, Views, load_mesh, prepare, sample_surface, visible_mesh
from zbuf_occlude.base import atomic
from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import MeshError, check_choice
from zbuf_occlude.base.limits import Limits
from zbuf_occlude.base.point_files import columns_of, write_csv, write_ply
from zbuf_occlude.cli.file_frames import print_frame
from zbuf_occlude.cli.scan_options import parse_sensor, sensor_options
from zbuf_occlude.cli.shared_options import (
    VIEWS,
    MeshPlace,
    Settings,
    camera_options,
    chosen_method,
    distance_option,
    explicitly_set,
    finite,
    frame_options,
    method_options,
    parse_settings,
    suffix_of,
    with_option,
)
from zbuf_occlude.cli.shell import Command, echo, on_renderer
from zbuf_occlude.datasets.plan import ATTRIBUTES
from zbuf_occlude.geometry.far_faces import far_faces
from zbuf_occlude.geometry.mesh import box_around
from zbuf_occlude.meshes.load import has_metres, load_cloud
from zbuf_occlude.sensors import Sensor
from zbuf_occlude.sensors.inspection import Coverage
from zbuf_occlude.sensors.inspection import coverage as measure_coverage
from zbuf_occlude.views import for_mesh
from zbuf_occlude.visibility import find_method, precompile
from zbuf_occlude.visibility.interface import contact_advice

PIXELS = click.IntRange(1, 8192)
MOST_LABELS = 25
"""Maximum number of views that have their numbers in a plot."""
MESHES = (".obj", ".off", ".stl")
"""Suffixes of `--out` for meshes."""


def refuse_sensor(context: click.Context, parameter: click.Parameter, value: Any) -> None:
    """Raise UsageError for an option that only `scan` has."""
    if value:
        raise click.UsageError(f"{parameter.opts[0]} is an option of `zbuf-occlude scan`.")


@click.command(cls=Command)
@click.argument("mesh", type=MeshPlace())
@camera_options
@method_options()
@click.option("--sensor", hidden=True, expose_value=False, callback=refuse_sensor)
@click.option("--set-sensor", hidden=True, expose_value=False, callback=refuse_sensor)
@click.option("--points", type=click.IntRange(1), default=50_000, help="Number of points sampled.")
@click.option("--seed", type=click.IntRange(0), default=0, help="Seed of all random draws.")
@with_option("Attributes of the points: normals (towards the camera), colors.")
@click.option("--union", is_flag=True, help="Union of what the cameras of --cameras see.")
@frame_options
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    required=True,
    help="Output file: cloud.ply, .npy, .csv, or partial.obj, .off, .stl",
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
    """Write the occluded cloud that one camera sees of MESH, in the coordinates of MESH.

    PLY holds positions and normals (towards the camera); .npy and .csv hold positions. With --method
    hidden_point_removal, MESH may be a point cloud (PLY without faces, .npy or .csv), whose points are then tested.
    OBJ, OFF and STL hold the visible part of the mesh, cut exactly along the shadow boundaries.
    `zbuf-occlude scan` writes the points of a LiDAR or depth camera.

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
    if positions is None:
        if mesh.exists():
            precompile(method, "points")
        with Limits().watch():
            loaded = load_mesh(mesh, up=up, unit=unit, colors="colors" in attributes)
        subject: Mesh | SurfacePoints = loaded
        samples = sample_surface(loaded, n_points=points, seed=seed)
    else:
        if idle := explicitly_set(context, ("points", "seed", "up", "unit", "attributes")):
            raise click.UsageError(f"{', '.join(idle)} must go with a mesh; {mesh} is a point cloud. Leave it out.")
        loaded = box_around(positions)
        subject = samples = SurfacePoints.free(positions)
    view = camera(loaded)
    warn_inside(loaded, view.eyes)
    if subject is loaded and "contact" not in options:
        warn_of_far_faces(loaded)
    with prepare(subject, method, warn=False, **options) as occluder:
        seen = occluder.visible(samples, view.eyes) & view.in_frustum(samples.positions)
        renderer = occluder.renderer
    by_any = seen.any(axis=0)
    if not by_any.any():
        raise MeshError(
            f"the camera sees none of the {len(samples):,} points of {mesh}. Raise --fov or --points, or turn it by "
            "--look-at."
        )
    cloud = samples.select(by_any)
    normals = cloud.normals_towards(view.eyes[seen.argmax(axis=0)[by_any]]) if subject is loaded else None
    _write_cloud(out, cloud.positions, normals, cloud.colors, attributes)
    if subject is loaded:
        warn_of_missing_colors(mesh, loaded)
    why = f", because {choice.reason}" if choice.reason else ""
    n_cameras = f" to any of {len(view)} cameras" if union else ""
    echo(f"{len(cloud)} of {len(samples)} points visible{n_cameras}, by {method}{on_renderer(renderer)}: {out}{why}")
    if subject is loaded:
        print_frame(mesh, loaded, up, unit)


def write_part(
    context: click.Context,
    path: Path,
    camera: Callable[[Mesh], Views],
    frame: tuple[str | None, str | None],
    out: Path,
) -> None:
    """Write the part of a mesh that a camera sees, as a mesh; `frame` is its up axis and unit."""
    if idle := explicitly_set(context, ("points", "seed", "attributes", "fov", "settings")):
        raise click.UsageError(f"{', '.join(idle)} must go with a cloud; {out} is a mesh. Leave it out.")
    if explicitly_set(context, ("method",)) and context.params["method"] != "exact":
        raise click.UsageError(f"--method must be exact to write a mesh; got {context.params['method']}.")
    with Limits().watch(), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # eyes inside the box are warned of below
        mesh = load_mesh(path, up=frame[0], unit=frame[1])
        views = camera(mesh)
        warn_inside(mesh, views.eyes)
        warn_of_far_faces(mesh)
        warn_of_lenses(views)
        part = visible_mesh(mesh, views.eyes)
    kind = out.suffix[1:].lower()
    digits = {} if kind == "stl" else {"digits": 17}  # all of a float64; STL has float32
    data = part.mesh.to_trimesh().export(file_type=kind, **digits)
    atomic.write(out, lambda file: file.write(data.encode() if isinstance(data, str) else data))
    share = part.mesh.areas.sum() / mesh.areas.sum()
    echo(f"{share:.1%} of the surface visible, {len(part.mesh.faces)} faces: {out}")
    print_frame(path, mesh, *frame)


def warn_of_missing_colors(path: Path, mesh: Mesh) -> None:
    """Warn where colours were read and some faces have none."""
    if mesh.colors is not None and not mesh.colors.is_whole:
        reason = "; ".join(mesh.colors.lacking) or "has no colours for some faces; points there are grey"
        echo(f"warning: {path} {reason}", err=True)


def warn_of_lenses(views: Views) -> None:
    """Warn that directions and fields of view of cameras are ignored."""
    if views.fov_bounds is not None:
        echo("warning: only positions of cameras count here, not their directions or fields of view.", err=True)


def warn_inside(mesh: Mesh, eyes: FloatArray) -> None:
    """Warn of cameras inside the bounding box."""
    if mesh.in_box(eyes).any():
        cure = "Raise --distance, or give the cameras of --cameras in the mesh's unit."
        echo(f"warning: the camera is inside the mesh's bounding box. {cure}", err=True)


def warn_of_far_faces(mesh: Mesh) -> None:
    """Warn of faces so far away that the contact tolerance is too large for all others."""
    if far := far_faces(mesh):
        echo(f"warning: {far.summary(mesh)}. {contact_advice(far, mesh)}", err=True)


def _write_cloud(
    out: Path,
    positions: FloatArray,
    normals: FloatArray | None,
    colors: NDArray[np.uint8] | None,
    attributes: Sequence[str],
) -> None:
    """Write a cloud in the format of the file's suffix."""
    if out.suffix.lower() == ".ply":
        write_ply(out, positions, normals, colors)
        return
    normals, colors = normals if "normals" in attributes else None, colors if "colors" in attributes else None
    if out.suffix.lower() == ".npy":
        table = np.concatenate([positions, *(column for column in (normals, colors) if column is not None)], axis=1)
        atomic.write(out, lambda file: np.save(file, table))
    else:
        write_csv(out, columns_of(positions, normals, colors))


@click.command(cls=Command)
@click.argument("mesh", type=MeshPlace())
@camera_options
@click.option("--resolution", type=PIXELS, default=512, help="Pixels along a side of the image.")
@click.option("--size", type=PIXELS, hidden=True)  # older name of --resolution
@frame_options
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Output file: depth.png, .npy or .exr")
def depth_command(
    mesh: Path,
    camera: Callable[[Mesh], Views],
    resolution: int,
    size: int | None,
    up: str | None,
    unit: str | None,
    out: Path,
) -> None:
    """Write the depth buffer of MESH as seen by one camera.

    .npy and .exr (channel Z) hold eye depth: the distance along the camera's axis in the unit of MESH, infinite in the
    background; the first row is the top. .png is for viewing: 16 bits, nearest white, farthest dark grey, background
    black.

    \b
    Example:
      zbuf-occlude depth chair.off --azimuth 30 --elevation 20 --out depth.png
    """
    from zbuf_occlude.engines.gl.context import GlContext  # late: only this command needs GL
    from zbuf_occlude.engines.gl.depth_pass import render_depth

    size = size or resolution
    suffix = suffix_of(out, (".png", ".npy", ".exr"))
    with Limits().watch():
        loaded = load_mesh(mesh, up=up, unit=unit)
    with GlContext.open() as gl:
        depths = render_depth(gl, loaded, camera(loaded), size)
        renderer = gl.renderer
    seen = np.isfinite(depths)
    if not seen.any():
        raise MeshError(
            f"no pixel of {size} x {size} shows {mesh}. Raise --fov or --resolution, or turn it by --look-at."
        )
    if suffix == ".npy":
        atomic.write(out, lambda file: np.save(file, depths.astype(np.float32)))
    else:
        (write_png if suffix == ".png" else write_exr)(out, depths)
    span = f"eye depth {depths[seen].min():.6g} to {depths[seen].max():.6g}"
    echo(f"{seen.mean():.1%} of {size} x {size} pixels show the mesh, {span}, on {renderer}: {out}")
    print_frame(mesh, loaded, up, unit)


def write_png(path: Path, depths: FloatArray) -> None:
    """Write a 16-bit grey image: near white, far dark grey, background black."""
    from PIL import Image

    seen = np.isfinite(depths)
    grey = np.zeros(depths.shape, dtype=np.uint16)
    near, far = depths[seen].min(), depths[seen].max()
    grey[seen] = 65535 - 50000 * ((depths[seen] - near) / max(far - near, np.finfo(np.float64).tiny))
    atomic.write(path, lambda file: Image.fromarray(grey).save(file, format="PNG"))


def write_exr(path: Path, depths: FloatArray) -> None:
    """Write an EXR with one float channel Z, as compositing programs expect depth."""
    import OpenEXR

    header, pixels = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, depths.astype(np.float32)

    def write_and_check(file: IO[bytes]) -> None:
        try:
            with OpenEXR.File(header, {"Z": pixels}) as picture:
                picture.write(file.name)
            with OpenEXR.File(file.name) as picture:  # OpenEXR does not report a full disk on closing
                whole = np.array_equal(picture.channels()["Z"].pixels, pixels)
        except RuntimeError:
            whole = False
        if not whole:
            raise OSError  # without errno, as NumPy raises it

    atomic.write(path, write_and_check)


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
    if suffix == ".png" and not coverage:
        raise click.UsageError("--out .png is a plot of the coverage; give --coverage.")
    if not coverage and (idle := explicitly_set(context, ("order", "sensor", "set_sensor", "camera", "min_density"))):
        raise click.UsageError(f"{idle[0]} must go with --coverage.")
    if sensor is None and (idle := explicitly_set(context, ("set_sensor", "camera", "min_density"))):
        raise click.UsageError(f"{idle[0]} must go with --sensor.")
    model = None if sensor is None else parse_sensor(sensor, set_sensor, camera)
    if model is not None and unit is None and not has_metres(mesh):
        raise click.UsageError("--sensor needs lengths in metres: give --unit of the file, m if it is in metres.")
    with Limits().watch():
        loaded = load_mesh(mesh, up=up, unit=unit)
    about = for_mesh(loaded, views, distance=distance[0], farthest=distance[1], seed=seed)
    if suffix == ".csv" and (about.rotations is not None or np.any(about.roll)):
        raise click.UsageError("--out .csv cannot hold cameras that are rolled or look past the mesh. Use --views.")
    warn_inside(loaded, about.eyes)
    found, seen = None, ""
    if coverage:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # eyes inside the box are warned of above
            found = measure_coverage(
                loaded, about, sensor=model, min_density=min_density, greedy=order, n_points=points, seed=seed
            )
        check_seen(found, model, about, min_density)
        seen = f", {found.together[-1]:.1%} of the surface seen by any"
        if order and (n_useful := np.count_nonzero(found.gain)):
            seen += f", by the first {n_useful} as by all"
    columns = columns_of_views(about, loaded.longest_side, found)
    if out is not None and found is not None and suffix == ".png":
        draw_coverage(out, found, about, max(int(np.count_nonzero(found.gain)), 1) if order else len(about))
    elif out is not None:
        if found is not None:  # where to put the camera, in the coordinates and unit of the mesh
            columns |= dict(zip("xyz", about.eyes[found.order].T, strict=True))
        digits = ["%.17g" if name in "xyz" else "%.9g" for name in columns]  # 9 digits resolve 5 mm at 1,000 km
        names, table = ",".join(columns), np.stack(list(columns.values()), axis=1)
        atomic.write(out, lambda file: np.savetxt(file, table, digits, ",", header=names, comments=""))
    else:
        numbers = columns.pop("view", np.arange(len(about)))
        echo(f"{'view':>4} " + " ".join(f"{name:>9}" for name in columns))
        for number, *row in zip(numbers, *columns.values(), strict=True):
            echo(f"{number:4} " + " ".join(f"{value:9.4g}" for value in row))
    print_frame(mesh, loaded, up, unit)  # the sum over the views stays the last line
    echo(f"{len(about)} views{seen}" + (f": {out}" if out else ""))


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
    some = place[:: 1 + len(place) // MOST_LABELS]
    angles = np.degrees([views.azimuth, views.elevation]).round().astype(int).T
    axes.set_xticks(some, [f"{number}\n{angles[number, 0]}°, {angles[number, 1]}°" for number in found.order[some]])
    axes.set_xlabel("view: azimuth, elevation" + (f" ({rest} others add nothing)" if rest else ""), fontsize=10)
    axes.set_ylabel("surface seen, %", fontsize=10)
    axes.legend(fontsize=9, frameon=False, loc="upper left", bbox_to_anchor=(0.0, 1.12), ncols=3)
    atomic.write(path, lambda file: figure.savefig(file, format="png", dpi=120))
