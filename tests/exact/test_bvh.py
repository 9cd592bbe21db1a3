"""Leaves: every face that can block is in exactly one, inside its box."""

import numpy as np
import pytest

from zbuf_occlude import Mesh, shapes
from zbuf_occlude.exact.bvh import build_bvh, halve_runs, make_leaves
from zbuf_occlude.exact.layout import LEAF
from zbuf_occlude.geometry.hilbert import hilbert_order


def test_every_blocking_face_is_in_one_leaf_and_its_box() -> None:
    rng = np.random.default_rng(0)
    corners = rng.uniform(-1, 1, (1000, 1, 3)) + rng.normal(0, 0.1, (1000, 3, 3))
    corners[17] = corners[17, 0]  # no area at all
    mesh = Mesh(corners.reshape(-1, 3), np.arange(3000).reshape(-1, 3))
    bvh = build_bvh(mesh, 0.0)
    used = bvh.face_ids >= 0
    assert sorted(bvh.face_ids[used]) == [f for f in range(1000) if f != 17]
    for ids, box in zip(bvh.face_ids, bvh.world_boxes, strict=True):
        inside = mesh.corners[ids[ids >= 0]]
        assert (inside >= box[:3]).all()
        assert (inside <= box[3:]).all()
    assert bvh.face_ids.shape[1] == LEAF
    assert len(bvh.face_ids) <= 1000 // LEAF + 2
    assert bvh.rows[17] == bvh.rows[-1] == -1
    assert (bvh.face_ids.reshape(-1)[np.delete(bvh.rows[:-1], 17)] == np.delete(np.arange(1000), 17)).all()


def area(lower: np.ndarray, upper: np.ndarray) -> float:
    x, y, z = (upper - lower).T
    return float((x * y + y * z + z * x).sum())


def test_leaves_are_full_and_smaller_than_runs_along_the_curve() -> None:
    mesh = shapes.benchmark_mesh(19_000)  # several runs
    boxes = build_bvh(mesh, 0.0).world_boxes
    # all are full but the last of the long faces, and of the others
    assert ((make_leaves(mesh) >= 0).sum(axis=1) < LEAF).sum() <= 2
    lower, upper = mesh.corners.min(axis=1), mesh.corners.max(axis=1)
    runs = hilbert_order((lower + upper) / 2.0)[: len(lower) // LEAF * LEAF].reshape(-1, LEAF)
    assert area(boxes[:, :3], boxes[:, 3:]) < 0.8 * area(lower[runs].min(axis=1), upper[runs].max(axis=1))


@pytest.mark.parametrize("scale", [0.0, 1.0, 1e200])  # all at one place; areas beyond float64
def test_faces_that_no_area_tells_apart_are_in_one_leaf_each(scale: float) -> None:
    lower = scale * np.random.default_rng(1).random((5000, 3))
    faces = np.arange(5000, dtype=np.int32)
    halve_runs(np.concatenate([lower, 1.5 * lower], axis=1), faces)
    assert np.array_equal(np.sort(faces), np.arange(5000))
