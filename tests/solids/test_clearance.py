"""Distances of points from the faces beside their own, against trimesh's closest points."""

import numpy as np
import pytest
import trimesh

from tests.scenes import box
from zbuf_occlude import Mesh, sample_surface
from zbuf_occlude.meshes import shapes
from zbuf_occlude.solids import find_solids
from zbuf_occlude.solids.clearance import edge_margins, face_beside, face_frames, squared_distance

REACH = 0.01


def pyramid() -> Mesh:
    vertices = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [0, 0, 3.0]])
    return Mesh(vertices, np.array([[0, 2, 1], [0, 3, 2], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]))


MESHES = {
    "ball": shapes.solids.icosphere(2),
    "box": shapes.refined(box((1.0, 1.0, 0.03)), 300),
    "pyramid": pyramid(),
    "table": shapes.make("table", 0),
}


def distances(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(n,) distances of points from triangles, (n, 3, 3)."""
    return np.asarray(np.linalg.norm(points - trimesh.triangles.closest_point(triangles, points), axis=1))


def test_distances_are_those_of_trimesh() -> None:
    rng = np.random.default_rng(0)
    points, triangles = rng.normal(size=(2000, 3)), rng.normal(size=(2000, 3, 3))
    triangles[:500, 2] = triangles[:500, 1] + 1e-3 * rng.normal(size=(500, 3))  # needles
    found = np.sqrt([squared_distance(tuple(p), g) for p, g in zip(points, triangles, strict=True)])
    assert found == pytest.approx(distances(points, triangles), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("name", MESHES)
def test_beyond_the_margins_every_other_face_keeps_away(name: str) -> None:
    mesh = MESHES[name]
    solids, near = find_solids(mesh, REACH)
    frames = face_frames(near.corners)
    margins, ordered, ends = edge_margins(near.corners, near.starts, near.others, frames, REACH)
    first, last = near.starts[:-1], near.starts[1:]
    points = sample_surface(mesh, n_points=3000, seed=1)
    positions = (points.positions - mesh.centre) / mesh.diagonal
    n_clear = n_beside = 0
    for point, own in zip(positions, points.face_ids, strict=True):
        if solids.outward[own] == 0:
            continue
        f = near.corners[own]
        edges = np.roll(f, -1, axis=0) - f
        along = edges / np.linalg.norm(edges, axis=1, keepdims=True)
        from_edges = np.linalg.norm(np.cross(point - f, along), axis=1)
        others = np.flatnonzero((solids.surfaces == solids.surfaces[own]) & (np.arange(len(mesh.faces)) != own))
        close = others[distances(np.tile(point, (len(others), 1)), near.corners[others]) <= REACH]
        # what the margins clear the point of is not close, and what is apart from its plane never is
        groups = np.split(ordered[first[own] : last[own]], ends[own] - first[own])
        beyond = from_edges > margins[own]
        for group in (*(groups[1 + edge] for edge in range(3) if beyond[edge]), groups[4]):
            assert not set(close) & set(group)
        n_clear += beyond.all() and len(groups[0]) == 0
        expected = own if len(close) == 0 else close[0] if len(close) == 1 else -1
        assert face_beside(tuple(point), own, own, near.corners, ordered, first[own], last[own], REACH) == expected
        n_beside += len(close) == 1
    assert n_clear > 0
    for i in range(len(mesh.faces)):
        assert set(ordered[first[i] : last[i]]) == set(near.others[first[i] : last[i]])
    assert n_beside > 0
