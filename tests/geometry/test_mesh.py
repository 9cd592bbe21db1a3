"""Mesh: what it refuses, that it cannot be changed, its measures, and what cleaning drops and counts."""

import pickle
import re
from itertools import permutations
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zbuf_occlude import ArgumentError, Mesh, MeshError, sample_surface
from zbuf_occlude.views import paper100

CORNERS = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 12.0]])
TETRAHEDRON = Mesh(CORNERS, [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]], name="tetrahedron")


def test_it_cannot_be_changed_in_another_process_either() -> None:
    """Writable arrays are another type to numba: all kernels were compiled a second time."""
    points, views = sample_surface(TETRAHEDRON, n_points=5), paper100()
    for whole in (TETRAHEDRON, points, views):
        found = pickle.loads(pickle.dumps(whole))
        arrays = {name: value for name, value in vars(found).items() if isinstance(value, np.ndarray)}
        assert len(arrays) >= 3
        for name, value in arrays.items():
            assert not value.flags.writeable, name
            np.testing.assert_array_equal(value, getattr(whole, name))
    assert not pickle.loads(pickle.dumps(TETRAHEDRON)).corners.flags.writeable


def test_measures() -> None:
    assert np.allclose(TETRAHEDRON.areas[:3], [6.0, 24.0, 18.0])
    assert np.allclose(TETRAHEDRON.face_normals[0], [0, 0, 12])  # not of unit length
    assert TETRAHEDRON.corners.shape == (4, 3, 3)
    assert TETRAHEDRON.bounds.tolist() == [[0, 0, 0], [4, 3, 12]]
    assert TETRAHEDRON.centre.tolist() == [2, 1.5, 6]
    assert TETRAHEDRON.longest_side == 12
    assert TETRAHEDRON.diagonal == 13
    assert repr(TETRAHEDRON) == "Mesh('tetrahedron', 4 vertices, 4 faces)"


def test_vertices_that_no_face_uses_do_not_count() -> None:
    mesh = Mesh(np.concatenate([CORNERS, [[1e6, 0, 0]]]), TETRAHEDRON.faces)
    assert mesh.bounds.tolist() == TETRAHEDRON.bounds.tolist()
    assert len(mesh.vertices) == 5


def test_bounds_are_those_of_the_vertices_in_use() -> None:
    """Of 300 vertices faces have some; those that lie outermost are in no face."""
    rng = np.random.default_rng(0)
    vertices, faces = rng.normal(size=(300, 3)), rng.integers(0, 290, (90, 3))
    vertices[290:] *= 100.0
    used = vertices[np.unique(faces)]
    assert len(used) < 250
    np.testing.assert_array_equal(Mesh(vertices, faces).bounds, [used.min(axis=0), used.max(axis=0)])


@pytest.mark.parametrize("name", ["vertices", "faces", "source_face_ids", "corners", "face_normals", "areas", "bounds"])
def test_nothing_can_be_changed(name: str) -> None:
    values = getattr(Mesh(CORNERS, [[0, 1, 2]]), name)
    with pytest.raises(ValueError, match="read-only"):
        values[0] = 0


@pytest.mark.parametrize(
    ("vertices", "faces", "error", "message"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3), int), MeshError, "x has 0 vertices and 0 faces. Is it a point cloud"),
        (CORNERS, np.zeros((0, 3), int), MeshError, "x has 4 vertices and 0 faces. Is it a point cloud"),
        (CORNERS, [[0, 1, 4]], ArgumentError, "faces must lie in [0, 4); got values from 0 to 4."),
        (CORNERS, [[0, 1, -1]], ArgumentError, "faces must lie in [0, 4); got values from -1 to 1."),
        (CORNERS, [[0, 1, 2, 3]], ArgumentError, "got quads, (1, 4). Triangulate first."),
        (CORNERS, [[0.0, 1.0, 2.0]], ArgumentError, "faces must be (n, 3) int; got (1, 3) float64. Convert it with"),
        (CORNERS.T, [[0, 1, 2]], ArgumentError, "vertices must be (n, 3) float; got (3, 4) float64. Transpose it?"),
        (CORNERS * np.nan, [[0, 1, 2]], ArgumentError, "vertices must be finite; row 0 is [nan, nan, nan]."),
    ],
)
def test_errors(vertices: Any, faces: Any, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=re.escape(message)):
        Mesh(vertices, faces, name="x")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda m: m.transformed(2.0, (1, 2)), "translation must be (3,); got (2,) int64"),
        (lambda m: m.transformed(np.ones(3)), "scale must be a number; got (3,) float64."),
        (lambda m: m.transformed(np.nan), "vertices must be finite; row 0 is"),
        (lambda m: m.rotated(np.eye(4)), "rotation must be (3, 3); got (4, 4) float64. Take the upper left"),
        (lambda m: Mesh.from_trimesh("chair.off"), "mesh must be a trimesh.Trimesh; got str."),
    ],
)
def test_errors_of_transformations(call: Any, message: str) -> None:
    with pytest.raises(ArgumentError, match=re.escape(message)):
        call(TETRAHEDRON)


def test_transformations() -> None:
    moved = TETRAHEDRON.transformed(2.0, (1.0, 0.0, 0.0))
    assert moved.bounds.tolist() == [[1, 0, 0], [9, 6, 24]]
    assert moved.name == "tetrahedron"
    quarter = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]  # about z: x goes to y
    assert TETRAHEDRON.rotated(quarter).vertices[1].tolist() == [0, 4, 0]
    normal = TETRAHEDRON.normalized()
    assert normal.longest_side == 1.0
    assert np.allclose(normal.centre, 0.0)
    taken = Mesh.from_trimesh(SimpleNamespace(vertices=CORNERS, faces=np.array([[0, 1, 2]])), name="t")
    assert taken.faces.tolist() == [[0, 1, 2]]


def test_what_a_mesh_cannot_be_made_into() -> None:
    point = Mesh(np.ones((3, 3)), [[0, 1, 2]], name="dot")
    with pytest.raises(MeshError, match="All vertices of dot coincide"):
        point.normalized()
    with pytest.raises(MeshError, match="All 1 faces of dot have zero area"):
        point.cleaned()
    with pytest.raises(MeshError, match=r"source_face_ids must have one entry a face \(1\); got 2\."):
        Mesh(CORNERS, [[0, 1, 2]], source_face_ids=[0, 1])


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_a_face_twice_goes_in_any_order_and_by_position(order: tuple[int, int, int]) -> None:
    """The second face uses other vertices at the same three places, one of them with -0.0 for 0.0."""
    vertices = np.concatenate([CORNERS[:3], CORNERS[:3]])
    vertices[3:][vertices[3:] == 0.0] = -0.0
    mesh = Mesh(vertices, [[0, 1, 2], [3 + i for i in order]])
    cleaned = mesh.cleaned()
    assert cleaned.faces.tolist() == [[0, 1, 2]]
    assert cleaned.dropped == {"degenerate": 0, "duplicate": 1}
    assert len(cleaned.vertices) == 6  # vertices are never merged


def test_faces_of_no_area_go_and_the_rest_keeps_order_and_origin() -> None:
    vertices = np.concatenate([CORNERS, [[8.0, 0.0, 0.0], [2.0, 1e-13, 0.0]]])
    faces = [[0, 0, 1], [1, 2, 3], [0, 1, 4], [0, 1, 2], [0, 1, 5], [2, 1, 0], [3, 3, 3]]
    mesh = Mesh(vertices, faces, source_face_ids=np.arange(100, 107))
    cleaned = mesh.cleaned()
    assert cleaned.faces.tolist() == [[1, 2, 3], [0, 1, 2]]
    assert cleaned.source_face_ids is not None
    assert cleaned.source_face_ids.tolist() == [101, 103]
    assert cleaned.dropped == {"degenerate": 4, "duplicate": 1}
    assert mesh.dropped == {}
    again = cleaned.cleaned()
    assert again.dropped == cleaned.dropped  # counts add up over cleanings
    assert again.faces.tolist() == cleaned.faces.tolist()


@settings(max_examples=50)
@given(
    faces=st.lists(st.tuples(*[st.integers(0, 7)] * 3), min_size=1, max_size=30),
    exponent=st.integers(-30, 30),
)
def test_cleaning_does_not_depend_on_scale(faces: list[tuple[int, int, int]], exponent: int) -> None:
    """The corners of a cube in thin proportions, faces drawn at random: many repeat, many are degenerate."""
    cube = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1e-3) for z in (0.0, 1e-6)])
    kept = []
    for scale in (1.0, 2.0**exponent, 10.0 ** (exponent / 3.0)):
        try:
            kept.append(Mesh(cube * scale, faces).cleaned().source_face_ids.tolist())  # type: ignore[union-attr]
        except MeshError:
            kept.append([])
    assert kept[0] == kept[1] == kept[2]
    assert {tuple(sorted(faces[i])) for i in kept[0]} == {tuple(sorted(f)) for f in faces if len(set(f)) == 3}
    assert len({tuple(sorted(faces[i])) for i in kept[0]}) == len(kept[0])


@pytest.mark.parametrize("size", [2, 7, 40])
def test_repeated_faces_of_a_grid_are_dropped_but_the_first(size: int) -> None:
    """Vertices of a grid, each twice: coordinates whose low bits are zero, against `np.unique`."""
    rng = np.random.default_rng(size)
    vertices = np.stack(np.meshgrid(*[np.arange(float(size))] * 3), axis=-1).reshape(-1, 3)[:, [2, 0, 1]]
    vertices = np.concatenate([vertices, vertices])
    faces = rng.integers(0, len(vertices), (3000, 3))
    same = np.unique(np.sort(faces % (len(vertices) // 2), axis=1), axis=0, return_index=True)[1]
    a, b, c = (vertices[faces[np.sort(same), i]] for i in range(3))
    has_area = np.cross(b - a, c - a).any(axis=1)
    assert Mesh(vertices, faces).cleaned().source_face_ids.tolist() == np.sort(same)[has_area].tolist()  # type: ignore[union-attr]
