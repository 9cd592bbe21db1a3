"""Clusters: every face that can block is in exactly one, inside its box."""

import numpy as np
import pytest

from zbuf_occlude import Mesh, shapes
from zbuf_occlude.exact.bvh import make_scene
from zbuf_occlude.exact.clusters import halve_runs, make_clusters
from zbuf_occlude.exact.layout import CLUSTER
from zbuf_occlude.geometry.hilbert import hilbert_order


def test_every_blocking_face_is_in_one_cluster_and_its_box() -> None:
    rng = np.random.default_rng(0)
    corners = rng.uniform(-1, 1, (1000, 1, 3)) + rng.normal(0, 0.1, (1000, 3, 3))
    corners[17] = corners[17, 0]  # no area at all
    mesh = Mesh(corners.reshape(-1, 3), np.arange(3000).reshape(-1, 3))
    scene = make_scene(mesh, 0.0)
    used = scene.face_ids >= 0
    assert sorted(scene.face_ids[used]) == [f for f in range(1000) if f != 17]
    for ids, box in zip(scene.face_ids, scene.world_boxes, strict=True):
        inside = mesh.corners[ids[ids >= 0]]
        assert (inside >= box[:3]).all()
        assert (inside <= box[3:]).all()
    assert scene.face_ids.shape[1] == CLUSTER
    assert len(scene.face_ids) <= 1000 // CLUSTER + 2
    assert scene.rows[17] == scene.rows[-1] == -1
    assert (scene.face_ids.reshape(-1)[np.delete(scene.rows[:-1], 17)] == np.delete(np.arange(1000), 17)).all()


def area(lower: np.ndarray, upper: np.ndarray) -> float:
    x, y, z = (upper - lower).T
    return float((x * y + y * z + z * x).sum())


def test_clusters_are_full_and_smaller_than_runs_along_the_curve() -> None:
    mesh = shapes.benchmark_mesh(19_000)  # several runs
    boxes = make_scene(mesh, 0.0).world_boxes
    # all are full but the last of the long faces, and of the others
    assert ((make_clusters(mesh) >= 0).sum(axis=1) < CLUSTER).sum() <= 2
    lower, upper = mesh.corners.min(axis=1), mesh.corners.max(axis=1)
    runs = hilbert_order((lower + upper) / 2.0)[: len(lower) // CLUSTER * CLUSTER].reshape(-1, CLUSTER)
    assert area(boxes[:, :3], boxes[:, 3:]) < 0.8 * area(lower[runs].min(axis=1), upper[runs].max(axis=1))


@pytest.mark.parametrize("scale", [0.0, 1.0, 1e200])  # all at one place; areas beyond float64
def test_faces_that_no_area_tells_apart_are_in_one_cluster_each(scale: float) -> None:
    lower = scale * np.random.default_rng(1).random((5000, 3))
    faces = np.arange(5000, dtype=np.int32)
    halve_runs(np.concatenate([lower, 1.5 * lower], axis=1), faces)
    assert np.array_equal(np.sort(faces), np.arange(5000))
