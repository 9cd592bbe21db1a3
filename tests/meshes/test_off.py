"""OFF as it really occurs: every way of writing one cube gives one cube."""

from itertools import chain

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tests.scenes import DATA
from zbuf_occlude import MeshError, load_mesh
from zbuf_occlude.meshes.off import read_off
from zbuf_occlude.meshes.polygons import Polygons

VERTICES = [[x, y, z] for x in (0.0, 1.5) for y in (0.0, -2.25) for z in (0.0, 1e-3)]
QUADS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
V_LINES = [" ".join(map(repr, vertex)) for vertex in VERTICES]
F_LINES = ["4 " + " ".join(map(str, quad)) for quad in QUADS]
BODY = "\n".join(V_LINES + F_LINES)
GLUED = DATA / "malformed" / "glued_header_bathtub_0002.off"
PLAIN = DATA / "modelnet" / "bathtub" / "train" / "bathtub_0002.off"


def off(polygons: Polygons) -> str:
    lines = ["OFF", f"{len(polygons.vertices)} {len(polygons.counts)} 0"]
    lines += [" ".join(map(repr, vertex)) for vertex in polygons.vertices.tolist()]
    ends = np.cumsum(polygons.counts)
    for n, end in zip(polygons.counts, ends, strict=True):
        lines.append(" ".join(map(str, [n, *polygons.corners[end - n : end]])))
    return "\n".join(lines) + "\n"


def assert_is_the_cube(polygons: Polygons) -> None:
    assert polygons.vertices.tolist() == VERTICES
    assert polygons.counts.tolist() == [4] * 6
    assert polygons.corners.reshape(6, 4).tolist() == QUADS


SPELLINGS = {
    "plain": f"OFF\n8 6 12\n{BODY}\n",
    "counts glued to the header": f"OFF8 6 12\n{BODY}\n",
    "no header": f"8 6 12\n{BODY}\n",
    "no number of edges": f"OFF\n8 6\n{BODY}\n",
    "CRLF": f"OFF\n8 6 12\n{BODY}\n".replace("\n", "\r\n"),
    "comments": "# a cube\nOFF # of six sides\n# 9 9 9\n8 6 12 # counts\n" + BODY.replace("\n", " # 1 2 3\n#\n"),
    "all on one line": " ".join(f"OFF 8 6 12 {BODY}".split()),
    "five numbers a line": "OFF\n8 6 12\n"
    + "\n".join(" ".join(BODY.split()[i : i + 5]) for i in range(0, len(BODY.split()), 5)),
    "colours after the faces": "OFF\n8 6 12\n" + "\n".join(V_LINES + [f"{f} 255 {i} 7" for i, f in enumerate(F_LINES)]),
    "colours after some faces": "OFF\n8 6 12\n"
    + "\n".join(V_LINES + [f + " 0.5 0.25 1.0 1" * (i % 2) for i, f in enumerate(F_LINES)]),
    "COFF": "COFF\n8 6 12\n" + "\n".join([f"{v} 255 0 0 255" for v in V_LINES] + F_LINES),
    "STCNOFF": "STCNOFF\n8 6 12\n" + "\n".join([f"{v} 0 0 1 1 0 0 1 0.5 0.5" for v in V_LINES] + F_LINES),
    "CNOFF on one line": " ".join(["CNOFF 8 6 12", *[f"{v} 0 0 1 1 0 0 1" for v in V_LINES], *F_LINES]),
    "more after the last face": f"OFF\n8 6 12\n{BODY}\n1 0\n2 0 1\nthe end\n",
}


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_every_spelling_of_a_cube_is_the_cube(spelling: str) -> None:
    assert_is_the_cube(read_off(SPELLINGS[spelling].encode()))


@pytest.mark.skipif(not GLUED.exists(), reason=f"{GLUED} is not there; set ZBUF_OCCLUDE_DATA")
def test_modelnets_glued_header_loads_as_the_repaired_file_does() -> None:
    glued, plain = load_mesh(GLUED), load_mesh(PLAIN)
    assert (len(plain.vertices), len(read_off(PLAIN.read_bytes()).counts)) == (700, 664)
    assert glued.vertices.tobytes() == plain.vertices.tobytes()
    assert glued.faces.tobytes() == plain.faces.tobytes()
    assert glued.source_face_ids is not None
    assert plain.source_face_ids is not None
    assert glued.source_face_ids.tobytes() == plain.source_face_ids.tobytes()
    assert glued.dropped == plain.dropped


@given(data=st.data())
@settings(max_examples=60)
def test_round_trip_is_exact(data: st.DataObject) -> None:
    numbers = st.floats(-1e70, 1e70)
    vertices = data.draw(hnp.arrays(np.float64, st.tuples(st.integers(1, 20), st.just(3)), elements=numbers))
    faces = data.draw(st.lists(st.lists(st.integers(0, len(vertices) - 1), max_size=6), min_size=1, max_size=10))
    polygons = Polygons(vertices, np.array(list(chain(*faces)), dtype=np.int64), np.array([len(f) for f in faces]))
    text = off(polygons)
    for spelling in (text, " ".join(text.split()), text.replace("\n", "\r\n\r\n")):
        again = read_off(spelling.encode())
        assert again.vertices.tobytes() == vertices.tobytes()
        assert again.counts.tolist() == polygons.counts.tolist()
        assert again.corners.tolist() == polygons.corners.tolist()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "must begin with OFF"),
        ("OFFICE 8 6 12", "must begin with OFF"),
        ("OFF", "must begin with its numbers of vertices and faces; it has 'nothing'"),
        ("OFF -8 6 12", "it has '-8 6 12'"),
        ("OFF BINARY\n\x01", "must be text; this one is binary"),
        ("OFF\n8 6 12\0", "must be a text file; it has NUL bytes"),
        ("4OFF\n1 1 0\n0 0 0 1\n3 0 0 0", "must have points of three coordinates"),
        ("OFF\n353535235358 1 0\n0 0 0\n3 0 0 0", "353,535,235,358 vertices and 1 faces, but only 7 numbers follow"),
        (f"OFF\n8 6 12\n{BODY[:60]}", r"declares 8 vertices and 6 faces, but only \d+ numbers follow"),
        (f"OFF\n8 6 12\n{BODY[:-4]}", "face 5 must have the 4 corners that it declares; the file ends before"),
        (f"OFF\n8 7 12\n{BODY}", "the 7 faces that it declares; it ends after 6"),
        (f"OFF\n8 6 12\n{BODY.replace('4 0 1 3 2', '2.5 0 1 3 2')}", r"face 0 must begin with .*; it begins with 2\.5"),
        (f"OFF\n8 6 12\n{BODY.replace('4 0 1 3 2', '4 0 1 3 8')}", "face 0 must refer to the 8 vertices by 0 to 7"),
        (f"OFF\n8 6 12\n{BODY.replace('1.5', '1.5.5')}", r"must have numbers here; it has '1\.5\.5'"),
        (" ".join(f"OFF 8 5 12 {BODY}".split()), "must end after the 5 faces that it declares.*; 5 numbers are left"),
        (f"OFF\n8 5 12\n{BODY}", "must end after the 8 vertices and 5 faces that it declares; another face follows"),
        ("OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n3 0 1 2\n3 0 2 1", "3 vertices and 2 faces .*another face follows"),
        # read as one stream, numbers of the first face would be the fifth vertex, and what is left three faces
        ("OFF\n5 3 0\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n3 0 1 1\n3 1 2 1\n3 0 2 0", "the 5 vertices .*; it has 12 numbers"),
    ],
)
def test_damaged_files_are_refused_in_words(text: str, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        read_off(text.encode())
