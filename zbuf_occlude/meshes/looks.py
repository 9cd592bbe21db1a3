"""Looks: base colours of the polygons of a file, as its reader found them; textures, decoded once each."""

import os
import warnings
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.errors import MeshError
from zbuf_occlude.geometry.colors import Bytes, Material, SurfaceColors
from zbuf_occlude.meshes.archives import in_any_case
from zbuf_occlude.meshes.polygons import Ints

MOST_TEXELS = 2**27
"""Of all textures of a mesh, 400 megabytes; below what Pillow refuses by itself."""

Read = Callable[[Path], bytes]
_FORMATS = ("PNG", "JPEG", "WEBP", "BMP", "TGA", "GIF", "TIFF")


class Look(NamedTuple):
    """Base colours of polygons.

    Parameters
    ----------
    materials : tuple of Material
    material_ids : (p,) int
        Of each polygon of the file.
    colors : (c, 3) float, optional
        At each corner of the polygons, end to end.
    uv : (c, 2) float, optional
    linear : bool
    lacking : tuple of str
        As in `SurfaceColors`.
    """

    materials: tuple[Material, ...]
    material_ids: Ints
    colors: FloatArray | None = None
    uv: FloatArray | None = None
    linear: bool = False
    lacking: tuple[str, ...] = ()

    def on(self, triangle_corners: Ints, polygon_ids: Ints) -> SurfaceColors:
        """Return the colours of triangles (f, 3) of corners, each a part of a polygon (f,)."""
        colors, uv = (None if each is None else each[triangle_corners] for each in (self.colors, self.uv))
        ids = self.material_ids[polygon_ids].astype(np.int32)
        return SurfaceColors(self.materials, ids, colors, uv, self.linear, self.lacking)


class Textures:
    """The textures of one mesh: each decoded once, and in words what could not be."""

    def __init__(self) -> None:
        self.lacking: dict[str, None] = {}  # in the order in which they were met
        self._found: dict[str, Bytes | None] = {}
        self._n_texels = 0

    def get(self, name: str, content: Callable[[], bytes]) -> Bytes | None:
        """Return the texture of a name, (h, w, 3) uint8; None where it is lacking."""
        if name not in self._found:
            self._found[name] = None
            try:
                self._found[name] = self._decoded(content())
            except MeshError as error:
                self.lacking[f"texture {name[:80]}: {error}"] = None
        return self._found[name]

    def _decoded(self, content: bytes) -> Bytes:
        from PIL import Image  # late: Pillow is an extra

        try:
            with warnings.catch_warnings():
                warnings.simplefilter(
                    "ignore"
                )  # of Pillow's limit, ours is lower; of transparency, which does not count
                return self._pixels(Image.open(BytesIO(content), formats=_FORMATS))
        except (MeshError, MemoryError):
            raise
        except Exception as error:  # what a library does on damaged bytes is not ours to list
            said = " ".join(f"{type(error).__name__}: {error}".split())[:80]
            raise MeshError(f"it must be an image; Pillow cannot read it ({said}).") from None

    def _pixels(self, image: Any) -> Bytes:
        self._n_texels += image.width * image.height
        if self._n_texels > MOST_TEXELS:
            raise MeshError(f"the textures of a mesh must have at most {MOST_TEXELS:,} texels; it has more.")
        if image.mode.startswith("I"):  # 16 bits, which Pillow would cut off at 255
            levels = (np.asarray(image).astype(np.int64) >> 8).astype(np.uint8)
        elif image.mode == "F":
            levels = np.round(255.0 * in_unit_range(np.asarray(image))).astype(np.uint8)
        else:
            return np.asarray(image.convert("RGB"))
        return np.repeat(levels[:, :, None], 3, axis=2)


def in_unit_range(colors: Any) -> FloatArray:
    """Return red, green and blue as numbers in [0, 1], what is none as 0.

    Those that hold more than 2, which neither rounding nor most lights make of 1, are taken to count to 255.
    """
    found = np.nan_to_num(np.asarray(colors, dtype=np.float64), posinf=1.0, neginf=0.0)
    return np.clip(found / 255.0 if (found > 2.0).any() else found, 0.0, 1.0)


def read_named(name: str, folder: Path, read: Read) -> bytes:
    """Return the content of a file that a mesh file names: where it says, or else of that name in its own folder.

    Names that differ in case alone do where there is none of the very name: they were one on the disk they come from.

    Raises
    ------
    MeshError
        Neither is there. What lies outside the folder above the mesh's own is not looked at.
    """
    relative = name.replace("\\", "/").strip().strip('"')
    root = Path(os.path.normpath(folder.parent))
    stated = Path(os.path.normpath(folder / relative))
    places = [stated] * stated.is_relative_to(root) + [folder / os.path.basename(relative)]
    for place in places:
        try:
            return read(place)
        except MeshError as error:
            reason = error
        if (other := in_any_case(place, root)) is not None:
            return read(other)
    raise MeshError(f"{name[:80]!r}: {reason}") from None
