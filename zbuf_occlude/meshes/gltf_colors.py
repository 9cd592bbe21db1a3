"""Colours of glTF: COLOR_0, baseColorFactor and baseColorTexture of the primitives that a scene shows."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.errors import MeshError
from zbuf_occlude.geometry.colors import CLAMP, MIRROR, REPEAT, WHITE, Bytes, Material
from zbuf_occlude.meshes.gltf_data import Count, Data, Json, whole
from zbuf_occlude.meshes.looks import Look, Read, Textures, read_named
from zbuf_occlude.meshes.polygons import Ints

_WRAPS = {10497: REPEAT, 33071: CLAMP, 33648: MIRROR}


class Run(NamedTuple):
    """A primitive as a scene shows it: this many copies of its vertices, then as many of its triangles."""

    primitive: Json
    n_copies: int
    n_vertices: int
    n_triangles: int


def read_gltf_look(
    document: Json, data: Data, runs: list[Run], corners: Ints, folder: Path, read: Read, count: Count
) -> Look:
    """Read the colours of a scene's triangles.

    Parameters
    ----------
    document, data
        Of the file.
    runs : list of Run
        What is shown, in order.
    corners : (3 f,) int
        Index of each corner of the triangles into the vertices of all runs, end to end.
    folder, read
        As in `obj_colors.read_obj_look`.
    count : callable
        As in `Data`.

    Returns
    -------
    Look
        Linear light, as the standard has it; a primitive without a material is white. What was compressed by Draco has
        its materials' factors alone. A texture that cannot be read (Basis Universal, a missing file) is lacking, and
        its material's factor is what is left.
    """
    textures, materials = Textures(), [WHITE]
    numbers: dict[Any, int] = {None: 0}
    colors, uvs, ids = [np.empty((0, 3))], [np.empty((0, 2))], [np.empty(0, np.int64)]
    for run in runs:
        material_id = run.primitive.get("material")
        material = {} if material_id is None else document["materials"][whole(material_id)]
        texture, factor = _base_color(material)
        if material_id not in numbers:
            numbers[material_id] = len(materials)
            image, wrap = _image(document, data, texture, textures, folder, read)
            materials.append(Material(factor, image, wrap))
        is_packed = "KHR_draco_mesh_compression" in run.primitive.get("extensions", {})
        attributes = {} if is_packed else run.primitive["attributes"]
        own: FloatArray = np.ones((run.n_vertices, 3))
        if "COLOR_0" in attributes:
            own = data.floats(attributes["COLOR_0"], "COLOR_0", count)[:, :3]
        uv: FloatArray = np.full((run.n_vertices, 2), np.nan)
        if texture is not None:
            turn = texture.get("extensions", {}).get("KHR_texture_transform", {})
            name = f"TEXCOORD_{whole(turn.get('texCoord', texture.get('texCoord', 0)))}"
            if name in attributes:
                uv = _transformed(data.floats(attributes[name], "TEXCOORD", count), turn)
        if not len(own) == len(uv) == run.n_vertices:
            raise MeshError(
                f"COLOR_0 and TEXCOORD of glTF must be of the {run.n_vertices} vertices of their primitive; they are "
                f"of {len(own)} and {len(uv)}. Is the file damaged?"
            )
        colors.append(np.tile(own, (run.n_copies, 1)))
        uvs.append(np.tile(uv, (run.n_copies, 1)))
        ids.append(np.full(run.n_copies * run.n_triangles, numbers[material_id]))
    materials, number_of = _without_coordinates(materials, np.concatenate(ids), np.concatenate(uvs)[corners])
    return Look(
        tuple(materials),
        number_of,
        np.clip(np.nan_to_num(np.concatenate(colors)[corners]), 0.0, 1.0),
        np.nan_to_num(np.concatenate(uvs)[corners]),
        linear=True,
        lacking=tuple(textures.lacking),
    )


def _without_coordinates(materials: list[Material], ids: Ints, uv: FloatArray) -> tuple[list[Material], Ints]:
    """Give triangles without texture coordinates their material without its texture."""
    bare = ~np.isfinite(uv).reshape(len(ids), 6).all(axis=1)
    ids = np.where(bare, ids + len(materials), ids)
    return materials + [Material(material.factor) for material in materials], ids


def _base_color(material: Json) -> tuple[Json | None, tuple[float, float, float]]:
    """Return a material's texture of base colours, if it has one, and its factor."""
    old = material.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness")
    found = material.get("pbrMetallicRoughness")
    if found is None and old is not None:
        texture, factor = old.get("diffuseTexture"), old.get("diffuseFactor", WHITE.factor)
    else:
        texture = (found or {}).get("baseColorTexture")
        factor = (found or {}).get("baseColorFactor", WHITE.factor)
    red, green, blue = np.clip(np.nan_to_num([float(each) for each in factor[:3]]), 0.0, 1.0).tolist()
    return texture, (red, green, blue)


def _image(
    document: Json, data: Data, texture: Json | None, textures: Textures, folder: Path, read: Read
) -> tuple[Bytes | None, tuple[str, str]]:
    """Return the image of a texture and how it is wrapped."""
    if texture is None:
        return None, (REPEAT, REPEAT)
    row = document["textures"][whole(texture["index"])]
    source = row.get("extensions", {}).get("EXT_texture_webp", {}).get("source", row.get("source"))
    sampler = document["samplers"][whole(row["sampler"])] if "sampler" in row else {}
    wrap = tuple(_WRAPS.get(sampler.get(name, 10497), REPEAT) for name in ("wrapS", "wrapT"))
    if source is None:
        textures.lacking["a texture of an extension that is not read"] = None
        return None, (wrap[0], wrap[1])
    image = document["images"][whole(source)]
    content: Callable[[], bytes] = lambda: data.file(image, lambda name: read_named(name, folder, read))  # noqa: E731
    uri = str(image.get("uri", f"image {source}"))
    return textures.get(uri if not uri.startswith("data:") else f"image {source}", content), (wrap[0], wrap[1])


def _transformed(uv: FloatArray, turn: Json) -> FloatArray:
    """Move texture coordinates (n, 2) as KHR_texture_transform says; then v upwards, as everywhere here."""
    angle = float(turn.get("rotation", 0.0))
    with np.errstate(all="ignore"):  # what is no number then is no place in the texture
        scaled = uv * np.array(turn.get("scale", (1.0, 1.0)), dtype=np.float64)
        c, s = math.cos(angle), math.sin(angle)
        turned = scaled @ np.array([[c, -s], [s, c]]) + np.array(turn.get("offset", (0.0, 0.0)), dtype=np.float64)
    return np.stack([turned[:, 0], 1.0 - turned[:, 1]], axis=1)
