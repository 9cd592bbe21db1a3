"""SurfaceColors: base colour of every point on the triangles of a mesh, from corners, textures and materials."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import BoolArray, FloatArray, IntArray, as_number
from zbuf_occlude.base.errors import ArgumentError

Bytes = NDArray[np.uint8]

REPEAT, CLAMP, MIRROR = "repeat", "clamp", "mirror"
"""Wrap modes of a texture beyond its edges."""

GREY = 102
"""Red, green and blue of uncoloured surfaces: 0.4, as in trimesh."""


class Material(NamedTuple):
    """Base colour and texture of a triangle."""

    factor: tuple[float, float, float]  # red, green, blue in [0, 1]; multiplies the colours of corners and texture
    texture: Bytes | None = None  # (h, w, 3), sRGB; the first row is at v = 1
    wrap: tuple[str, str] = (REPEAT, REPEAT)  # along u and v
    name: str = ""
    transmittance: float = 0.0  # share of the incident light that passes through
    painted: bool = True
    scattering: float = 1.0  # factor on the albedo: the rest is mirrored away or absorbed, as by dark glass


WHITE = Material((1.0, 1.0, 1.0))
PLAIN = Material((GREY / 255, GREY / 255, GREY / 255), painted=False)
"""Material of uncoloured surfaces."""


@dataclass(frozen=True, eq=False)
class SurfaceColors:
    """Base colours of f triangles, before lighting, gloss and transparency; and the light that passes through.

    Parameters
    ----------
    materials : tuple of Material
    material_ids : (f,) int
        Index into `materials`.
    corners : (f, 3, 3) float, optional
        Red, green and blue in [0, 1] at the corners, linear in between; white by default.
    uv : (f, 3, 2) float, optional
        Texture coordinates of the corners, (0, 0) at the lower left; without them textures are ignored.
    linear : bool
        True if factors and corners are linear light, as in glTF, and not sRGB, as in all other formats.
    warnings : tuple of str
        Files that were named but could not be read, each with the reason.
    """

    materials: tuple[Material, ...]
    material_ids: IntArray
    corners: FloatArray | None = None
    uv: FloatArray | None = None
    linear: bool = False
    warnings: tuple[str, ...] = ()

    @classmethod
    def plain(cls, n_faces: int, warnings: tuple[str, ...] = ()) -> "SurfaceColors":
        """Return the colours of an uncoloured surface: grey."""
        return cls((PLAIN,), np.zeros(n_faces, np.int32), warnings=warnings)

    @property
    def is_whole(self) -> bool:
        """True if every triangle has a colour and no file was unreadable."""
        plain = [i for i, material in enumerate(self.materials) if not material.painted]
        return not self.warnings and not np.isin(self.material_ids, plain).any()

    @property
    def transmittance(self) -> FloatArray:
        """Share of the light that passes through each triangle, (f,)."""
        return np.array([material.transmittance for material in self.materials])[self.material_ids]

    @property
    def scattering(self) -> FloatArray:
        """Factor on the albedo of each triangle, (f,)."""
        return np.array([material.scattering for material in self.materials])[self.material_ids]

    def transparent(self, shares: Mapping[str, float | None]) -> "SurfaceColors":
        """Return the colours with only the materials named in `shares` transparent; names may contain ``*``.

        A share is the transmittance; None keeps that of the material's file. Raises ArgumentError for other values.
        """
        if not isinstance(shares, Mapping):
            raise ArgumentError(f"transparent must be a mapping of names to shares; got {type(shares).__name__}.")
        for name, share in shares.items():
            if not isinstance(name, str):
                raise ArgumentError(f"transparent must name materials by str; got {name!r:.40}.")
            if share is not None:
                what = f"the share of light that {name} lets pass"
                as_number(share, what, "a number in 0..1", lambda number: 0.0 <= number <= 1.0)
        found = []
        for material in self.materials:
            mine = [share for name, share in shares.items() if fnmatchcase(material.name, name)]
            share = mine[-1] if mine else 0.0
            found.append(material if share is None else material._replace(transmittance=share))
        return replace(self, materials=tuple(found))

    def select(self, which: BoolArray | NDArray[np.intp]) -> "SurfaceColors":
        """Return the colours of the triangles that a mask or indices select."""
        corners, uv = (None if each is None else each[which] for each in (self.corners, self.uv))
        return SurfaceColors(self.materials, self.material_ids[which], corners, uv, self.linear, self.warnings)

    @cached_property
    def digest(self) -> bytes:
        """Return a digest of these colours."""
        found = hashlib.sha256(repr([m._replace(texture=None) for m in self.materials]).encode())
        for array in (self.material_ids, self.corners, self.uv, *(m.texture for m in self.materials)):
            found.update(b"" if array is None else np.ascontiguousarray(array).tobytes())
        return found.digest()

    def at(self, face_ids: IntArray, weights: FloatArray) -> Bytes:
        """Return the colours of points on triangles.

        Parameters
        ----------
        face_ids : (n,) int
        weights : (n, 3) float
            Barycentric coordinates.

        Returns
        -------
        (n, 3) uint8
            sRGB. A texture gives the texel that contains the point, without interpolation across seams.
        """
        found = np.empty((len(face_ids), 3))
        owners = self.material_ids[face_ids]
        for owner in np.unique(owners):
            material, mine = self.materials[owner], np.flatnonzero(owners == owner)
            of_texture = np.ones(3)
            if material.texture is not None and self.uv is not None:
                uv = np.einsum("nc,nca->na", weights[mine], self.uv[face_ids[mine]])
                of_texture = _texels(material, uv) / 255.0
                if self.linear:
                    of_texture = _decoded(of_texture)
            found[mine] = of_texture * np.array(material.factor)
        if self.corners is not None:
            found *= np.einsum("nc,nca->na", weights, self.corners[face_ids])
        if self.linear:
            found = _encoded(found)
        return np.round(np.clip(found, 0.0, 1.0) * 255.0).astype(np.uint8)


def of_trimesh(mesh: Any) -> SurfaceColors:
    """Return the colours of a ``trimesh.Trimesh``: of its vertices or faces, or texture and uv; else grey."""
    n_faces = len(mesh.faces)
    visual: Any = getattr(mesh, "visual", None)
    kind, ids = getattr(visual, "kind", None), np.zeros(n_faces, np.int32)
    if kind == "vertex":
        return SurfaceColors((WHITE,), ids, np.asarray(visual.vertex_colors)[mesh.faces][:, :, :3] / 255.0)
    if kind == "face":
        return SurfaceColors((WHITE,), ids, np.repeat(np.asarray(visual.face_colors)[:, None, :3] / 255.0, 3, axis=1))
    if kind != "texture":
        return SurfaceColors.plain(n_faces)
    image = getattr(visual.material, "image", None) or getattr(visual.material, "baseColorTexture", None)
    if image is None or visual.uv is None:
        red, green, blue = (float(each) / 255.0 for each in visual.material.main_color[:3])
        return SurfaceColors((Material((red, green, blue)),), ids)
    material = Material((1.0, 1.0, 1.0), np.asarray(image.convert("RGB")))
    return SurfaceColors((material,), ids, uv=np.asarray(visual.uv, dtype=np.float64)[mesh.faces])


def barycentric(corners: FloatArray, positions: FloatArray) -> FloatArray:
    """Return the barycentric coordinates (n, 3) of positions (n, 3) on triangles of corners (n, 3, 3), none below 0."""
    u, v, w = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], positions - corners[:, 0]
    uu, uv, vv, wu, wv = (np.einsum("na,na->n", *each) for each in ((u, u), (u, v), (v, v), (w, u), (w, v)))
    area = uu * vv - uv * uv
    safe = np.where(area > 0.0, area, 1.0)
    second, third = np.clip((vv * wu - uv * wv) / safe, 0.0, 1.0), np.clip((uu * wv - uv * wu) / safe, 0.0, 1.0)
    weights = np.stack([np.maximum(1.0 - second - third, 0.0), second, third], axis=1)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def _texels(material: Material, uv: FloatArray) -> Bytes:
    """Return the texels (n, 3) that contain points (n, 2) of a texture."""
    assert material.texture is not None
    height, width = material.texture.shape[:2]
    usable = np.where(np.isfinite(uv), uv, 0.0)
    column = _along(usable[:, 0], width, material.wrap[0])
    row = _along(1.0 - usable[:, 1], height, material.wrap[1])
    return np.asarray(material.texture[row, column])


def _along(coordinates: FloatArray, size: int, wrap: str) -> NDArray[np.intp]:
    if wrap == REPEAT:
        coordinates = coordinates - np.floor(coordinates)
    elif wrap == MIRROR:
        coordinates = 1.0 - np.abs(coordinates - 2.0 * np.floor(coordinates / 2.0) - 1.0)
    return np.clip(np.floor(coordinates * size), 0, size - 1).astype(np.intp)


def luminance(colors: Bytes) -> FloatArray:
    """Return the luminance (n,) of sRGB colours (n, 3), by the weights of ITU-R BT.709."""
    return _decoded(colors / 255.0) @ np.array([0.2126, 0.7152, 0.0722])


def _decoded(srgb: FloatArray) -> FloatArray:
    """Return linear light of sRGB (IEC 61966-2-1)."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def _encoded(light: FloatArray) -> FloatArray:
    """Return sRGB of linear light; the inverse of `_decoded`."""
    light = np.clip(light, 0.0, 1.0)
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)
