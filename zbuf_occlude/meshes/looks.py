"""Looks: base colours of the polygons of a file, as its reader found them; textures, decoded once each."""

import warnings
from collections.abc import Callable
from io import BytesIO
from typing import Any, NamedTuple

import numpy as np

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.errors import MeshError
from zbuf_occlude.geometry.colors import Bytes, Material, SurfaceColors
from zbuf_occlude.meshes.polygons import Ints

MOST_TEXELS = 2**27
"""Of all textures of a mesh, 400 megabytes; below what Pillow refuses by itself."""

_FORMATS = ("PNG", "JPEG", "WEBP", "BMP", "TGA", "GIF", "TIFF")


class PolygonColors(NamedTuple):
    """Base colours of the p polygons of a file, at their c corners end to end; else as `SurfaceColors`."""

    materials: tuple[Material, ...]
    material_ids: Ints  # (p,)
    colors: FloatArray | None = None  # (c, 3)
    uv: FloatArray | None = None  # (c, 2)
    linear: bool = False
    lacking: tuple[str, ...] = ()

    def on(self, triangle_corners: Ints, polygon_ids: Ints) -> SurfaceColors:
        """Return the colours of triangles (f, 3) of corners, each a part of a polygon (f,)."""
        colors, uv = (None if each is None else each[triangle_corners] for each in (self.colors, self.uv))
        ids = self.material_ids[polygon_ids].astype(np.int32)
        return SurfaceColors(self.materials, ids, colors, uv, self.linear, self.lacking)


class Textures:
    """The textures of one mesh: each decoded once, and why one could not be."""

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
                # of Pillow's limit, ours is lower; of transparency, which does not count
                warnings.simplefilter("ignore")
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
