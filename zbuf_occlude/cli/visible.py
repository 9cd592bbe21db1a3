"""Command `visible`: the cloud, or the part of the surface, that a camera sees of one mesh."""

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from zbuf_occlude import Mesh, SurfacePoints, Views, load_mesh, prepare, sample_surface, visible_mesh
from zbuf_occlude.base import atomic
from zbuf_occlude.base.arrays import FloatArray, float32_fault
from zbuf_occlude.base.errors import MeshError, check_choice
from zbuf_occlude.base.limits import Limits
from zbuf_occlude.base.point_files import columns_of, write_csv, write_ply
from zbuf_occlude.cli.file_frames import print_frame
from zbuf_occlude.cli.shared_options import (
    MeshPlace,
    Settings,
    camera_options,
    chosen_method,
    explicitly_set,
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
from zbuf_occlude.meshes.load import load_cloud
from zbuf_occlude.visibility import find_method, precompile
from zbuf_occlude.visibility.interface import contact_advice

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
    if kind == "stl" and (reason := float32_fault(part.mesh.vertices)):
        echo(f"warning: {out.name} has float32; its {reason}. .obj and .off have float64.", err=True)
    data = part.mesh.to_trimesh().export(file_type=kind, **digits)
    atomic.write(out, lambda file: file.write(data.encode() if isinstance(data, str) else data))
    share = part.mesh.areas.sum() / mesh.areas.sum()
    echo(f"{share:.1%} of the surface visible, {len(part.mesh.faces)} faces: {out}")
    print_frame(path, mesh, *frame)


def warn_of_missing_colors(path: Path, mesh: Mesh) -> None:
    """Warn where colours were read and some faces have none."""
    if mesh.colors is not None and not mesh.colors.is_whole:
        reason = "; ".join(mesh.colors.warnings) or "has no colours for some faces; points there are grey"
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
