"""First hits of `exact`: random scenes against rational arithmetic; what float32 leaves out cannot be hit."""

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.random_scenes import KINDS, wrong_rays_of
from tests.scenes import box
from zbuf_occlude.meshes.shapes import solids
from zbuf_occlude.visibility.methods.oracle import prepare as prepare_oracle


@pytest.mark.parametrize("index", range(3 * len(KINDS)))
def test_random_scenes(index: int) -> None:
    wrong, n = wrong_rays_of("exact", 7, index)
    assert n > 100
    assert wrong == 0


def test_far_origins() -> None:
    """Rays from up to 1e14 diagonals away, aimed at a box's corners and sides."""
    mesh = box((1.0, 2.0, 3.0))
    rng = np.random.default_rng(0)
    targets = np.concatenate([mesh.vertices, rng.uniform(-0.45, 0.45, (200, 3)) * [1, 2, 3]])
    away = rng.normal(size=targets.shape)
    for distance in (1e3, 1e5, 1e7, 1e10, 1e14):
        origins = targets + distance * away
        truth = prepare_oracle(mesh).first_hits(origins, -away)
        with zo.prepare(mesh, "exact") as occluder:
            found = occluder.first_hits(origins, -away)
        assert (found.face_ids == truth.face_ids).all()
        assert (found.distances == truth.distances).all()
        assert distance > 1e12 or (truth.face_ids[8:] >= 0).mean() > 0.9


@pytest.mark.parametrize(
    ("size", "away"), [(1.0, 2.0**60), (1.0, 2.0**151), (1.0, 2.0**180), (1.0, 2.0**229), (1e-46, 1.0), (1e-60, 1.0)]
)
def test_rays_through_the_middle_of_a_box_meet_it_from_any_distance(size: float, away: float) -> None:
    """Origins are exact multiples of the directions, among which are those with powers of two as components."""
    mesh = box((size, 2 * size, 3 * size))
    rng = np.random.default_rng(1)
    powers = rng.choice([-1.0, 1.0], (100, 3)) * 2.0 ** -rng.integers(0, 4, (100, 3))
    directions = np.concatenate([rng.integers(1, 1024, (300, 3)) / 1024, powers])
    truth = prepare_oracle(mesh).first_hits(-away * directions, directions)
    with zo.prepare(mesh, "exact") as occluder:
        found = occluder.first_hits(-away * directions, directions)
    assert (truth.face_ids >= 0).all()
    assert (found.face_ids == truth.face_ids).all()


@pytest.mark.parametrize(
    ("distance", "angle", "gaps", "is_one_origin"),
    [(9e4, 1e-8, (-8, -6), True), (1e8, 1e-7, (-5, -3), False), (1e9, 1e-6, (-5, -3), False)],
)
def test_a_wall_just_before_a_plate_that_a_far_ray_grazes(
    distance: float, angle: float, gaps: tuple[float, float], is_one_origin: bool
) -> None:
    """The distance of the plate errs by more than float32's margins; the wall must be searched all the same."""
    rng, n_wrong = np.random.default_rng(0), 0
    for _ in range(60):
        mesh, origin, direction = grazed_plate(distance, angle, 10.0 ** rng.uniform(*gaps), rng)
        origins = origin[None] if is_one_origin else origin + 1e-9 * rng.normal(size=(16, 3))
        directions = direction * rng.uniform(0.5, 2.0, (16, 1))
        truth = prepare_oracle(mesh).first_hits(origins, directions)
        with zo.prepare(mesh, "exact") as occluder:
            n_wrong += int((occluder.first_hits(origins, directions).face_ids != truth.face_ids).sum())
    assert n_wrong == 0


def grazed_plate(
    distance: float, angle: float, gap: float, rng: np.random.Generator
) -> tuple[zo.Mesh, np.ndarray, np.ndarray]:
    """Return a plate, a wall before a point of it, 15 more behind each, and a ray that grazes the plate there."""
    plate = np.array([[-1, -1, 0], [0.6, -1, 0], [0.6, 1, 0]]) + 0.01 * rng.normal(size=(3, 3))
    normal = np.cross(plate[1] - plate[0], plate[2] - plate[0])
    normal /= np.linalg.norm(normal)
    direction = np.array([1.0, 0.0, 0.0]) - normal * normal[0]
    direction /= np.linalg.norm(direction)
    direction -= normal * angle * rng.uniform(0.5, 2)
    direction /= np.linalg.norm(direction)
    point = np.array([0.06, 0.47, 0.47]) @ plate
    wall = 0.4 * np.array([[0, -1, -1], [0, 1, -1], [0, 0, 1.2]]) + point - gap * direction
    steps = np.arange(16)[:, None, None]
    corners = np.concatenate([plate - normal * 0.1 * steps / 16, wall + np.array([0.01, 0, 0]) * steps])
    return zo.Mesh(corners.reshape(-1, 3), np.arange(96).reshape(-1, 3)), point - distance * direction, direction


@pytest.mark.parametrize("width", [1e-3, 1e-5, 1e-6, 1e-7, 1e-9, 1e-12])
def test_slivers(width: float) -> None:
    """Rays of many origins through needles that float32 hardly tells from lines, and just past them."""
    rng = np.random.default_rng(int(-np.log10(width)))
    begins, alongs, acrosses = rng.normal(size=(3, 200, 3))
    corners = np.stack([begins, begins + alongs, begins + 0.5 * alongs + width * acrosses], axis=1)
    mesh = zo.Mesh(corners.reshape(-1, 3), np.arange(600).reshape(-1, 3))
    weights = rng.dirichlet([1, 1, 1], (10, 200))
    targets = np.einsum("kfc,fci->kfi", weights, corners)
    targets[5:] += 10.0 ** rng.uniform(-12, -4, (5, 200, 1)) * rng.normal(size=(5, 200, 3))
    targets = targets.reshape(-1, 3)
    origins = 3.0 * rng.normal(size=targets.shape)
    truth = prepare_oracle(mesh).first_hits(origins, targets - origins)
    with zo.prepare(mesh, "exact") as occluder:
        found = occluder.first_hits(origins, targets - origins)
    assert (truth.face_ids >= 0).sum() > 300
    assert (found.face_ids == truth.face_ids).all()
    assert (found.distances == truth.distances).all()


def test_many_rays_are_shared_out_among_threads() -> None:
    """More rays than a block, in an order that jumps about: each is answered for itself."""
    mesh = solids.icosphere(4)
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(5000, 3))
    with zo.prepare(mesh, "exact") as occluder:
        all_of_them = occluder.first_hits([[0.1, 0.2, 0.3]], directions)
        turned = occluder.first_hits([[0.1, 0.2, 0.3]], directions[::-1])
    assert (all_of_them.face_ids == turned.face_ids[::-1]).all()
    assert (all_of_them.distances == turned.distances[::-1]).all()
    assert (all_of_them.face_ids == prepare_oracle(mesh).first_hits([[0.1, 0.2, 0.3]], directions).face_ids).all()


@pytest.mark.parametrize("origin", [(0.1, 0.2, 0.3), (0.0, 5.0, 1.0)])
@pytest.mark.parametrize("level", [2, 5])  # with few rays per cluster, too, blocks are sorted as a whole
def test_any_order_of_rays_has_the_same_answers(origin: tuple[float, float, float], level: int) -> None:
    """A sensor's columns, its rows, and no order: several blocks of each, some of whose rays miss or change frames."""
    mesh = solids.icosphere(level)
    heights, turns = np.radians(np.linspace(-80, 80, 90)), np.radians(np.linspace(-180, 180, 120))
    columns = np.stack(
        [
            np.cos(heights) * np.cos(turns)[:, None],
            np.cos(heights) * np.sin(turns)[:, None],
            np.sin(heights) + 0 * turns[:, None],
        ],
        axis=-1,
    ).reshape(-1, 3)
    assert len(columns) > 2 * 4096
    rng = np.random.default_rng(3)
    orders = [rng.permutation(len(columns)), np.arange(len(columns)).reshape(120, 90).T.reshape(-1)]
    with zo.prepare(mesh, "exact") as occluder:
        found = occluder.first_hits([origin], columns)
        for order in orders:
            turned = occluder.first_hits([origin], columns[order])
            assert (turned.face_ids == found.face_ids[order]).all()
            assert (turned.distances == found.distances[order]).all()
    some = rng.choice(len(columns), 500)
    truth = prepare_oracle(mesh).first_hits([origin], columns[some])
    assert (truth.face_ids == found.face_ids[some]).all()
    assert np.allclose(truth.distances, found.distances[some], rtol=1e-12)


@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (0.0, 0.0, 1.2), (3.0, 1.0, 2.0), (300.0, 1.0, 2.0)])
def test_rays_of_one_origin(origin: tuple[float, float, float]) -> None:
    """From inside, where a cube's frames meet too, and from outside; directions of sizes that float32 does not know."""
    mesh = solids.icosphere(3)
    rng = np.random.default_rng(2)
    directions = np.concatenate([rng.uniform(-1.0, 1.0, (400, 3)) - origin, rng.integers(-1, 2, (100, 3))])
    directions = directions[directions.any(axis=1)]
    directions *= 10.0 ** rng.choice([0.0, 0.0, -60.0, 60.0, -120.0, 65.0], (len(directions), 1))
    oracle, begin = prepare_oracle(mesh), np.array([origin])
    with zo.prepare(mesh, "exact") as occluder:
        found, truth = occluder.first_hits(begin, directions), oracle.first_hits(begin, directions)
    assert (found.face_ids == truth.face_ids).all()
    assert (found.distances == truth.distances).all()
    assert (found.face_ids >= 0).mean() > 0.5


@pytest.mark.parametrize("bad", [0.0, np.nan, np.inf, 1e71])
@pytest.mark.parametrize("scattered", [False, True])
def test_a_bad_direction_among_many(bad: float, scattered: bool) -> None:
    """Whichever block of rays it is in, and whether or not they are sorted first, it is told."""
    angles = np.linspace(0.0, 6.0, 20_000)
    directions = np.stack([np.cos(angles), np.sin(angles), 0.1 * np.cos(40.0 * angles)], axis=1)
    if scattered:
        directions = np.random.default_rng(4).permutation(directions)
    directions[7000] = bad
    told = pytest.raises(zo.ArgumentError, match=r"^directions must .* row 7000 is ")
    with zo.prepare(solids.icosphere(2), "exact") as occluder, told:
        occluder.first_hits([[0.1, 0.2, 0.3]], directions)


def test_an_eye_beside_a_corner_of_a_face_and_almost_in_its_plane() -> None:
    """float32 knows neither the side of the face that the eye is on, nor, so near, where the face's edges are."""
    corners = np.array([[-1.0, -1.0, -1.0], [1.0, -1.0, 0.3], [1.0, 1.0, 1.0]])
    mesh, corner, rng = zo.Mesh(corners, [[0, 1, 2]]), corners[1], np.random.default_rng(0)
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    normal /= np.linalg.norm(normal)
    eyes = corner + 10.0 ** rng.uniform(-5, -3, (60, 1)) * rng.normal(size=(60, 3))
    eyes += (10.0 ** rng.uniform(-9, -7, 60) - (eyes - corner) @ normal)[:, None] * normal
    eyes[0] = 1.0000449, -0.9999097, 0.3000609
    for eye in eyes:
        targets = corner + 1e-3 * (rng.dirichlet([1, 1, 1], 500) @ corners - corner)
        points = zo.SurfacePoints.free(eye + 1.5 * (targets - eye))
        with zo.prepare(mesh, "exact", warn=False) as occluder, prepare_oracle(mesh) as oracle:
            rays = eye[None], targets - eye
            assert (occluder.first_hits(*rays).face_ids == oracle.first_hits(*rays).face_ids).all()
            assert (occluder.visible(points, eye[None]) == oracle.visible(points, eye[None])).all()


def test_a_mesh_of_no_face_that_blocks() -> None:
    line = zo.Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]])
    with zo.prepare(line, "exact") as occluder:
        assert occluder.first_hits([[1, 0, 1]], [[0, 0, -1]]).face_ids.tolist() == [-1]
