"""The second question's contract: one suite that every method that casts rays goes through."""

from collections.abc import Callable

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.needs import need
from tests.random_scenes import triangles
from tests.rational import first_hit, meeting
from tests.scenes import SQUARE, box, stacked
from tests.visibility.test_contract import SCENE
from zbuf_occlude.base.errors import UnavailableError
from zbuf_occlude.meshes.shapes import solids
from zbuf_occlude.visibility import METHODS
from zbuf_occlude.visibility.interface import FirstHits, Method, VisibilityQuery
from zbuf_occlude.visibility.methods import oracle

Prepare = Callable[..., VisibilityQuery]

AGREEMENT = {"embree": 0.9995, "depth_buffer": 0.97}
"""Least fraction of rays for which a method that is not exact names the oracle's face, or one within the contact
tolerance of it."""

PLATES = stacked(SQUARE - [0.5, 0.5, 0.0], SQUARE - [0.5, 0.5, 1.0], SQUARE - [0.5, 0.5, 1.0])
"""Unit squares at z = 0 (faces 0, 1) and twice at z = -1 (2, 3 and their copies 4, 5)."""


def random_rays(n: int, seed: int = 0, about: zo.Mesh = SCENE) -> tuple[np.ndarray, np.ndarray]:
    """Origins in and around a mesh, each ray towards a point in its box; directions of many lengths."""
    rng = np.random.default_rng(seed)
    origins = about.centre + rng.normal(size=(n, 3)) * about.longest_side
    targets = about.centre + rng.uniform(-0.6, 0.6, (n, 3)) * about.longest_side
    return origins, (targets - origins) * 10.0 ** rng.uniform(-3, 3, (n, 1))


ORIGINS, DIRECTIONS = random_rays(3000)
Rays = tuple[np.ndarray, np.ndarray]


def casting() -> list[Method]:
    return [method for method in METHODS if not method.ray_casting_unsupported_reason]


@pytest.fixture(scope="module", params=casting(), ids=lambda method: method.name)
def method(request: pytest.FixtureRequest) -> Method:
    row: Method = request.param
    need(row.requires)
    return row


@pytest.fixture(scope="module")
def rays(method: Method) -> Rays:
    """Of a method that draws a picture for each origin, in software perhaps, a tenth as many."""
    n = 300 if method.needs_gl else 3000
    return ORIGINS[:n], DIRECTIONS[:n]


def wrong(method: Method, mesh: zo.Mesh, found: FirstHits, origins: np.ndarray, directions: np.ndarray) -> float:
    """Fraction of rays with another answer than the oracle's: for an exact method any difference; for another, a face
    more than the contact tolerance nearer or farther."""
    reference = oracle.prepare(mesh)
    truth = reference.first_hits(origins, directions)
    with np.errstate(invalid="ignore"):
        apart = np.where(found.distances == truth.distances, 0.0, np.abs(found.distances - truth.distances))
    if method.exact:
        return float(((found.face_ids != truth.face_ids) | (apart > 1e-8 * truth.distances)).mean())
    return float((apart > reference.contact).mean())


def allowed(method: Method) -> float:
    return 0.0 if method.exact else 1.0 - AGREEMENT[method.name]


def test_a_method_without_first_hits_says_why() -> None:
    for row in METHODS:
        if row.ray_casting_unsupported_reason and not row.missing() and not row.needs_gl:
            with zo.prepare(box(), row.name) as occluder, pytest.raises(UnavailableError, match="cannot cast rays"):
                occluder.first_hits([[0, 0, 3]], [[0, 0, -1]])


def test_the_answer(prepare: Prepare, rays: Rays) -> None:
    with prepare(SCENE) as occluder:
        face_ids, distances = occluder.first_hits(*rays)
    assert face_ids.shape == distances.shape == (len(rays[0]),)
    assert (face_ids.dtype, distances.dtype) == (np.int32, np.float64)
    assert ((face_ids == -1) == np.isinf(distances)).all()
    assert 0.1 < (face_ids >= 0).mean() < 0.95
    assert (distances > 0).all()


def test_agreement_with_the_oracle(method: Method, prepare: Prepare, rays: Rays) -> None:
    with prepare(SCENE) as occluder:
        found = occluder.first_hits(*rays)
        assert wrong(method, SCENE, found, *rays) <= allowed(method)
        within = occluder.first_hits([[0.1, 0.05, 0.1]], DIRECTIONS)  # in the ball: one origin for all rays
    assert wrong(method, SCENE, within, np.array([[0.1, 0.05, 0.1]]), DIRECTIONS) <= allowed(method)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_scale_does_not_matter(method: Method, prepare: Prepare, rays: Rays, scale: float) -> None:
    mesh, (origins, directions) = SCENE.transformed(scale), rays
    with prepare(mesh) as occluder:
        found = occluder.first_hits(origins * scale, directions)
    assert wrong(method, mesh, found, origins * scale, directions) <= allowed(method)


def test_ties_go_to_the_lowest_face(method: Method, prepare: Prepare) -> None:
    """The shared diagonal of a square, a copied sheet, a corner of two plates' edge: exact in small numbers."""
    with prepare(PLATES) as occluder:
        diagonal = occluder.first_hits([[0.25, 0.25, 2.0]], [[0.0, 0.0, -1.0]])
        copies = occluder.first_hits([[0.25, -0.125, -3.0]], [[0.0, 0.0, 1.0]])
        shared = occluder.first_hits([[0.25, 0.25, -3.0]], [[0.0, 0.0, 1.0]])
    assert diagonal.distances.item() == pytest.approx(2.0)
    assert copies.distances.item() == shared.distances.item() == pytest.approx(2.0)
    if method.exact:
        assert (diagonal.face_ids.item(), copies.face_ids.item(), shared.face_ids.item()) == (0, 2, 2)


def test_edges_and_corners_are_part_of_a_face(method: Method, prepare: Prepare) -> None:
    on_the_edge = [[0.5, 0.25, 2.0], [0.5, 0.5, 2.0], [-0.5, 0.0, 2.0]]
    outside = [[0.5 + 1e-4, 0.25, 2.0], [0.5 + 1e-4, 0.5, 2.0], [-0.5 - 1e-4, 0.0, 2.0]]
    with prepare(PLATES) as occluder:
        if method.exact:
            assert (occluder.first_hits(on_the_edge, [[0, 0, -1.0]] * 3).distances == 2.0).all()
        assert (occluder.first_hits(outside, [[0, 0, -1.0]] * 3).face_ids == -1).all()


def test_edges_that_faces_share_do_not_leak(method: Method, prepare: Prepare) -> None:
    """Rays from a ball's middle to points of its edges meet something, always."""
    ball = solids.icosphere(3)
    a, b = ball.corners[:, 0], ball.corners[:, 1]
    targets = np.concatenate([a + s * (b - a) for s in (0.1, 0.3, 0.7)])
    with prepare(ball) as occluder:
        found = occluder.first_hits([[0.01, 0.02, 0.03]], targets - [0.01, 0.02, 0.03])
    assert (found.face_ids >= 0).mean() >= 1.0 - allowed(method)
    met = found.face_ids >= 0
    assert np.allclose(found.distances[met], np.linalg.norm(targets - [0.01, 0.02, 0.03], axis=1)[met], rtol=1e-4)


def test_rays_within_a_faces_plane_miss_it(prepare: Prepare) -> None:
    with prepare(PLATES) as occluder:
        found = occluder.first_hits([[-2.0, 0.125, 0.0], [-2.0, 0.125, 1.0]], [[1.0, 0, 0], [2.0, 0, -1.0]])
    assert found.face_ids.tolist()[0] == -1
    assert found.distances[1] == pytest.approx(np.sqrt(5.0), rel=1e-6)  # tilted, it meets the upper plate


def test_rays_that_start_on_a_face_leave_it(prepare: Prepare) -> None:
    """The ray is open at its origin: a face met there is not met."""
    with prepare(PLATES) as occluder:
        found = occluder.first_hits([[0.125, 0.25, 0.0]] * 3, [[0, 0, -1.0], [0, 0, 1.0], [0.1, 0.0, -1.0]])
    assert found.face_ids.tolist()[1] == -1
    assert found.distances[[0, 2]] == pytest.approx([1.0, np.sqrt(1.01)])


def test_rays_that_start_inside(prepare: Prepare) -> None:
    with prepare(box((2.0, 2.0, 2.0))) as occluder:
        directions = np.concatenate([np.eye(3), -np.eye(3)])
        found = occluder.first_hits([[0.25, 0.5, -0.125]], directions)
    assert (found.face_ids // 2).tolist() == [1, 3, 5, 0, 2, 4]
    assert found.distances == pytest.approx([0.75, 0.5, 1.125, 1.25, 1.5, 0.875])


def test_far_origins(method: Method, prepare: Prepare, rays: Rays) -> None:
    origins = SCENE.centre + (rays[0] - SCENE.centre) * 300.0
    directions = SCENE.centre + np.random.default_rng(5).uniform(-0.3, 0.3, origins.shape) - origins
    with prepare(SCENE) as occluder:
        found = occluder.first_hits(origins, directions)
    assert (found.face_ids >= 0).mean() > 0.3
    assert wrong(method, SCENE, found, origins, directions) <= allowed(method)


@pytest.mark.parametrize("diagonals", [2e3, 1e6, 1e8])
@pytest.mark.parametrize("name", ["oracle", "exact"])
def test_rays_from_far_away_meet_what_they_meet_from_nearer(name: str, diagonals: float) -> None:
    origins, directions = random_rays(1000, 8)
    units = directions / np.linalg.norm(directions, axis=1)[:, None]
    near = origins - 2.0 * SCENE.diagonal * units
    reference, skipped = oracle.prepare(SCENE), diagonals * SCENE.diagonal
    truth = reference.first_hits(near, directions)
    with zo.prepare(SCENE, name) as occluder:
        found = occluder.first_hits(near - skipped * units, directions)
    assert (truth.face_ids >= 0).mean() > 0.3
    for i in range(0, len(directions), 20):
        assert found.face_ids[i] == first_hit(SCENE, (near - skipped * units)[i], directions[i])[0]
    # origins moved are rounded: these are other rays by 1e-16 of the way
    same = found.face_ids == truth.face_ids
    assert same.mean() > 0.9
    met = same & (truth.face_ids >= 0)
    assert np.abs(found.distances[met] - skipped - truth.distances[met]).max() < 1e-6 * SCENE.diagonal


def test_no_rays_and_one_ray(prepare: Prepare, rays: Rays) -> None:
    origins, directions = rays
    with prepare(SCENE) as occluder:
        none = occluder.first_hits(np.empty((0, 3)), np.empty((0, 3)))
        assert none.face_ids.shape == none.distances.shape == (0,)
        all_of_them = occluder.first_hits(origins, directions)
        for i in (0, 7, len(origins) - 1):
            one = occluder.first_hits(origins[i : i + 1], directions[i : i + 1])
            assert one.face_ids.item() == all_of_them.face_ids[i]


def test_what_is_given_is_not_changed(prepare: Prepare, rays: Rays) -> None:
    origins, directions = (each.copy() for each in rays)
    with prepare(SCENE) as occluder:
        first = occluder.first_hits(origins, directions)
        again = occluder.first_hits(origins.tolist(), np.asfortranarray(directions))
    assert (origins == rays[0]).all()
    assert (directions == rays[1]).all()
    assert (first.face_ids == again.face_ids).all()
    assert (first.distances == again.distances).all()


@pytest.mark.parametrize(
    ("origins", "directions", "message"),
    [
        ([[0, 0, 0]] * 2, [[0, 0, 1]] * 3, r"origins must be one, or one per direction \(3\); got 2\. Repeat them\."),
        ([[0, 0, 0]], [[0, 0, 1], [0, 0, 0]], r"directions must have a length; row 1 is zero\. Leave it out\."),
        ([[0, 0, 0]], [[0, 0, np.inf]], "directions must be finite; row 0 is"),
        ([0, 0, 0], [[0, 0, 1]], r"origins must be \(n, 3\) float; got \(3,\) int64\. Add a leading axis"),
        ([[0, 0, 0]], [[0, 1]], r"directions must be \(n, 3\) float; got \(1, 2\)"),
    ],
    ids=["lengths", "zero", "infinite", "one flat", "two numbers"],
)
def test_bad_arguments(prepare: Prepare, origins: list[float], directions: list[float], message: str) -> None:
    with prepare(SCENE) as occluder, pytest.raises(zo.ArgumentError, match=message):
        occluder.first_hits(origins, directions)


def test_closing(prepare: Prepare) -> None:
    with prepare(SCENE) as occluder:
        pass
    with pytest.raises(zo.ArgumentError, match="query is closed"):
        occluder.first_hits([[0, 0, 3]], [[0, 0, -1]])


def test_rational_truth_on_small_integers() -> None:
    """Every ray between lattice points through triangles with lattice corners, against exact arithmetic."""
    rng = np.random.default_rng(3)
    for _ in range(300):
        corners = rng.integers(-3, 4, (4, 3, 3))
        origin, direction = rng.integers(-4, 5, 3), rng.integers(-3, 4, 3)
        mesh = triangles(corners.astype(float))
        if not direction.any() or not mesh.areas.all():
            continue
        found = oracle.prepare(mesh).first_hits([origin.tolist()], [direction.tolist()])
        met = [meeting(origin.tolist(), direction.tolist(), face.tolist()) for face in corners]
        nearest = min((t for t in met if t is not None), default=None)
        if nearest is None:
            assert found.face_ids.item() == -1
        else:
            assert found.face_ids.item() == met.index(nearest)
            assert found.distances.item() == pytest.approx(float(nearest) * np.linalg.norm(direction), rel=1e-12)


def test_a_direction_may_have_any_length(prepare: Prepare) -> None:
    """Answers are those of a direction as long as usual, also beside such ones; 1e-320 has lost digits itself."""
    directions = np.array([[0.05, 0.2, -1.0], [0.0, 0.0, 1.0], [0.15, 0.1, -1.0]])
    with prepare(PLATES) as occluder:
        usual = occluder.first_hits([[0.1, 0.0, 1.0]], directions)
        np.testing.assert_allclose(usual.distances, [np.sqrt(1.0425), np.inf, np.sqrt(1.0325)], rtol=1e-12)
        for length in (1e-300, 1e-160, 1e-30, 1e30, 1e69):
            other = occluder.first_hits([[0.1, 0.0, 1.0]], directions * np.array([[length], [1.0], [length]]))
            np.testing.assert_array_equal(other.face_ids, usual.face_ids)
            np.testing.assert_allclose(other.distances, usual.distances, rtol=1e-6)
        along = occluder.first_hits([[0.1, 0.2, 1.0]], [[0.0, 0.0, -1e-320]])
        assert along.face_ids.tolist() == occluder.first_hits([[0.1, 0.2, 1.0]], [[0.0, 0.0, -1.0]]).face_ids.tolist()
        np.testing.assert_allclose(along.distances, 1.0, rtol=1e-6)
