"""Surfaces that cross themselves, and triangles that meet: against known solids, the predicate, a fan in a plane."""

import itertools

import numpy as np
import pytest

from zbuf_occlude import Mesh
from zbuf_occlude.meshes import shapes
from zbuf_occlude.predicates import blocks
from zbuf_occlude.solids import closed_surfaces, find_solids, near
from zbuf_occlude.solids.crossing import may_meet

BALL = shapes.solids.icosphere(3)


def mirrored_beyond(height: float) -> Mesh:
    """A ball mirrored below the plane z = height, where the map's determinant is negative: closed, crossing itself."""
    beyond = BALL.vertices[:, 2:] < height
    return Mesh(BALL.vertices * np.where(beyond, [[-1.0, 1.0, 1.0]], 1.0), BALL.faces)


def kept(mesh: Mesh) -> np.ndarray:
    """Whether each surface of a mesh passes for a solid's."""
    found, _ = find_solids(mesh)
    return np.array([(found.outward[found.surfaces == i] != 0).all() for i in range(found.surfaces.max() + 1)])


@pytest.mark.parametrize("height", [0.3, -0.5, -0.9])
def test_a_ball_that_crosses_itself_bounds_no_solid_however_small_the_crossing(height: float) -> None:
    crossed = mirrored_beyond(height)
    assert (closed_surfaces(crossed).outward != 0).all()
    assert kept(crossed).tolist() == [False]
    apart = crossed.transformed(1.0, [4.0, 0.0, 0.0])
    both = Mesh(
        np.concatenate([BALL.vertices, apart.vertices]), np.concatenate([BALL.faces, apart.faces + len(BALL.vertices)])
    )
    assert kept(both).tolist() == [True, False]


def test_surfaces_may_lie_within_and_cross_each_other() -> None:
    inner, beside = BALL.transformed(0.5), BALL.transformed(0.7, [0.6, 0.0, 0.0])
    meshes = (BALL, Mesh(inner.vertices, inner.faces[:, ::-1]), beside)
    mesh = Mesh(
        np.concatenate([m.vertices for m in meshes]),
        np.concatenate([m.faces + i * len(BALL.vertices) for i, m in enumerate(meshes)]),
    )
    assert kept(mesh).all()
    assert len(kept(mesh)) == 3


@pytest.mark.parametrize("label", shapes.CLASSES)
def test_refining_a_sound_surface_leaves_it_sound(label: str) -> None:
    # faces halved at the midpoints of edges: many that share a corner lie in one plane or in one line
    mesh = shapes.make(label, 1)
    fine = shapes.refined(mesh, 2 * len(mesh.faces))
    before, after = find_solids(mesh)[0].outward != 0, find_solids(fine)[0].outward != 0
    assert fine.areas[after].sum() == pytest.approx(mesh.areas[before].sum())
    assert before.any() == after.any()


def test_too_many_pairs_make_no_solid(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(near, "MOST_COMPARED", 100)
    assert kept(BALL).tolist() == [False]


def test_a_reach_that_brings_all_faces_near_makes_no_solid(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(near, "FEW_NEAR", 1000)
    assert (find_solids(BALL, 1e-5)[0].outward != 0).all()
    found, pairs = find_solids(BALL, 0.5)
    assert (found.outward == 0).all()
    assert len(pairs.others) == 0


def crosses(f: np.ndarray, g: np.ndarray, edges: list[tuple[int, int]]) -> bool:
    """Whether some of the edges of f pass through g, by the definition of blocked."""
    return any(blocks(f[i], f[j], g[0], g[1], g[2], 0.0) for i, j in edges)


ALL_EDGES = [(0, 1), (1, 2), (2, 0)]


@pytest.mark.parametrize("shared", [0, 1, 2])
def test_random_triangles_meet_where_an_edge_of_one_passes_through_the_other(shared: int) -> None:
    rng = np.random.default_rng(shared)
    met = 0
    for _ in range(3000):
        f, g = rng.normal(size=(2, 3, 3)) * 0.3
        g[:shared] = f[:shared]
        f_edges = [edge for edge in ALL_EDGES if min(edge) >= shared]  # the others touch g in what is shared
        truth = crosses(f, g, f_edges) or crosses(g, f, f_edges)
        turn, other = rng.permutation(3), rng.permutation(3)
        assert may_meet(f[turn], g[other]) == truth
        assert may_meet(g[other], f[turn]) == truth
        met += truth
    assert met > 100 or shared == 2


def test_a_fan_in_a_plane_meets_only_where_its_sectors_overlap() -> None:
    turn = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    rim = np.array([[np.cos(a), np.sin(a), 0.0] for a in np.arange(6) * np.pi / 3]) @ turn
    centre = np.zeros(3)
    sector = [np.array([centre, rim[i], rim[(i + 1) % 6]]) for i in range(6)]
    for i, j in itertools.combinations(range(6), 2):
        assert not may_meet(sector[i], sector[j]), (i, j)
    wide = np.array([centre, rim[0], rim[2]])
    assert may_meet(sector[0], wide)  # share an edge and lie on each other
    assert may_meet(wide, np.array([centre, rim[1], rim[3]]))  # share a corner only
    assert may_meet(wide, np.array([centre, 0.5 * (rim[0] + rim[1]), 0.5 * (rim[1] + rim[2])]))  # one within the other
    assert not may_meet(wide, np.array([centre, rim[3], rim[4]]))
    assert may_meet(wide, wide[[1, 2, 0]])
    assert may_meet(wide, wide + 1e-14)  # nearer than can be told apart
    assert not may_meet(wide, wide + 1e-6 * np.cross(rim[0], rim[1]))


@pytest.mark.parametrize("turn", range(3))
def test_a_triangle_with_two_equal_corners_is_not_said_to_keep_apart_from_what_shares_them(turn: int) -> None:
    needle = np.roll([[0.1, 0.2, 0.3], [0.1, 0.2, 0.3], [0.4, 0.1, 0.5]], turn, axis=0)
    beside = np.array([[0.1, 0.2, 0.3], [-0.4, 0.1, 0.2], [0.0, -0.3, 0.1]])
    assert may_meet(needle, beside)
    assert may_meet(beside, needle)
