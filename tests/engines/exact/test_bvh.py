"""The BVH: every face that can block is in exactly one leaf, every leaf in the tree, inside the boxes above it."""

import numpy as np
import pytest

from zbuf_occlude import ArgumentError, Mesh, SurfacePoints, prepare
from zbuf_occlude.base.jit.threads import n_threads, use_threads
from zbuf_occlude.engines.exact import bvh as bvh_module
from zbuf_occlude.engines.exact import search, single_rays
from zbuf_occlude.engines.exact.bvh import Bvh, build_bvh
from zbuf_occlude.engines.exact.layout import LEAF
from zbuf_occlude.engines.exact.nodes import BinaryTree, new_tree
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


def test_leaves_are_mostly_full_and_far_smaller_than_runs_along_the_curve() -> None:
    mesh = shapes.benchmark_mesh(19_000)  # several runs
    bvh = build_bvh(mesh, 0.0)
    assert (bvh.face_ids >= 0).sum(axis=1).mean() > 14.0
    lower, upper = mesh.corners.min(axis=1), mesh.corners.max(axis=1)
    used = np.arange(LEAF) < bvh.n_children[:, None]
    boxes = bvh.boxes.reshape(-1, 6, LEAF).transpose(0, 2, 1)[used & (bvh.children.reshape(-1, LEAF) < 0)]
    runs = hilbert_order((lower + upper) / 2.0)[: len(lower) // LEAF * LEAF].reshape(-1, LEAF)
    along = area(lower[runs].min(axis=1), upper[runs].max(axis=1)) * bvh.scale**2
    assert area(boxes[:, :3], boxes[:, 3:]) < 0.65 * along


def clusters(n: int, faces_each: int) -> Mesh:
    """Make n groups of small faces in random places."""
    rng = np.random.default_rng(n)
    corners = rng.uniform(-1, 1, (n, 1, 1, 3)) + rng.uniform(0, 1e-3, (n, faces_each, 3, 3))
    return Mesh(corners.reshape(-1, 3), np.arange(3 * n * faces_each).reshape(-1, 3))


def test_a_leaf_with_a_gap_is_divided_there() -> None:
    bvh = build_bvh(clusters(3, 5), 0.0)  # 15 faces, one leaf by number
    assert sorted(tuple(ids[ids >= 0] // 5) for ids in bvh.face_ids) == [(0,) * 5, (1,) * 5, (2,) * 5]
    evenly = np.linspace([0, 0, 0], [1, 1, 1], 16)[:, None] + np.array([[0, 0, 0], [0.4, 0, 0], [0, 0.4, 0]])
    assert len(build_bvh(Mesh(evenly.reshape(-1, 3), np.arange(48).reshape(-1, 3)), 0.0).face_ids) == 1


def test_scattered_faces_do_not_get_many_more_leaves() -> None:
    n = 50_000
    assert len(build_bvh(clusters(n, 1), 0.0).face_ids) < 1.2 * n / LEAF


def least_area(tree: BinaryTree, leaves: int) -> float:
    """Return the least total half area of the nodes of any collapse of a binary tree, by trying them all."""
    first, middle, last = tree.spans[: leaves - 1].T
    one, other = np.arange(1, leaves), np.arange(leaves - 1) + middle - first
    one, other = np.where(middle - first > 1, one, -1), np.where(last - middle > 1, other, -1)
    lower, upper = tree.rows.reshape(-1, 16)[: leaves - 1, :3], -tree.rows.reshape(-1, 16)[: leaves - 1, 3:6]
    x, y, z = (upper - lower).T
    chosen = np.arange(2 ** (leaves - 2))[:, None] >> np.arange(leaves - 2) & 1  # of all spans but the root
    chosen = np.concatenate([np.ones((len(chosen), 1), dtype=np.int64), chosen], axis=1)
    fits, children = np.ones(len(chosen), dtype=bool), np.zeros_like(chosen)
    for span in range(leaves - 2, -1, -1):
        for half in (one[span], other[span]):
            children[:, span] += 1 if half < 0 else np.where(chosen[:, half], 1, children[:, half])
        fits &= (chosen[:, span] == 0) | (children[:, span] <= LEAF)
    return float((chosen[fits] @ (x * y + y * z + z * x)).min())


@pytest.mark.parametrize("leaves", [2, 16, 17, 19])
def test_no_choice_of_nodes_has_less_area(leaves: int, monkeypatch: pytest.MonkeyPatch) -> None:
    tree = new_tree(leaves)
    monkeypatch.setattr(bvh_module, "new_tree", lambda n: tree)
    bvh = build_bvh(clusters(leaves, LEAF), 0.0)
    assert len(bvh.face_ids) == leaves
    inner = (np.arange(LEAF) < bvh.n_children[:, None]) & (bvh.children.reshape(-1, LEAF) >= 0)
    boxes = np.concatenate([bvh.box[None], bvh.boxes.reshape(-1, 6, LEAF).transpose(0, 2, 1)[inner]])
    assert area(boxes[:, :3], boxes[:, 3:]) == pytest.approx(least_area(tree, leaves), rel=1e-6)


@pytest.mark.parametrize("n", [1, 16, 17, 5000])
def test_faces_at_one_place_are_in_one_leaf_each(n: int) -> None:
    bvh = build_bvh(Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.tile([[0, 1, 2]], (n, 1))), 0.0)
    assert np.array_equal(np.sort(bvh.face_ids[bvh.face_ids >= 0]), np.arange(n))
    assert sorted(leaves_below(bvh, 0, np.repeat([-np.inf, np.inf], 3))) == list(range(len(bvh.face_ids)))


def test_the_number_of_threads_changes_nothing() -> None:
    mesh = shapes.benchmark_mesh(150_000)  # more than one thread is woken for
    by_many = build_bvh(mesh, 0.0)
    before = n_threads()
    use_threads(1)
    try:
        by_one = build_bvh(mesh, 0.0)
    finally:
        use_threads(before)
    used = (np.arange(LEAF) < by_one.n_children[:, None]).reshape(-1)
    np.testing.assert_array_equal(by_many.children[used], by_one.children[used])
    for name in set(Bvh._fields) - {"children"}:
        np.testing.assert_array_equal(getattr(by_many, name), getattr(by_one, name), err_msg=name)


@pytest.mark.parametrize("size", [1, 5, 21])
def test_rays_hit_a_mesh_of_a_few_units_in_the_last_place(size: int) -> None:
    """The centre is rounded by up to half a unit, so the mesh reaches farther from it than half its diagonal."""
    rng = np.random.default_rng(size)
    lattice = rng.integers(0, size + 1, (300, 3, 3)).astype(np.float64)
    lattice[0, :2] = [0, 0, 0], [size, size, size]
    mesh = Mesh((2.0**52 + 1001.0 + lattice).reshape(-1, 3), np.arange(900).reshape(-1, 3))
    directions = rng.integers(-1, 2, (300, 3)).astype(np.float64)
    directions = directions[directions.any(axis=1)]
    origins = 2.0**52 + 1001.0 + size * rng.integers(0, 2, (len(directions), 3)) - 2.0 * size * directions
    with prepare(mesh, "exact") as occluder, prepare(mesh, "oracle") as oracle:
        found, truth = occluder.first_hits(origins, directions), oracle.first_hits(origins, directions)
    assert (truth.face_ids >= 0).sum() > 50
    assert found.face_ids.tolist() == truth.face_ids.tolist()


@pytest.mark.parametrize("size", [1.0, 1e-60])
def test_lengths_to_be_searched_are_more_than_minus_two(size: int) -> None:
    """An eye at the point: the traversal's stack ends at -`F32_MAX`, which such a length must stay above."""
    bvh = build_bvh(Mesh(size * np.eye(3), np.array([[0, 1, 2]])), 0.0)
    scratch, place = single_rays.make_traversal_scratch(bvh), size * np.full((1, 3), 0.2)
    which, answer = np.zeros(1, dtype=np.int64), np.zeros((1, 1), dtype=np.uint8)
    asked = place, np.full(1, -1, dtype=np.int32), place.copy(), which, which, answer
    search._test_lines_of_sight(np.zeros(4, dtype=np.int64), bvh, *asked, scratch)
    assert answer.tolist() == [[1]]
    assert scratch.rays[single_rays.LIMIT * single_rays.TRAVERSAL_RAYS] > -2.0


def test_an_eye_far_from_a_tiny_mesh_is_refused() -> None:
    mesh = Mesh(np.array([[-1, -1, 0], [2, -1, 0], [-1, 2, 0]]) * 1e-170, np.array([[0, 1, 2]]))
    assert mesh.diagonal == pytest.approx(4.243e-170, rel=1e-3)
    with prepare(mesh, "exact") as occluder, pytest.raises(ArgumentError, match="diagonals"):
        occluder.visible(SurfacePoints.free([[0, 0, -1e-170]]), [[0, 0, 1e50]])
