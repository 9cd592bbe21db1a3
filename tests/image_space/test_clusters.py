"""Clusters: every face that can block is in exactly one, inside its box."""

import numpy as np
import pytest

from zbuf_occlude import Mesh
from zbuf_occlude.hilbert import hilbert_order
from zbuf_occlude.image_space.clusters import WIDTH, _order, make_clusters
from zbuf_occlude.image_space.ordering import BITS, morton_codes
from zbuf_occlude.meshes import shapes


def test_every_blocking_face_is_in_one_cluster_and_its_box() -> None:
    rng = np.random.default_rng(0)
    corners = rng.uniform(-1, 1, (1000, 1, 3)) + rng.normal(0, 0.1, (1000, 3, 3))
    corners[17] = corners[17, 0]  # no area at all
    mesh = Mesh(corners.reshape(-1, 3), np.arange(3000).reshape(-1, 3))
    clusters = make_clusters(mesh)
    used = clusters.face_ids >= 0
    assert sorted(clusters.face_ids[used]) == [f for f in range(1000) if f != 17]
    for ids, lower, upper in zip(clusters.face_ids, clusters.lower, clusters.upper, strict=True):
        inside = mesh.corners[ids[ids >= 0]]
        assert (inside >= lower).all()
        assert (inside <= upper).all()
    assert clusters.face_ids.shape[1] == WIDTH
    assert len(clusters.face_ids) <= 1000 // WIDTH + 2


def area(lower: np.ndarray, upper: np.ndarray) -> float:
    x, y, z = (upper - lower).T
    return float((x * y + y * z + z * x).sum())


def test_clusters_are_full_and_smaller_than_runs_along_the_curve() -> None:
    mesh = shapes.benchmark_mesh(19_000)  # several runs
    clusters = make_clusters(mesh)
    assert ((clusters.face_ids >= 0).sum(axis=1) < WIDTH).sum() <= 2  # the last of the long faces, and of the others
    lower, upper = mesh.corners.min(axis=1), mesh.corners.max(axis=1)
    runs = hilbert_order((lower + upper) / 2.0)[: len(lower) // WIDTH * WIDTH].reshape(-1, WIDTH)
    assert area(clusters.lower, clusters.upper) < 0.8 * area(lower[runs].min(axis=1), upper[runs].max(axis=1))


@pytest.mark.parametrize("scale", [0.0, 1.0, 1e200])  # all at one place; areas beyond float64
def test_faces_that_no_area_tells_apart_are_in_one_cluster_each(scale: float) -> None:
    lower = scale * np.random.default_rng(1).random((5000, 3))
    order = _order(lower, 1.5 * lower)
    assert np.array_equal(np.sort(order), np.arange(5000))


def test_morton_codes_interleave_and_keep_neighbours_together() -> None:
    cells = 2**BITS
    positions = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [3, 0, 0], [cells - 1] * 3, [-5, 2 * cells, 0]]) + 0.25
    expected = [1, 2, 4, 9, 2 ** (3 * BITS) - 1, sum(2 ** (3 * i + 1) for i in range(BITS))]
    assert morton_codes(positions, np.zeros(3), float(cells)).tolist() == expected


def test_a_mesh_of_one_point_has_codes() -> None:
    assert morton_codes(np.ones((3, 3)), np.ones(3), 0.0).tolist() == [0, 0, 0]
