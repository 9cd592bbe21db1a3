"""`zbuf-occlude depth`: the depth buffer of one view, as a picture or as numbers."""

from collections.abc import Callable
from pathlib import Path

import click
import numpy as np

from zbuf_occlude import Mesh, Views, load_mesh
from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.cli.echo import echo
from zbuf_occlude.cli.options import camera_options, suffix_of, up_option
from zbuf_occlude.dataset import atomic
from zbuf_occlude.limits import Limits


@click.command()
@click.argument("mesh", type=click.Path(path_type=Path))
@camera_options
@click.option("--size", type=click.IntRange(1, 8192), default=512, show_default=True, help="Pixels along a side.")
@up_option
@click.option("--out", type=click.Path(path_type=Path), required=True, help="depth.png, .npy or .exr")
def command(mesh: Path, camera: Callable[[Mesh], Views], size: int, up: str | None, out: Path) -> None:
    """Write the depth buffer that one camera has of MESH.

    .npy and .exr (channel Z) hold eye depth, the distance along the camera's axis in the mesh's own units, infinite
    where nothing is; the first row is the highest. .png is to look at: 16 bits, the nearest white, the farthest dark
    grey, nothing black.

    \b
    Example:
      zbuf-occlude depth chair.off --azimuth 30 --elevation 20 --out depth.png
    """
    from zbuf_occlude.gl.context import GlContext  # late: nothing touches GL before it must
    from zbuf_occlude.gl.depth_pass import depth_image

    suffix = suffix_of(out, (".png", ".npy", ".exr"))
    with Limits().watch():
        loaded = load_mesh(mesh, up=up)
    with GlContext.open() as gl:
        depths = depth_image(gl, loaded, camera(loaded), size)
        renderer = gl.renderer
    write = {".png": write_png, ".npy": write_npy, ".exr": write_exr}[suffix]
    write(out, depths)
    seen = np.isfinite(depths)
    span = f"eye depth {depths[seen].min():.6g} to {depths[seen].max():.6g}" if seen.any() else "no pixel hits it"
    echo(f"{seen.mean():.1%} of {size} x {size} pixels show the mesh, {span}, on {renderer}: {out}")


def write_png(path: Path, depths: FloatArray) -> None:
    """Write 16-bit grey: near is white, far dark grey, nothing black."""
    from PIL import Image

    seen = np.isfinite(depths)
    grey = np.zeros(depths.shape, dtype=np.uint16)
    if seen.any():
        near, far = depths[seen].min(), depths[seen].max()
        grey[seen] = 65535 - 50000 * ((depths[seen] - near) / max(far - near, np.finfo(np.float64).tiny))
    atomic.write(path, lambda file: Image.fromarray(grey).save(file, format="PNG"))


def write_npy(path: Path, depths: FloatArray) -> None:
    """Write a float32 array."""
    atomic.write(path, lambda file: np.save(file, depths.astype(np.float32)))


def write_exr(path: Path, depths: FloatArray) -> None:
    """Write one float channel, Z, as compositing programs expect depth."""
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"Z": depths.astype(np.float32)}) as file:
        file.write(str(path))
