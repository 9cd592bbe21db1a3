"""Faces near each other, against all pairs of boxes."""

import numpy as np
import pytest

from tests.scenes import box, together
from zbuf_occlude import Mesh
from zbuf_occlude.meshes import shapes
from zbuf_occlude.solids import closed_surfaces, near, near_faces

BALLS = [shapes.solids.icosphere(2).transformed(1.0, [0.5 * i, 0.0, 0.0]) for i in range(3)]
OPEN = Mesh(BALLS[0].vertices, BALLS[0].faces[3:])


def pairs_by_brute_force(mesh: Mesh, reach: float) -> set[tuple[int, int]]:
    closed = closed_surfaces(mesh)
    lower, upper = mesh.corners.min(axis=1), mesh.corners.max(axis=1)
    gap = 2.0 * reach * mesh.diagonal
    overlap = ((lower[:, None] <= upper[None] + gap) & (lower[None] <= upper[:, None] + gap)).all(axis=2)
    overlap &= (closed.surfaces[:, None] == closed.surfaces) & (closed.outward != 0)[:, None]
    return {(int(i), int(j)) for i, j in np.argwhere(overlap) if i != j}


@pytest.mark.parametrize("reach", [0.0, 0.02])
@pytest.mark.parametrize(
    "mesh", [together(*BALLS, OPEN), together(box(), box((0.5, 0.5, 3.0)))], ids=["balls", "boxes"]
)
def test_near_faces_are_those_whose_boxes_overlap(mesh: Mesh, reach: float) -> None:
    found = near_faces(mesh, closed_surfaces(mesh), reach)
    assert found.complete.all()
    got = {(i, int(j)) for i in range(len(mesh.faces)) for j in found.others[found.starts[i] : found.starts[i + 1]]}
    assert got == pairs_by_brute_force(mesh, reach)
    assert len(got) == len(found.others)


def test_a_face_may_have_more_neighbours_than_are_kept_at_first() -> None:
    n = 80
    angle = 2.0 * np.pi * np.arange(n) / n
    rim = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)
    cone = Mesh(
        np.concatenate([rim, [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]]),
        np.array([face for i in range(n) for face in ([i, (i + 1) % n, n], [(i + 1) % n, i, n + 1])]),
    )
    found = near_faces(cone, closed_surfaces(cone), 0.0)
    assert np.diff(found.starts).max() > near.KEPT
    got = {(i, int(j)) for i in range(len(cone.faces)) for j in found.others[found.starts[i] : found.starts[i + 1]]}
    assert got == pairs_by_brute_force(cone, 0.0)


def test_too_many_pairs_are_not_compared_and_the_surfaces_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(near, "MOST_COMPARED", 100)
    mesh = together(BALLS[0], OPEN.transformed(1.0, [3.0, 0.0, 0.0]))
    found = near_faces(mesh, closed_surfaces(mesh), 0.0)
    assert found.complete.tolist() == [False, True]
    assert len(found.others) == 0
    assert (np.diff(found.starts) == 0).all()


def test_an_open_mesh_has_none() -> None:
    found = near_faces(OPEN, closed_surfaces(OPEN), 0.1)
    assert len(found.others) == 0
    assert len(found.starts) == len(OPEN.faces) + 1
