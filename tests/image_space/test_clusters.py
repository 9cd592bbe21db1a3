"""Clusters: every face that can block is in exactly one, inside its box."""

import numpy as np

from zbuf_occlude import Mesh
from zbuf_occlude.image_space.clusters import WIDTH, make_clusters
from zbuf_occlude.image_space.ordering import BITS, morton_codes


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


def test_morton_codes_interleave_and_keep_neighbours_together() -> None:
    cells = 2**BITS
    positions = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [3, 0, 0], [cells - 1] * 3, [-5, 2 * cells, 0]]) + 0.25
    expected = [1, 2, 4, 9, 2 ** (3 * BITS) - 1, sum(2 ** (3 * i + 1) for i in range(BITS))]
    assert morton_codes(positions, np.zeros(3), float(cells)).tolist() == expected


def test_a_mesh_of_one_point_has_codes() -> None:
    assert morton_codes(np.ones((3, 3)), np.ones(3), 0.0).tolist() == [0, 0, 0]
