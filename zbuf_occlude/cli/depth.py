"""Command `depth`: the depth buffer of one mesh, as an image or an array."""

from collections.abc import Callable
from pathlib import Path
from typing import IO

import click
import numpy as np

from zbuf_occlude import Mesh, Views, load_mesh
from zbuf_occlude.base import atomic
from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.base.errors import MeshError
from zbuf_occlude.base.limits import Limits
from zbuf_occlude.cli.file_frames import print_frame
from zbuf_occlude.cli.shared_options import MeshPlace, camera_options, frame_options, suffix_of
from zbuf_occlude.cli.shell import Command, echo

PIXELS = click.IntRange(1, 8192)


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
    black. The image is square. A camera of --cameras has its picture in the middle, and background above and below or
    beside it.

    \b
    Example:
      zbuf-occlude depth chair.off --azimuth 30 --elevation 20 --out depth.png
    """
    from zbuf_occlude.engines.gl.context import GlContext  # late: help needs no GL
    from zbuf_occlude.engines.gl.depth_pass import render_depth

    size = size or resolution
    suffix = suffix_of(out, (".png", ".npy", ".exr"))
    with Limits().watch():
        loaded = load_mesh(mesh, up=up, unit=unit)
    with GlContext.open() as gl:
        views = camera(loaded)
        depths = render_depth(gl, loaded, views, size)
        renderer = gl.renderer
    if views.fov_bounds is not None:
        depths[~in_picture(views.fov_bounds[0], size)] = np.inf
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


def in_picture(bounds: FloatArray, size: int) -> BoolArray:
    """Return which pixels (size, size) have their centre in a field of view: tangents left, right, bottom, top.

    The image is that field of view, its shorter side widened to a square.
    """
    left, right, bottom, top = bounds
    half_sides = np.array([right - left, top - bottom]) / 2.0
    offsets = np.abs((np.arange(size) + 0.5) * 2.0 / size - 1.0) * half_sides.max()
    across, along = offsets <= half_sides[0], offsets <= half_sides[1]
    return np.asarray(along[:, None] & across)


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
