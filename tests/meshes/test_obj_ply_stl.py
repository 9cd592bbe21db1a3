"""OBJ, PLY and STL against trimesh where trimesh is right, and against the formats' rules where it is not."""

import struct
from itertools import chain
from pathlib import Path

import numpy as np
import pytest
import trimesh
from trimesh.exchange.ply import export_ply
from trimesh.exchange.stl import export_stl, export_stl_ascii

from zbuf_occlude import MeshError, load_mesh
from zbuf_occlude.meshes.obj import read_obj
from zbuf_occlude.meshes.ply import read_ply, read_ply_points
from zbuf_occlude.meshes.stl import read_stl

BALL = trimesh.creation.icosphere(subdivisions=2)
QUAD_OBJ = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


# --- OBJ


def test_obj_is_what_trimesh_reads(tmp_path: Path) -> None:
    BALL.export(tmp_path / "ball.obj", digits=17)
    polygons = read_obj((tmp_path / "ball.obj").read_bytes())
    assert np.array_equal(polygons.vertices, BALL.vertices)
    assert np.array_equal(polygons.corners.reshape(-1, 3), BALL.faces)


@pytest.mark.parametrize(
    "faces",
    [
        "f 1 2 3 4\n",
        "f 1/5 2/6 3/7 4/8\n",
        "f 1/1/1 2/2/2 3/3/3 4/4/4 # a comment 9\n",
        "f -4/-1/-1 -3/-1/-1 -2/-1/-1 -1/-1/-1\n",
        "f 1 -3 3 -1\n",
        "  f\t1  2 \\\n 3 4\r\n",
        "usemtl wood\ns off\ng a b\nf 1 2 3 4\nl 1 2\np 1\nvt 0 0\nvn 0 0 1\n",
    ],
)
def test_obj_faces_however_they_are_spelt(faces: str) -> None:
    polygons = read_obj((QUAD_OBJ + faces).encode())
    assert polygons.counts.tolist() == [4]
    assert polygons.corners.tolist() == [0, 1, 2, 3]
    assert polygons.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]


def test_obj_negative_indices_count_back_from_their_own_line() -> None:
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 5 5\nv 6 6 6\nf -2 1 -1\nf 2 3 5\n"
    assert read_obj(text.encode()).corners.tolist() == [0, 1, 2, 3, 0, 4, 1, 2, 4]


@pytest.mark.parametrize(
    "line", ["v 1 2 3 1.0\n", "v 1 2 3 0.5 0.5 0.5\n", "v 1e0 +2.0 3. nan nan nan\n", "\tv  1.0\t2 3 # 4\n"]
)
def test_obj_vertices_may_have_more_than_coordinates(line: str) -> None:
    assert read_obj((line * 3 + "f 1 2 3").encode()).vertices.tolist() == [[1, 2, 3]] * 3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (QUAD_OBJ + "f 1 2 5\n", "face 0 must refer to the 4 vertices by 0 to 3; it refers to 4"),
        (QUAD_OBJ + "f 0 1 2\n", "must count from 1, or back from -1; one is 0"),
        (QUAD_OBJ + "f 1 2 x\n", "must have numbers here; it has 'x'"),
        (QUAD_OBJ + "f 1 2 /3\nf -1 -2 -3", "must have numbers here; it has '/3'"),
        ("v 1 2\nf 1 1 1\n", "must have three coordinates"),
        ("\0\1", "must be a text file"),
    ],
)
def test_damaged_obj_is_refused_in_words(text: str, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        read_obj(text.encode())


# --- PLY

PLY_POLYGONS = [[0, 1, 2], [0, 1, 2, 3], [4, 3, 2, 1, 0], [1, 2, 4]]
PLY_VERTICES = [[0, 0, 0], [1, 0, 0.5], [1, 1, 0], [0, 1, 0], [0.25, 0.5, -1]]
PLY_FORMATS = ["ascii", "binary_little_endian", "binary_big_endian"]


def ply(encoding: str, polygons: list[list[int]], newline: str = "\n", extras: bool = False) -> bytes:
    """A PLY file; with extras it has further properties and elements before, between and after those wanted."""
    header = ["ply", f"format {encoding} 1.0", "comment end_header is not here"]
    rows: list[list[tuple[str, list[float]]]] = []
    if extras:
        header += ["element camera 2", "property list uchar short shape", "property double f"]
        rows += [[("B", [2]), ("h", [7, 8]), ("d", [0.5])], [("B", [0]), ("h", []), ("d", [1.5])]]
    header += [f"element vertex {len(PLY_VERTICES)}"]
    header += ["property uchar red"] * extras + [f"property float {axis}" for axis in "xyz"]
    rows += [[("B", [9])] * extras + [("f", vertex)] for vertex in PLY_VERTICES]
    header += [f"element face {len(polygons)}"]
    header += ["property list ushort float texcoord", "property int flags"] * extras
    header += ["property list uchar int vertex_indices"]
    header += ["property float quality"] * extras
    for i, face in enumerate(polygons):
        before = [("H", [i]), ("f", [0.5] * i), ("i", [-1])] if extras else []
        rows.append([*before, ("B", [len(face)]), ("i", face), *([("f", [0.25])] if extras else [])])
    if extras:
        header += ["element edge 1", "property int vertex1"]
        rows.append([("i", [3])])
    text = newline.join([*header, "end_header", ""]).encode()
    if encoding == "ascii":
        return text + newline.join(" ".join(str(v) for _, values in row for v in values) for row in rows).encode()
    order = "<" if "little" in encoding else ">"
    return text + b"".join(struct.pack(f"{order}{len(values)}{code}", *values) for row in rows for code, values in row)


@pytest.mark.parametrize("encoding", PLY_FORMATS)
@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"], ids=["LF", "CRLF", "CR"])
@pytest.mark.parametrize("extras", [False, True], ids=["bare", "extras"])
@pytest.mark.parametrize("polygons", [PLY_POLYGONS, [[0, 1, 2], [2, 3, 4]]], ids=["mixed", "alike"])
def test_ply_in_every_encoding(encoding: str, newline: str, extras: bool, polygons: list[list[int]]) -> None:
    read = read_ply(ply(encoding, polygons, newline, extras))
    assert read.vertices.tolist() == PLY_VERTICES
    assert read.counts.tolist() == [len(face) for face in polygons]
    assert read.corners.tolist() == list(chain(*polygons))


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_ply_is_what_trimesh_writes(encoding: str) -> None:
    polygons = read_ply(export_ply(BALL, encoding=encoding))
    assert np.allclose(polygons.vertices, BALL.vertices, atol=1e-6)
    assert np.array_equal(polygons.corners.reshape(-1, 3), BALL.faces)


STRIPS = [[0, 1, 2, 3, 4], [-1, 0, 2, -1, -1, 4, 3, 2, 1], [], [1], [2, 1, 0]]
STRIP_TRIANGLES = [[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 2], [2, 3, 1], [2, 1, 0]]


@pytest.mark.parametrize("encoding", PLY_FORMATS)
def test_ply_of_strips_is_a_mesh(encoding: str) -> None:
    data = ply(encoding, STRIPS).replace(b"element face", b"element tristrips")
    assert read_ply(data).corners.reshape(-1, 3).tolist() == STRIP_TRIANGLES
    assert read_ply_points(data) is None


def test_a_strip_in_ply_faces_one_way() -> None:
    """A band around a cylinder as one strip: all its normals point outwards."""
    angles = np.repeat(np.linspace(0, 2 * np.pi, 24, endpoint=False), 2)
    points = np.stack([np.cos(angles), np.sin(angles), np.tile([1.0, 0.0], 24)], axis=1)
    strip = [*range(48), 0, 1]
    rows = [*(f"{x} {y} {z}" for x, y, z in points.tolist()), f"{len(strip)} {' '.join(map(str, strip))}"]
    header = "ply\nformat ascii 1.0\nelement vertex 48\nproperty float x\nproperty float y\nproperty float z\n"
    header += "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    polygons = read_ply((header + "\n".join(rows)).encode())
    a, b, c = polygons.vertices[polygons.corners].reshape(-1, 3, 3).transpose(1, 0, 2)
    outwards = (np.cross(b - a, c - a) * (a + b + c) * [1, 1, 0]).sum(axis=1)
    assert len(outwards) == 48
    assert (outwards > 0).all() or (outwards < 0).all()


def test_ply_of_faces_and_strips_has_both() -> None:
    header, body = GOOD_PLY.split("end_header\n")
    both = f"{header}element tristrips 1\nproperty list int int vertex_index\nend_header\n{body}\n5 0 1 2 -1 4"
    polygons = read_ply(both.encode())
    assert polygons.corners.tolist() == [*chain(*PLY_POLYGONS), 0, 1, 2]
    assert polygons.counts.tolist() == [*map(len, PLY_POLYGONS), 3]
    with pytest.raises(MeshError, match="must refer to the 5 vertices"):
        read_ply(both.replace("5 0 1 2 -1 4", "5 0 1.5 2 -1 4").encode())


@pytest.mark.parametrize("line", ["bye", "Created by Blender3D 2.47 - www.blender.org, source file: a.blend", "# made"])
@pytest.mark.parametrize("encoding", PLY_FORMATS)
def test_lines_in_a_header_of_ply_that_are_no_part_of_it_are_skipped(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, encoding: str, line: str
) -> None:
    plain, odd = tmp_path / "plain.ply", tmp_path / "odd.ply"
    plain.write_bytes(ply(encoding, PLY_POLYGONS))
    odd.write_bytes(plain.read_bytes().replace(b"element vertex", f"{line}\n{line}\nelement vertex".encode()))
    expected = load_mesh(plain)
    assert not [record for record in caplog.records if record.name.startswith("zbuf_occlude.meshes")]
    mesh = load_mesh(odd)
    assert mesh.vertices.tolist() == expected.vertices.tolist()
    assert mesh.faces.tolist() == expected.faces.tolist()
    assert f"{odd}: 2 lines of its header" in caplog.text
    assert line[:40] in caplog.text


GOOD_PLY = ply("ascii", PLY_POLYGONS).decode()
BINARY_PLY = ply("binary_little_endian", PLY_POLYGONS)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "must begin with the line 'ply'"),
        (b"ply\nformat ascii 1.0\nelement vertex 3\n", "must end with end_header"),
        (b"ply\nformat ascii 1.0\nend_header\n", "must have the elements vertex and face.*point cloud"),
        (GOOD_PLY.replace("ascii", "martian").encode(), "must be ascii or binary; its format is 'martian'"),
        (GOOD_PLY.replace("float x", "real x").encode(), "its line 'property real x'"),
        (GOOD_PLY.replace("uchar int", "float int").encode(), "its line 'property list float int"),
        (GOOD_PLY.replace("vertex 5", "vertex " + "9" * 19).encode(), "its line 'element vertex 999"),
        (GOOD_PLY.replace("float x", "float u").encode(), "must have x, y and z"),
        (GOOD_PLY.replace("vertex 5", "vertex 353535235358").encode(), "the 353,535,235,358 rows of the element v"),
        (GOOD_PLY.replace("face 4", "face 5").encode(), "the 5 rows of the element face .* it has 4 lines"),
        (GOOD_PLY[:-12].encode(), "must contain the 4 rows|must be complete on its line"),
        (GOOD_PLY.replace("3 0 1 2", "9 0 1 2").encode(), "a list in the element face must be complete on its line"),
        (GOOD_PLY.replace("3 0 1 2", "3 0 1 7").encode(), "face 0 must refer to the 5 vertices"),
        (BINARY_PLY.replace(b"vertex 5", b"vertex 353535235358"), "353,535,235,358 rows of the element vertex"),
        (
            GOOD_PLY.replace("element face 4", "element vertex 4").encode(),
            "each element once; it has 'vertex'",
        ),
        (GOOD_PLY.replace("property float y", "proprty float y").encode(), "its line 'proprty float y'"),
        (GOOD_PLY.replace("property list", "propertlist").encode(), "its line 'propertlist uchar int v"),
        (GOOD_PLY.replace("element vertex", "\x00\x80\nelement vertex").encode("latin-1"), "its line"),
        (GOOD_PLY.replace("element vertex", "elements vertex").encode(), "its line 'elements vertex 5'"),
        (BINARY_PLY[:-1], "the 4 rows of the element face that it declares"),
        (BINARY_PLY.replace(b"list uchar int", b"list uint uint"), "the 4 rows of the element face"),
        (BINARY_PLY.replace(b"\x05\4\0\0\0", b"\xff\4\0\0\0"), "the 4 rows of the element face"),
    ],
)
def test_damaged_ply_is_refused_in_words(data: bytes, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        read_ply(data)


# --- STL


@pytest.mark.parametrize("write", [export_stl, lambda mesh: export_stl_ascii(mesh).encode()], ids=["binary", "ascii"])
def test_stl_is_what_trimesh_writes(write) -> None:
    polygons = read_stl(write(BALL))
    assert polygons.corners.tolist() == list(range(3 * len(BALL.faces)))
    assert np.allclose(polygons.vertices.reshape(-1, 3, 3), BALL.triangles, atol=1e-6)


FACET = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1e0 0\nendloop\nendfacet\n"
OTHER = FACET.replace("1 0 0", "3 0 0")
FOUR = FACET.replace("endloop", "vertex 3 3 3\nendloop")


@pytest.mark.parametrize(
    "text",
    [
        f"solid\n{FACET}{OTHER}endsolid",
        f"solid vertex 1 2 3 facet\n{FACET}endsolid vertex 1 2 3 facet\nsolid b\n{OTHER}endsolid b\n",
        f"  SOLID a\n{FACET}{OTHER}ENDSOLID a".upper(),
        f"solid a\n{FACET}{OTHER}end solid a".replace("\n", "\r\n\t"),
        f"solid a\n{FACET}{OTHER}endsolid a".replace("normal 0 0 1", "normal -nan(ind) ? 1"),
    ],
    ids=["plain", "two solids, odd names", "upper case", "CRLF and tabs", "normals that are no numbers"],
)
def test_ascii_stl_however_it_is_spelt(text: str, capfd: pytest.CaptureFixture[str]) -> None:
    found = read_stl(text.encode()).vertices.reshape(2, 3, 3).tolist()
    assert found == [[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 0], [3, 0, 0], [0, 1, 0]]]
    assert capfd.readouterr() == ("", "")


def test_binary_stl_may_begin_with_solid_and_have_more_after_the_facets() -> None:
    binary = b"solid" + export_stl(BALL)[5:]
    assert len(read_stl(binary).counts) == len(BALL.faces)
    assert len(read_stl(binary + b"more").counts) == len(BALL.faces)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "must have at least 84 bytes; it has 0"),
        (export_stl(BALL)[:-1], "must contain the 320 facets that it declares; it has room for 319"),
        (bytes(80) + b"\xff\xff\xff\xff" + bytes(50), "the 4,294,967,295 facets that it declares; it has room for 1"),
        (f"solid\n{FACET}".encode(), "must end; one does not. Is it cut short"),
        (f"solid\n{FACET.replace('vertex 1 0 0', '')}endsolid".encode(), "the 1 facets .* three .* each; there are 2"),
        (f"solid\n{FACET.replace('1 0 0', '1 0 o')}endsolid".encode(), "must have numbers here; it has 'o'"),
        (f"solid\n{FACET.replace('1 0 0', '1 0')}endsolid".encode(), "three coordinates"),
        (f"solid\n{FACET.replace('vertex 1 0 0', '')}{FOUR}endsolid".encode(), "three vertices each; there are 6"),
        (f"solid\n{FACET.replace('1 0 0', '1 nan 0')}endsolid".encode(), "vertex 1 must be finite"),
    ],
)
def test_damaged_stl_is_refused_in_words(data: bytes, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        read_stl(data)
