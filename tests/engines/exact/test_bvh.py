"""The BVH: every face that can block is in exactly one leaf, every leaf in the tree, inside the boxes above it."""

import numpy as np
import pytest

from zbuf_occlude import Mesh
from zbuf_occlude.base.jit.threads import single_threaded
from zbuf_occlude.engines.exact.bvh import Bvh, build_bvh
from zbuf_occlude.engines.exact.layout import LEAF
from zbuf_occlude.geometry.hilbert import hilbert_order
from zbuf_occlude.meshes import shapes


def leaves_below(bvh: Bvh, node: int, box: np.ndarray) -> list[int]:
    """Return the leaves below a node, whose boxes, and whose faces, must be inside one."""
    found = []
    for i in range(LEAF * node, LEAF * node + bvh.n_children[node]):
        mine, child = bvh.boxes[6 * node : 6 * node + 6, i % LEAF], bvh.children[i]
        assert (mine[:3] >= box[:3]).all()
        assert (mine[3:] <= box[3:]).all()
        if child >= 0:
            found += leaves_below(bvh, child, mine)
            continue
        ids = bvh.face_ids[~child]
        corners = (bvh.vertices[bvh.faces[ids[ids >= 0]]] - bvh.centre) * bvh.scale
        assert (corners >= mine[:3]).all()
        assert (corners <= mine[3:]).all()
        found.append(~child)
    return found


def test_every_blocking_face_is_in_one_leaf_and_its_box() -> None:
    rng = np.random.default_rng(0)
    corners = rng.uniform(-1, 1, (1000, 1, 3)) + rng.normal(0, 0.1, (1000, 3, 3))
    corners[17] = corners[17, 0]  # no area at all
    bvh = build_bvh(Mesh(corners.reshape(-1, 3), np.arange(3000).reshape(-1, 3)), 0.0)
    used = bvh.face_ids >= 0
    assert sorted(bvh.face_ids[used]) == [f for f in range(1000) if f != 17]
    everywhere = np.repeat([-np.inf, np.inf], 3)
    assert sorted(leaves_below(bvh, 0, everywhere)) == list(range(len(bvh.face_ids)))
    assert bvh.face_ids.shape[1] == LEAF
    assert len(bvh.face_ids) <= 1000 // LEAF + 2
    assert bvh.rows[17] == bvh.rows[-1] == -1
    assert (bvh.face_ids.reshape(-1)[np.delete(bvh.rows[:-1], 17)] == np.delete(np.arange(1000), 17)).all()


def area(lower: np.ndarray, upper: np.ndarray) -> float:
    x, y, z = (upper - lower).T
    return float((x * y + y * z + z * x).sum())


def test_leaves_are_full_and_smaller_than_runs_along_the_curve() -> None:
    mesh = shapes.benchmark_mesh(19_000)  # several runs
    bvh = build_bvh(mesh, 0.0)
    # all are full but the last of the long faces, and of the others
    assert ((bvh.face_ids >= 0).sum(axis=1) < LEAF).sum() <= 2
    lower, upper = mesh.corners.min(axis=1), mesh.corners.max(axis=1)
    used = np.arange(LEAF) < bvh.n_children[:, None]
    boxes = bvh.boxes.reshape(-1, 6, LEAF).transpose(0, 2, 1)[used & (bvh.children.reshape(-1, LEAF) < 0)]
    runs = hilbert_order((lower + upper) / 2.0)[: len(lower) // LEAF * LEAF].reshape(-1, LEAF)
    along = area(lower[runs].min(axis=1), upper[runs].max(axis=1)) * bvh.scale**2
    assert area(boxes[:, :3], boxes[:, 3:]) < 0.8 * along


@pytest.mark.parametrize("n", [1, 16, 17, 5000])
def test_faces_at_one_place_are_in_one_leaf_each(n: int) -> None:
    bvh = build_bvh(Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.tile([[0, 1, 2]], (n, 1))), 0.0)
    assert np.array_equal(np.sort(bvh.face_ids[bvh.face_ids >= 0]), np.arange(n))
    assert sorted(leaves_below(bvh, 0, np.repeat([-np.inf, np.inf], 3))) == list(range(len(bvh.face_ids)))


def test_the_number_of_threads_changes_nothing() -> None:
    mesh = shapes.benchmark_mesh(150_000)  # more than one thread is woken for
    by_many = build_bvh(mesh, 0.0)
    with single_threaded():
        by_one = build_bvh(mesh, 0.0)
    used = (np.arange(LEAF) < by_one.n_children[:, None]).reshape(-1)
    np.testing.assert_array_equal(by_many.children[used], by_one.children[used])
    for name in set(Bvh._fields) - {"children"}:
        np.testing.assert_array_equal(getattr(by_many, name), getattr(by_one, name), err_msg=name)
