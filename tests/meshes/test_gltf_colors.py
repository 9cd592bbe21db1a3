"""Base colours of glTF: textures and how they wrap and turn, factors, vertices; against closed forms."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.meshes.test_colors import SQUARE, TEXELS, encoded, png, sampled, texel_at
from zbuf_occlude import load_mesh
from zbuf_occlude.errors import MeshError


def write_gltf(path: Path, material: dict, *, colors: np.ndarray | None = None, extra: dict | None = None) -> Path:
    """The square, its texture's v pointing down as the standard has it."""
    uv = np.c_[SQUARE[:, 0], 1 - SQUARE[:, 1]].astype("<f4")
    parts = [SQUARE.astype("<f4"), uv, np.array([0, 1, 2, 0, 2, 3], "<u2")]
    accessors = [("VEC3", 5126, 4), ("VEC2", 5126, 4), ("SCALAR", 5123, 6)]
    attributes = {"POSITION": 0, "TEXCOORD_0": 1}
    if colors is not None:
        parts.append(colors)
        accessors.append((f"VEC{colors.shape[1]}", {"f": 5126, "u": 5123}[colors.dtype.kind], 4))
        attributes["COLOR_0"] = 3
    ends = np.cumsum([part.nbytes for part in parts])
    document = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0}, {"mesh": 0, "translation": [0, 0, 5]}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 2, "material": 0}]}],
        "materials": [material],
        "textures": [{"source": 0, "sampler": 0}],
        "samplers": [{}],
        "images": [{"uri": "texture.png"}],
        "accessors": [
            {"type": t, "componentType": c, "count": n, "bufferView": i, "normalized": c == 5123 and t != "SCALAR"}
            for i, (t, c, n) in enumerate(accessors)
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": int(end - part.nbytes), "byteLength": part.nbytes}
            for end, part in zip(ends, parts, strict=True)
        ],
        "buffers": [{"uri": "data.bin", "byteLength": int(ends[-1])}],
        **(extra or {}),
    }
    path.write_text(json.dumps(document))
    path.with_name("data.bin").write_bytes(b"".join(part.tobytes() for part in parts))
    path.with_name("texture.png").write_bytes(png(TEXELS))
    return path


def square_uv(points) -> np.ndarray:
    """Where points lie on the square; y of glTF points up, so here it is z."""
    return points.positions[:, [0, 2]]


def test_textures_of_gltf_are_shown_as_they_are(tmp_path: Path) -> None:
    material = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    mesh, points = sampled(write_gltf(tmp_path / "a.gltf", material))
    assert len(mesh.faces) == 4  # shown twice
    np.testing.assert_array_equal(points.colors, texel_at(square_uv(points)))


def test_factors_and_colours_of_gltf_are_linear_light(tmp_path: Path) -> None:
    """As the standard says: the texture is decoded, multiplied by factor and COLOR_0, and encoded again."""
    colors = np.array([[0.5, 1, 0, 1]] * 4, "<f4")
    material = {"pbrMetallicRoughness": {"baseColorFactor": [1, 0.25, 1, 1]}}
    _, points = sampled(write_gltf(tmp_path / "a.gltf", material, colors=colors))
    np.testing.assert_allclose(points.colors, np.tile(encoded(np.array([0.5, 0.25, 0.0])), (len(points), 1)), atol=0.51)
    material = {"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1], "baseColorTexture": {"index": 0}}}
    _, points = sampled(write_gltf(tmp_path / "b.gltf", material))
    texels = texel_at(square_uv(points)) / 255
    light = np.where(texels <= 0.04045, texels / 12.92, ((texels + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(points.colors, encoded(light / 2), atol=0.51)


@pytest.mark.filterwarnings("error")
def test_factors_of_gltf_that_are_no_numbers_are_black_without_a_warning(tmp_path: Path) -> None:
    material = {"pbrMetallicRoughness": {"baseColorFactor": [float("nan"), 1, 1, 1]}}
    _, points = sampled(write_gltf(tmp_path / "a.gltf", material))
    assert np.unique(points.colors, axis=0).tolist() == [[0, 255, 255]]


def test_normalized_colours_of_gltf(tmp_path: Path) -> None:
    colors = (SQUARE * 65535).astype("<u2")
    _, points = sampled(write_gltf(tmp_path / "a.gltf", {}, colors=colors))
    uv = square_uv(points)
    np.testing.assert_allclose(points.colors, encoded(np.c_[uv, 0 * uv[:, :1]]), atol=0.6)


@pytest.mark.parametrize(
    ("sampler", "turn", "moved"),
    [
        ({"wrapS": 33071, "wrapT": 33648}, {"scale": [2, 2]}, lambda u, v: (np.minimum(2 * u, 1), 1 - abs(1 - 2 * v))),
        ({}, {"offset": [0.5, 0.25]}, lambda u, v: ((u + 0.5) % 1, (v + 0.25) % 1)),
        # a quarter turn against the clock, v pointing down: (1, 0) goes to (0, -1)
        ({}, {"rotation": np.pi / 2}, lambda u, v: (v % 1, -u % 1)),
    ],
)
def test_textures_of_gltf_wrap_and_turn(tmp_path: Path, sampler: dict, turn: dict, moved) -> None:
    texture = {"index": 0, "extensions": {"KHR_texture_transform": turn}}
    material = {"pbrMetallicRoughness": {"baseColorTexture": texture}}
    _, points = sampled(write_gltf(tmp_path / "a.gltf", material, extra={"samplers": [sampler]}))
    uv = square_uv(points)
    u, v = moved(uv[:, 0], 1 - uv[:, 1])
    same = (points.colors == texel_at(np.c_[u, 1 - v])).all(axis=1)
    assert same.mean() > 0.995  # rounding at the edges of texels


def test_materials_of_old_gltf_have_a_diffuse_texture(tmp_path: Path) -> None:
    old = {"KHR_materials_pbrSpecularGlossiness": {"diffuseTexture": {"index": 0}}}
    _, points = sampled(write_gltf(tmp_path / "a.gltf", {"extensions": old}))
    np.testing.assert_array_equal(points.colors, texel_at(square_uv(points)))


def test_a_texture_of_gltf_that_is_missing_is_lacking(tmp_path: Path) -> None:
    path = write_gltf(tmp_path / "a.gltf", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
    (tmp_path / "texture.png").unlink()
    mesh, points = sampled(path)
    assert (points.colors == 255).all()
    assert not mesh.colors.is_whole
    assert "texture.png" in mesh.colors.lacking[0]


def test_a_texture_of_gltf_that_is_no_base64_is_lacking(tmp_path: Path) -> None:
    image = {"images": [{"uri": "data:image/png;base64,!"}]}
    material = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "baseColorFactor": [0, 1, 0, 1]}}
    mesh, points = sampled(write_gltf(tmp_path / "a.gltf", material, extra=image))
    assert np.unique(points.colors, axis=0).tolist() == [[0, 255, 0]]
    assert "must be base64" in mesh.colors.lacking[0]


def test_colours_of_gltf_that_are_of_other_vertices_are_refused(tmp_path: Path) -> None:
    path = write_gltf(tmp_path / "a.gltf", {}, colors=np.ones((4, 3), "<f4"))
    document = json.loads(path.read_text())
    document["accessors"][3]["count"] = 3
    path.write_text(json.dumps(document))
    with pytest.raises(MeshError, match="of the 4 vertices of their primitive; they are of 3 and 4"):
        load_mesh(path, colors=True)
    assert len(load_mesh(path).faces) == 4
