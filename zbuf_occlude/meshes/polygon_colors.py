"""Base colours of the polygons of a file, as its reader found them; textures, decoded once each."""

import warnings
from collections.abc import Callable
from io import BytesIO
from typing import Any, NamedTuple

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import MeshError
from zbuf_occlude.geometry.colors import Bytes, Material, SurfaceColors
from zbuf_occlude.meshes.polygons import Ints

MAX_TEXELS = 2**27
"""Maximum texels of all textures of a mesh: 400 MB, below Pillow's own limit."""

_FORMATS = ("PNG", "JPEG", "WEBP", "BMP", "TGA", "GIF", "TIFF")


class PolygonColors(NamedTuple):
    """Base colours of the p polygons of a file with c corners in all; the fields are those of `SurfaceColors`."""

    materials: tuple[Material, ...]
    material_ids: Ints  # (p,)
    corners: FloatArray | None = None  # (c, 3)
    uv: FloatArray | None = None  # (c, 2)
    linear: bool = False
    warnings: tuple[str, ...] = ()

    def of_triangles(self, triangle_corners: Ints, polygon_ids: Ints) -> SurfaceColors:
        """Return the colours of triangles, given their corners (f, 3) and their polygons (f,)."""
        corners, uv = (None if each is None else each[triangle_corners] for each in (self.corners, self.uv))
        ids = self.material_ids[polygon_ids].astype(np.int32)
        return SurfaceColors(self.materials, ids, corners, uv, self.linear, self.warnings)


class Textures:
    """The textures of one mesh, each decoded once, and a warning for each that cannot be decoded."""

    def __init__(self) -> None:
        self.warnings: dict[str, None] = {}  # an ordered set
        self._found: dict[str, Bytes | None] = {}
        self._n_texels = 0

    def get(self, name: str, content: Callable[[], bytes]) -> Bytes | None:
        """Return the texture of a name, (h, w, 3) uint8; None where it cannot be decoded."""
        if name not in self._found:
            self._found[name] = None
            try:
                self._found[name] = self._decoded(content())
            except MeshError as error:
                self.warnings[f"texture {name[:80]}: {error}"] = None
        return self._found[name]

    def _decoded(self, content: bytes) -> Bytes:
        from PIL import Image  # late: Pillow is an extra

        try:
            with warnings.catch_warnings():
                # about Pillow's limit, which is above ours, and about transparency, which is not used
                warnings.simplefilter("ignore")
                return self._pixels(Image.open(BytesIO(content), formats=_FORMATS))
        except (MeshError, MemoryError):
            raise
        except Exception as error:  # Pillow raises any error on damaged bytes
            cause = " ".join(f"{type(error).__name__}: {error}".split())[:80]
            raise MeshError(f"it must be an image; Pillow cannot read it ({cause}).") from None

    def _pixels(self, image: Any) -> Bytes:
        self._n_texels += image.width * image.height
        if self._n_texels > MAX_TEXELS:
            raise MeshError(f"the textures of a mesh must have at most {MAX_TEXELS:,} texels; it has more.")
        if image.mode.startswith("I"):  # 16 bits, which Pillow would clip at 255
            levels = (np.asarray(image).astype(np.int64) >> 8).astype(np.uint8)
        elif image.mode == "F":
            levels = np.round(255.0 * in_unit_range(np.asarray(image))).astype(np.uint8)
        else:
            return np.asarray(image.convert("RGB"))
        return np.repeat(levels[:, :, None], 3, axis=2)


def in_unit_range(colors: Any) -> FloatArray:
    """Return red, green and blue as numbers in [0, 1]; NaN becomes 0.

    Values above 2 mean that the colours range to 255: rounding and most lights do not exceed 2.
    """
    found = np.nan_to_num(np.asarray(colors, dtype=np.float64), posinf=1.0, neginf=0.0)
    return np.clip(found / 255.0 if (found > 2.0).any() else found, 0.0, 1.0)
