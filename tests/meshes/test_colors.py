"""Base colours of OBJ, PLY and glTF: textures, materials, vertices; against closed forms and trimesh."""

import io
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from tests.gltf import Builder
from zbuf_occlude import Mesh, MeshError, load_mesh, sample_surface
from zbuf_occlude.geometry.colors import GREY

TEXELS = np.arange(4 * 8 * 3, dtype=np.uint8).reshape(4, 8, 3) * 2
"""A texture of 8 x 4 texels, no two of one colour."""
SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])

QUAD = """mtllib quad.mtl
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl painted
f 1/1 2/2 3/3 4/4
"""


def png(texels: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(texels).save(buffer, "PNG")
    return buffer.getvalue()


def texel_at(uv: np.ndarray) -> np.ndarray:
    """The texel under places (n, 2), (0, 0) the lower left corner of the picture."""
    rows, columns = np.floor((1 - uv[:, 1]) * 4), np.floor(uv[:, 0] * 8)
    return TEXELS[np.clip(rows, 0, 3).astype(int), np.clip(columns, 0, 7).astype(int)]


def write_quad(folder: Path, materials: str, *, obj: str = QUAD, texture: bytes | None = None) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "quad.obj").write_text(obj)
    (folder / "quad.mtl").write_text(materials)
    (folder / "texture.png").write_bytes(png(TEXELS) if texture is None else texture)
    return folder / "quad.obj"


def sampled(path: Path, n: int = 3_000):
    mesh = load_mesh(path, colors=True)
    return mesh, sample_surface(mesh, n_points=n, seed=1)


def encoded(light: np.ndarray) -> np.ndarray:
    """SRGB of linear light, 0..255."""
    return 255 * np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)


def test_points_of_a_textured_quad_have_the_texel_that_they_lie_on(tmp_path: Path) -> None:
    mesh, points = sampled(write_quad(tmp_path, "newmtl painted\nKd 1 1 1\nmap_Kd texture.png\n"))
    assert mesh.colors.is_whole
    assert points.colors.dtype == np.uint8
    np.testing.assert_array_equal(points.colors, texel_at(points.positions[:, :2]))
    assert len(np.unique(points.colors, axis=0)) == 32


def test_colours_are_read_only_where_they_are_asked_for(tmp_path: Path) -> None:
    path = write_quad(tmp_path, "newmtl painted\nmap_Kd texture.png\n", texture=b"no picture")
    assert load_mesh(path).colors is None
    assert sample_surface(load_mesh(path), n_points=5).colors is None
    assert len(load_mesh(path).origin.files) == 1
    assert [file.name for file in load_mesh(path, colors=True).origin.files] == ["quad.obj", "quad.mtl", "texture.png"]


@pytest.mark.parametrize(
    ("materials", "expected"),
    [
        ("newmtl painted\nKd 0.5 0.25 1\nmap_Kd texture.png\n", lambda texels: texels * [0.5, 0.25, 1.0]),
        ("newmtl painted\nKd 0 0 0\nmap_Kd texture.png\n", lambda texels: texels),
        ("newmtl painted\nKd .2 .4 .6\n", lambda texels: np.full_like(texels, [51, 102, 153])),
        ("newmtl other\nKd .2 .4 .6\n", lambda texels: np.full_like(texels, GREY)),
        ("\tnewmtl painted\n\tmap_Kd -clamp on -bm 1.0 texture.png\n", lambda texels: texels),
    ],
)
def test_a_texture_is_multiplied_by_its_materials_colour(tmp_path: Path, materials: str, expected) -> None:
    _, points = sampled(write_quad(tmp_path, materials))
    np.testing.assert_allclose(points.colors, expected(texel_at(points.positions[:, :2]).astype(float)), atol=0.51)


def test_textures_repeat_scale_and_shift(tmp_path: Path) -> None:
    _, points = sampled(write_quad(tmp_path, "newmtl painted\nmap_Kd -s 2 3 1 -o .25 -.5 0 texture.png\n"))
    uv = points.positions[:, :2] * [2, 3] + [0.25, -0.5]
    np.testing.assert_array_equal(points.colors, texel_at(uv - np.floor(uv)))


def test_negative_indices_and_polygons_that_are_not_convex(tmp_path: Path) -> None:
    """A chevron, cut by ears; its corners count back from the end of the lists."""
    corners = [(0, 0), (1, 0), (1, 1), (0.5, 0.2), (0, 1)]
    lines = ["mtllib quad.mtl", "v 9 9 9", "vt 9 9", "usemtl painted"]
    lines += [f"v {x} {y} 0" for x, y in corners] + [f"vt {x} {y}" for x, y in corners]
    lines += ["f -5/-5 -4/-4 -3/-3 -2/-2 -1/-1"]
    _, points = sampled(write_quad(tmp_path, "newmtl painted\nmap_Kd texture.png\n", obj="\n".join(lines)))
    np.testing.assert_array_equal(points.colors, texel_at(points.positions[:, :2]))


def test_a_mesh_whose_texture_is_missing_says_so_and_keeps_its_materials_colour(tmp_path: Path) -> None:
    path = write_quad(tmp_path, "newmtl painted\nKd 0 1 0\nmap_Kd gone.png\n")
    mesh, points = sampled(path)
    assert (points.colors == [0, 255, 0]).all()
    assert not mesh.colors.is_whole
    assert mesh.colors.warnings == ("texture gone.png: 'gone.png': there is no such file. Check the path.",)
    path.with_name("quad.mtl").unlink()
    mesh, points = sampled(path)
    assert (points.colors == GREY).all()
    assert "quad.mtl" in mesh.colors.warnings[0]


@pytest.mark.parametrize("texture", [b"", b"no picture", png(TEXELS)[:45]], ids=["empty", "text", "cut"])
def test_a_damaged_texture_is_lacking_and_no_error(tmp_path: Path, texture: bytes) -> None:
    mesh, points = sampled(write_quad(tmp_path, "newmtl painted\nmap_Kd texture.png\n", texture=texture))
    assert len(mesh.colors.warnings) == 1
    assert (points.colors == GREY).all()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("mode", ["transparent palette", "grey floats"])
def test_textures_of_rare_kinds(tmp_path: Path, mode: str) -> None:
    buffer, expected = io.BytesIO(), TEXELS
    if mode == "grey floats":
        expected = np.repeat(TEXELS[:, :, :1], 3, axis=2)
        Image.fromarray((expected[:, :, 0] / 255).astype(np.float32)).save(buffer, "TIFF")
    else:
        table = Image.fromarray(TEXELS).convert("P", palette=Image.Palette.ADAPTIVE)
        expected = np.asarray(table.convert("RGB"))
        table.save(buffer, "PNG", transparency=bytes(range(32)))
    _, points = sampled(write_quad(tmp_path, "newmtl painted\nmap_Kd texture.png\n", texture=buffer.getvalue()))
    uv = points.positions[:, :2]
    np.testing.assert_array_equal(points.colors, expected[3 - (4 * uv[:, 1]).astype(int), (8 * uv[:, 0]).astype(int)])


@pytest.mark.parametrize("place", ["looks", "."], ids=["beside the materials", "beside the mesh"])
def test_textures_lie_beside_their_materials_or_the_mesh(tmp_path: Path, place: str) -> None:
    """The materials' file begins with a byte order mark."""
    for folder in ("looks", "looks/pictures", "pictures"):
        (tmp_path / folder).mkdir()
    (tmp_path / "quad.obj").write_text(QUAD.replace("quad.mtl", "looks\\quad.mtl"))
    (tmp_path / "looks" / "quad.mtl").write_text("\ufeffnewmtl painted\nmap_Kd pictures\\t.png\n")
    (tmp_path / place / "pictures" / "t.png").write_bytes(png(TEXELS))
    mesh, points = sampled(tmp_path / "quad.obj")
    assert mesh.colors.is_whole
    np.testing.assert_array_equal(points.colors, texel_at(points.positions[:, :2]))


@pytest.mark.parametrize("packed", [False, True], ids=["folder", "archive"])
def test_materials_and_textures_whose_case_differs_are_found(tmp_path: Path, packed: bool) -> None:
    """As on the disk that they come from; one of the very name comes first, and nothing far is looked at."""
    files = {
        "id/models/quad.obj": QUAD.encode(),
        "id/models/QUAD.MTL": b"newmtl painted\nmap_Kd ..\\images\\T.png\n",
        "id/Images/t.PNG": png(TEXELS),
        "IMAGES/t.png": png(TEXELS[::-1]),
    }
    root = tmp_path / "all.zip" if packed else tmp_path
    if packed:
        with zipfile.ZipFile(root, "w") as archive:
            for name, content in files.items():
                archive.writestr(name, content)
    else:
        for name, content in files.items():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_bytes(content)
    mesh, points = sampled(root / "id" / "models" / "quad.obj")
    np.testing.assert_array_equal(points.colors, texel_at(points.positions[:, :2]))
    if not packed:
        assert [file.name for file in mesh.origin.files] == ["quad.obj", "QUAD.MTL", "../Images/t.PNG"]
        (root / "id" / "models" / "quad.mtl").write_text("newmtl painted\nKd 1 0 0\n")
        assert np.unique(sampled(root / "id" / "models" / "quad.obj")[1].colors, axis=0).tolist() == [[255, 0, 0]]
        (root / "id" / "models" / "quad.mtl").write_text("newmtl painted\nmap_Kd ../../images/t.png\n")
        assert sampled(root / "id" / "models" / "quad.obj")[0].colors.warnings


def test_textures_named_by_a_place_on_another_machine_are_found_by_their_name(tmp_path: Path) -> None:
    for named in ("D:\\models\\Table\\texture.png", "/home/somebody/texture.png"):
        path = write_quad(tmp_path, f"newmtl painted\nmap_Kd {named}\n")
        _, points = sampled(path)
        np.testing.assert_array_equal(points.colors, texel_at(points.positions[:, :2]))


@pytest.mark.filterwarnings("error")
def test_colours_that_are_no_numbers_are_black_without_a_warning(tmp_path: Path) -> None:
    _, points = sampled(write_quad(tmp_path / "a", "newmtl painted\nKd nan 0.2 inf\n"))
    assert np.unique(points.colors, axis=0).tolist() == [[0, 51, 255]]
    lines = [f"v {x} {y} 0 nan nan nan" for x, y, _ in SQUARE]
    (tmp_path / "b.obj").write_text("\n".join([*lines, "f 1 2 3 4"]))
    assert not sampled(tmp_path / "b.obj")[1].colors.any()


def test_a_texture_of_too_many_texels_is_not_decoded(tmp_path: Path) -> None:
    buffer = io.BytesIO()
    Image.new("1", (12_000, 12_000)).save(buffer, "PNG")
    mesh, _ = sampled(write_quad(tmp_path, "newmtl painted\nmap_Kd texture.png\n", texture=buffer.getvalue()))
    assert "at most 134,217,728 texels" in mesh.colors.warnings[0]


def test_textures_far_away_are_not_read(tmp_path: Path) -> None:
    (tmp_path / "secret.png").write_bytes(png(TEXELS))
    for named in ("../../secret.png", str(tmp_path / "secret.png")):
        path = write_quad(tmp_path / "id" / "models", f"newmtl painted\nmap_Kd {named}\n")
        assert sampled(path)[0].colors.warnings


@pytest.mark.parametrize("most", [1.0, 1.0000001, 255.0])
def test_colours_of_vertices_in_obj_are_linear_in_between(tmp_path: Path, most: float) -> None:
    lines = [f"v {x} {y} 0 {x * most} {y * most} {most}" for x, y, _ in SQUARE]
    path = tmp_path / "square.obj"
    path.write_text("\n".join([*lines, "f 1 2 3 4"]))
    _, points = sampled(path)
    expected = 255 * np.c_[points.positions[:, :2], np.ones(len(points))]
    np.testing.assert_allclose(points.colors, expected, atol=0.51)


def write_ply(path: Path, of_vertices: str, of_faces: str, rows: list[str], faces: list[str]) -> Path:
    head = ["ply", "format ascii 1.0", f"element vertex {len(rows)}", "property float x", "property float y"]
    head += ["property float z", *filter(None, of_vertices.split(";")), f"element face {len(faces)}"]
    head += ["property list uchar int vertex_indices", *filter(None, of_faces.split(";")), "end_header"]
    path.write_text("\n".join([*head, *rows, *faces, ""]))
    return path


CHANNELS = "property {0} red;property {0} green;property {0} blue"


@pytest.mark.parametrize(
    ("kind", "most"),
    [("uchar", 255), ("float", 1), ("ushort", 65535), *((kind, 255) for kind in ("float", "ushort", "int"))],
)
def test_colours_of_vertices_in_ply(tmp_path: Path, kind: str, most: int) -> None:
    rows = [f"{x} {y} 0 {x * 0.8 * most:g} {y * most:g} {most}" for x, y, _ in SQUARE]
    _, points = sampled(write_ply(tmp_path / "a.ply", CHANNELS.format(kind), "", rows, ["4 0 1 2 3"]))
    expected = 255 * np.c_[points.positions[:, :2] * [0.8, 1], np.ones(len(points))]
    np.testing.assert_allclose(points.colors, expected, atol=0.51)


def test_colours_of_faces_in_ply(tmp_path: Path) -> None:
    rows, faces = [f"{x} {y} 0" for x, y, _ in SQUARE], ["3 0 1 2 255 0 0", "3 0 2 3 0 0 255"]
    _, points = sampled(write_ply(tmp_path / "a.ply", "", CHANNELS.format("uchar"), rows, faces))
    below = points.positions[:, 0] > points.positions[:, 1]
    np.testing.assert_array_equal(points.colors, np.where(below[:, None], [255, 0, 0], [0, 0, 255]))


def test_textures_of_ply(tmp_path: Path) -> None:
    rows = [f"{x} {y} 0 {x} {y}" for x, y, _ in SQUARE]
    path = write_ply(tmp_path / "a.ply", "property float s;property float t", "", rows, ["4 0 1 2 3"])
    path.write_text(path.read_text().replace("element vertex", "comment TextureFile texture.png\nelement vertex"))
    (tmp_path / "texture.png").write_bytes(png(TEXELS))
    _, points = sampled(path)
    np.testing.assert_array_equal(points.colors, texel_at(points.positions[:, :2]))


def test_of_stl_and_off_points_are_grey(tmp_path: Path) -> None:
    for suffix in ("stl", "off"):
        trimesh.creation.box().export(tmp_path / f"box.{suffix}")
        mesh, points = sampled(tmp_path / f"box.{suffix}", 10)
        assert (points.colors == GREY).all()
        assert not mesh.colors.is_whole


@pytest.mark.parametrize("suffix", ["glb", "ply", "obj"])
def test_colours_are_those_that_trimesh_has(tmp_path: Path, suffix: str) -> None:
    """Trimesh writes the file, reads it, and its colours are interpolated; glTF's as linear light."""
    ball = trimesh.creation.icosphere(subdivisions=2)
    ball.visual = trimesh.visual.ColorVisuals(
        ball, vertex_colors=np.c_[(ball.vertices + 1) * 127, np.full(len(ball.vertices), 255)].astype(np.uint8)
    )
    path = tmp_path / f"ball.{suffix}"
    ball.export(path)
    mesh, points = sampled(path, 500)
    assert mesh.colors.is_whole
    theirs = trimesh.load(path, force="mesh", process=False)
    colors = theirs.visual.vertex_colors[:, :3] / 255.0
    positions = points.positions if suffix != "glb" else points.positions @ [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    faces = mesh.source_face_ids[points.face_ids]
    weights = trimesh.triangles.points_to_barycentric(theirs.triangles[faces], positions)
    expected = np.einsum("nc,nca->na", weights, colors[theirs.faces[faces]])
    expected = encoded(expected) if suffix == "glb" else 255 * expected
    np.testing.assert_allclose(points.colors, expected, atol=1.6)


def test_meshes_of_trimesh_bring_their_colours(tmp_path: Path) -> None:
    box = trimesh.creation.box()
    box.visual.face_colors = np.c_[np.arange(36).reshape(12, 3) * 7, np.full(12, 255)]
    mesh = Mesh.from_trimesh(box, colors=True)
    points = sample_surface(mesh, n_points=100)
    np.testing.assert_array_equal(points.colors, box.visual.face_colors[points.face_ids, :3])
    path = write_quad(tmp_path, "newmtl painted\nmap_Kd texture.png\n")
    mesh = Mesh.from_trimesh(trimesh.load(path, force="mesh"), colors=True)
    points = sample_surface(mesh.cleaned(), n_points=100)
    np.testing.assert_array_equal(points.colors, texel_at(points.positions[:, :2]))
    assert (
        sample_surface(Mesh.from_trimesh(trimesh.Trimesh(box.vertices, box.faces), colors=True), n_points=3).colors
        == GREY
    ).all()


def write_gltf(path: Path, material: dict, *, colors: np.ndarray | None = None, extra: dict | None = None) -> Path:
    """The square, its texture's v pointing down as the standard has it."""
    built = Builder()
    uv = np.c_[SQUARE[:, 0], 1 - SQUARE[:, 1]].astype("<f4")
    attributes = {"POSITION": built.accessor(SQUARE.astype("<f4")), "TEXCOORD_0": built.accessor(uv)}
    indices = built.accessor(np.array([0, 1, 2, 0, 2, 3], "<u2"))
    if colors is not None:
        attributes["COLOR_0"] = built.accessor(colors, normalized=colors.dtype.kind == "u")
    document = built.finished(
        scenes=[{"nodes": [0, 1]}],
        nodes=[{"mesh": 0}, {"mesh": 0, "translation": [0, 0, 5]}],
        meshes=[{"primitives": [{"attributes": attributes, "indices": indices, "material": 0}]}],
        materials=[material],
        textures=[{"source": 0, "sampler": 0}],
        samplers=[{}],
        images=[{"uri": "texture.png"}],
    )
    path.write_text(json.dumps(document | (extra or {})))
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


def test_a_texture_of_gltf_that_is_no_base64_is_lacking(tmp_path: Path) -> None:
    image = {"images": [{"uri": "data:image/png;base64,!"}]}
    material = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "baseColorFactor": [0, 1, 0, 1]}}
    mesh, points = sampled(write_gltf(tmp_path / "a.gltf", material, extra=image))
    assert np.unique(points.colors, axis=0).tolist() == [[0, 255, 0]]
    assert "must be base64" in mesh.colors.warnings[0]


def test_colours_of_gltf_that_are_of_other_vertices_are_refused(tmp_path: Path) -> None:
    path = write_gltf(tmp_path / "a.gltf", {}, colors=np.ones((4, 3), "<f4"))
    document = json.loads(path.read_text())
    document["accessors"][3]["count"] = 3
    path.write_text(json.dumps(document))
    with pytest.raises(
        MeshError, match="COLOR_0 of glTF must have a row for each of the 4 vertices of the primitive; there are 3"
    ):
        load_mesh(path, colors=True)
    assert len(load_mesh(path).faces) == 4


@pytest.mark.parametrize(
    ("lines", "transmittance"),
    [
        ("d 0.25", 0.75),
        ("Kd 1 0 0\nTr 0.4", 0.4),
        ("d -halo 0.5", 0.5),
        ("d much", 0.0),
        ("map_Kd texture.png\nd 0.1", 0.9),
    ],
)
def test_materials_of_mtl_let_light_pass(tmp_path: Path, lines: str, transmittance: float) -> None:
    mesh = load_mesh(write_quad(tmp_path, f"newmtl painted\n{lines}\n"), colors=True)
    assert mesh.colors.transmittance == pytest.approx(transmittance)
    assert {mesh.colors.materials[i].name for i in mesh.colors.material_ids} == {"painted"}
    assert mesh.transparent({"paint*": 0.5}).colors.transmittance == pytest.approx(0.5)
    assert not mesh.transparent({"other": 0.5}).colors.transmittance.any()


@pytest.mark.parametrize(
    ("material", "transmittance"),
    [
        ({"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.3]}}, 0.7),
        ({"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.3]}}, 0.0),
        ({"extensions": {"KHR_materials_transmission": {"transmissionFactor": 0.9}}}, 0.9),
    ],
)
def test_materials_of_gltf_let_light_pass(tmp_path: Path, material: dict, transmittance: float) -> None:
    mesh = load_mesh(write_gltf(tmp_path / "glass.gltf", {"name": "glass", **material}), colors=True)
    assert mesh.transparent({"glass": None}).colors.transmittance == pytest.approx(transmittance)


def test_ply_of_strips_has_the_colours_of_its_vertices(tmp_path: Path) -> None:
    header = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    header += "property uchar red\nproperty uchar green\nproperty uchar blue\n"
    header += "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    rows = "0 0 0 255 0 0\n1 0 0 255 0 0\n0 1 0 255 0 0\n1 1 0 255 0 0\n4 0 1 2 3\n"
    (tmp_path / "strip.ply").write_text(header + rows)
    _, points = sampled(tmp_path / "strip.ply")
    assert (points.colors == [255, 0, 0]).all()
