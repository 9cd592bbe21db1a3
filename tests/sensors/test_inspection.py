"""What sensors can inspect, held to closed forms and counted rays; the order of views, held to all subsets of them."""

from itertools import combinations
from typing import Any

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.random_scenes import bodies
from tests.scenes import SQUARE, box, sphere, stacked
from zbuf_occlude.base.arrays import BoolArray
from zbuf_occlude.sensors import NoiseModel, Sensor
from zbuf_occlude.sensors.scenes import Placed, Scene, moved

CENTRED = SQUARE - [0.5, 0.5, 0.0]
PLATE = stacked(4.0 * CENTRED)
"""A square of side 4 at z = 0."""
BALL = sphere(96)
WIDE = {"width": 400, "height": 400, "fov": 170.0}
ABOVE = [0.0, 0.0, 1.0]
AWAY = 3.0
"""Distance of the eye from the middle of the ball."""
GUARANTEED = 1.0 - np.exp(-1.0)


def camera(pattern: dict[str, Any] = WIDE, **limits: Any) -> Sensor:
    return Sensor("camera", "pinhole", pattern, NoiseModel(**limits))


def share_of_plate(eye: list[float], sensor: Sensor, **options: Any) -> Any:
    found = zo.coverage(PLATE, eye, sensor=sensor, **options)
    return pytest.approx(found.alone[0], abs=4 * found.standard_error[0] + 1e-12)


@pytest.mark.parametrize(
    ("eye", "sensor", "area"),
    [
        ([0, 0, 2], camera({"width": 90, "height": 90, "fov": 60.0}), (4 * np.tan(np.pi / 6)) ** 2),
        ([0, 0, 2], camera({"width": 90, "height": 30, "fov": 60.0}), (4 * np.tan(np.pi / 6)) ** 2 / 3),
        (ABOVE, camera(), 16.0),
        (ABOVE, camera(range_max=2**0.5), np.pi),
        (ABOVE, camera(range_min=1.25**0.5), 16 - np.pi / 4),
        (ABOVE, camera(range_max=1.1, axial=True), 16.0),
        (ABOVE, camera(range_max=0.9, axial=True), 0.0),
        (ABOVE, camera(incidence_max=45.0), np.pi),
        (ABOVE, camera(incidence_max=45.0, noise=0.0), 16.0),
        (
            ABOVE,
            camera({"width": 90, "height": 90, "fov": 90.0}, baseline=(0.0, -0.5, 0.0)),
            2.0 * 1.5,
        ),
        (ABOVE, camera({"width": 90, "height": 90, "fov": 90.0}, baseline=(0.0, -0.5, 0.0), range_max=0.9), 0.0),
    ],
    ids=[
        *("field of view", "its height", "all", "range", "near range", "depth", "too deep", "incidence"),
        *("no limit of incidence without noise", "two images", "two images too deep"),
    ],
)
def test_share_of_a_plate_within_each_limit(eye: list[float], sensor: Sensor, area: float) -> None:
    assert share_of_plate(eye, sensor) == area / 16.0


def cap(angle: float) -> float:
    """Share of a sphere within an angle of a point of it."""
    return float((1.0 - np.cos(angle)) / 2.0)


STEEP = np.radians(40.0)


@pytest.mark.parametrize(
    ("limits", "share"),
    [
        ({}, cap(np.arccos(1.0 / AWAY))),
        ({"incidence_max": 40.0}, cap(STEEP - np.arcsin(np.sin(STEEP) / AWAY))),
        ({"range_max": 2.2}, cap(np.arccos((1 + AWAY**2 - 2.2**2) / (2 * AWAY)))),
        ({"range_min": 2.2, "axial": True}, cap(np.arccos(1.0 / AWAY)) - cap(np.arccos(AWAY - 2.2))),
    ],
)
def test_share_of_a_ball_within_each_limit(limits: dict[str, Any], share: float) -> None:
    found = zo.coverage(BALL, [AWAY, 0.0, 0.0], sensor=camera({"width": 90, "height": 90, "fov": 90.0}, **limits))
    assert found.alone[0] == pytest.approx(share, abs=4 * found.standard_error[0] + 0.002)


@pytest.mark.parametrize(
    ("kind", "pattern"),
    [
        ("pinhole", {"width": 600, "height": 600, "fov": 90.0}),
        ("spinning", {"lasers": np.linspace(-40, 40, 161), "columns": 600, "azimuths": (-60.0, 60.0)}),
        ("linear", {"columns": 500, "spacing": 0.01, "rows": 300, "slopes": (-1.0, 1.0)}),
    ],
)
def test_density_of_rays_is_what_a_scan_counts(kind: str, pattern: dict[str, Any]) -> None:
    """On patches of a plate that is inclined in two ways, each with some 600 returns."""
    sensor = Sensor("dense", kind, pattern)
    corners = np.array([[3.0, -1.5, -1.5], [2.4, 1.5, -1.5], [3.2, 1.5, 1.5], [3.8, -1.5, 1.5]])
    plate = stacked(corners)
    found = zo.scan(plate, sensor)
    along, up = corners[1] - corners[0], corners[3] - corners[0]
    place = (found.points - corners[0]) @ np.linalg.inv([along, up, np.cross(along, up)])
    within = (place[:, :2] > 0.1).all(axis=1) & (place[:, :2] < 0.9).all(axis=1)
    patch = np.floor((place[within, :2] - 0.1) / 0.2).astype(int) @ [4, 1]
    counts, area = np.bincount(patch, minlength=16), plate.areas.sum() * 0.04
    densities = sensor.ray_density(found.points[within]) * np.cos(found.incidences[within])
    expected = area / (np.bincount(patch, 1.0 / densities) / counts)  # the mean of the area per ray
    assert counts == pytest.approx(expected, rel=0.06)
    assert counts.sum() == pytest.approx(expected.sum(), rel=0.01)


def test_only_what_is_dense_enough_counts() -> None:
    sensor = camera({"width": 100, "height": 100, "fov": 170.0})
    f = float(sensor.intrinsics[0, 0])
    for density, share in ((f**2 * 0.99, 1.0), (f**2 * 1.01, 0.0)):
        assert share_of_plate(ABOVE, sensor, min_density=density) == share
    turning = Sensor("turning", "spinning", {"lasers": np.linspace(-89, 89, 179), "columns": 360})
    limit = 1.0 / np.radians(1.0) ** 2 / np.cos(np.radians(30.0)) / 4.0  # the plate is upright at x = 1, 30 degrees up
    wall = zo.Mesh(PLATE.vertices[:, [2, 0, 1]] + [1, 0, 0], PLATE.faces)
    fraction = zo.visible_faces(wall, [0, 0, 0], sensor=turning, min_density=limit).fraction
    assert 0.0 < fraction.min() < fraction.max() < 1.0


def test_rosette_and_part_of_a_revolution_have_a_field_of_view() -> None:
    directions = np.radians([0.0, 10.0, 50.0])
    points = 7.0 * np.stack([np.cos(directions), np.sin(directions), 0.0 * directions], axis=1)
    assert zo.sensors.make("mid-40").covers(points).tolist() == [True, True, False], "38.4 degrees wide"
    narrow = zo.sensors.make("vlp-16", azimuths=(-20.0, 20.0))
    assert narrow.covers(points).tolist() == [True, True, False]
    behind = zo.sensors.make("vlp-16", azimuths=(150.0, 210.0))
    assert behind.covers(-points).tolist() == [True, True, False]


def scene(clamp: zo.Mesh) -> Scene:
    return Scene.joined([Placed(PLATE, "part"), Placed(clamp, "clamp")])


HALF = stacked(2.0 * CENTRED * [0.5, 1.0, 1.0] + [-0.5, 0.0, 1.0])
"""A plate that hides the half x < 0 of `PLATE` from an eye at z = 2."""


@pytest.mark.parametrize("sensor", [None, camera()])
def test_a_clamp_hides_half_of_the_part(sensor: Sensor | None) -> None:
    held, eye = scene(HALF), [0.0, 0.0, 2.0]
    found = zo.coverage(held, eye, sensor=sensor)
    assert found.alone[0] == pytest.approx(0.5, abs=4 * found.standard_error[0])
    faces = zo.visible_faces(held, eye, sensor=sensor)
    assert faces.fraction[0] == pytest.approx([0.75, 0.25], abs=0.01)


def test_a_line_scanner_looks_from_beside_each_point() -> None:
    """A plate half-way down hides what is right below it, where one eye in the middle would see twice as far."""
    scanner = Sensor("line", "linear", {"columns": 101, "spacing": 0.01, "rows": 9, "slopes": (-0.5, 0.5)})
    beyond = scene(stacked(2.0 * CENTRED + [1.25, 0.0, 0.5]))
    found = zo.coverage(beyond, ABOVE, sensor=scanner)
    assert found.alone[0] == pytest.approx((0.505 + 0.25) * 1.0 / 16.0, abs=4 * found.standard_error[0])
    whole = zo.coverage(PLATE, ABOVE, sensor=scanner)
    assert whole.alone[0] == pytest.approx(1.01 / 16.0, abs=4 * whole.standard_error[0])


@pytest.mark.parametrize("baseline", [0.0, (0.0, -0.4, 0.1)])
def test_faces_that_are_seen_are_those_that_a_scan_meets(baseline: Any) -> None:
    limits = {"baseline": baseline, "incidence_max": 65.0, "range_max": 2.6, "axial": True}
    sensor = camera({"width": 500, "height": 400, "fov": 40.0}, **limits)
    held = Scene.joined([Placed(sphere(8), "ball"), Placed(box((0.2, 0.9, 0.3)), "clamp", moved(to=(1.5, 0.2, 0.3)))])
    found = zo.scan(held, sensor, zo.sensors.look_at([AWAY, 0.1, 0.2], [0.0, 0.0, 0.0]))
    n_faces = len(held.placed[0].mesh.faces)
    met = np.bincount(found.face_ids[found.instances == 0], minlength=n_faces) > 0
    seen = zo.visible_faces(held, [AWAY, 0.1, 0.2], sensor=sensor, points_per_face=400).fraction[0]
    assert seen.shape == (n_faces,)
    assert met[seen > 0.02].all()
    assert not met[seen == 0.0].any()
    assert 10 < met.sum() < n_faces / 2


def test_faces_of_a_target_are_cut_and_found_wherever_they_are_in_the_scene() -> None:
    held, eye = scene(HALF), [0.0, 0.0, 2.0]
    assert zo.visible_faces(held, eye, exactly=True).fraction[0] == pytest.approx([0.75, 0.25], rel=1e-9)
    turned = Scene(zo.Mesh(held.mesh.vertices, held.mesh.faces[::-1]), held.instances[::-1], held.labels, held.albedos)
    assert zo.visible_faces(turned, eye, exactly=True).fraction[0] == pytest.approx([0.25, 0.75], rel=1e-9)
    assert zo.coverage(turned, eye).alone[0] == pytest.approx(0.5, abs=0.02)


def test_glass_of_a_scene_hides_nothing() -> None:
    held, eye = scene(HALF), [0.0, 0.0, 2.0]
    glass = Scene(held.mesh, held.instances, held.labels, held.albedos, transmittance=0.9 * held.instances)
    assert zo.coverage(glass, eye).alone[0] == 1.0
    with pytest.raises(zo.ArgumentError, match="exactly must"):
        zo.visible_faces(glass, eye, exactly=True)


def best_of_all(seen: BoolArray) -> list[float]:
    """The largest share that any 1, 2, ... of some views (k, n) see together."""
    numbers = range(len(seen))
    return [max(seen[list(some)].any(axis=0).mean() for some in combinations(numbers, n + 1)) for n in numbers]


def test_greedy_order_is_the_best_of_all_where_no_two_views_see_the_same() -> None:
    mesh = box((1.0, 2.0, 3.0))
    eyes = np.concatenate([np.eye(3), -np.eye(3)]) * 50.0
    found = zo.coverage(mesh, eyes, greedy=True, contact=0.0)
    with zo.prepare(mesh, "oracle", contact=0.0) as oracle:
        seen = oracle.visible(zo.sample_surface(mesh, n_points=20_000, seed=0), eyes)
    assert (seen.sum(axis=0) <= 1).all(), "no two see a point"
    assert found.together == pytest.approx(best_of_all(seen), abs=1e-12)
    assert found.gain == pytest.approx(found.alone)
    assert {*found.order[:2]} == {0, 3}, "the two largest sides"


@pytest.mark.parametrize("seed", range(6))
def test_greedy_order_is_within_its_bound_of_all_subsets(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mesh = bodies(rng)
    eyes = mesh.centre + mesh.longest_side * rng.normal(size=(8, 3)) * 1.5
    found = zo.coverage(mesh, eyes, greedy=True, n_points=2_000, seed=seed)
    with zo.prepare(mesh, "oracle") as oracle:
        seen = oracle.visible(zo.sample_surface(mesh, n_points=2_000, seed=seed), eyes)
    best = np.array(best_of_all(seen))
    assert sorted(found.order) == list(range(8))
    assert (found.together >= GUARANTEED * best).all()
    assert (found.together <= best).all()
    assert found.together[[0, -1]] == pytest.approx(best[[0, -1]]), "one view, and all of them"
    assert found.alone == pytest.approx(seen[found.order].mean(axis=1))
    assert found.gain == pytest.approx(np.diff(found.together, prepend=0.0))
    assert (np.diff(found.gain) <= 1e-12).all(), "each adds no more than the one before it"


def test_greedy_order_takes_the_largest_view_first_even_where_two_others_see_all() -> None:
    """Cameras of a file, by their fields of view: the upper half, the lower half, and 4/7 across both."""
    sides = np.array([[-2, 2, 0, 2], [-2, 2, -2, 0], [-8 / 7, 8 / 7, -2, 2]])
    cameras = zo.Views.from_cameras(np.tile(ABOVE, (3, 1)), np.tile(np.eye(3), (3, 1, 1)), sides)
    found = zo.coverage(PLATE, cameras, greedy=True)
    assert found.order[0] == 2
    assert found.alone == pytest.approx([4 / 7, 1 / 2, 1 / 2], abs=0.015)
    assert found.together == pytest.approx([4 / 7, 4 / 7 + 3 / 14, 1.0], abs=0.015)
    assert zo.coverage(PLATE, cameras).order.tolist() == [0, 1, 2]


def test_views_that_add_nothing_come_last_in_their_own_order() -> None:
    eyes = np.array([[0.0, 0.0, -5.0], [9.0, 9.0, 0.0], [0.0, 0.0, 5.0], [9.0, 0.0, 0.0]])
    limited = zo.coverage(PLATE, eyes, greedy=True)
    assert limited.order.tolist() == [0, 1, 2, 3]
    assert limited.gain[1:].tolist() == [0.0, 0.0, 0.0]
    assert len(zo.coverage(PLATE, np.empty((0, 3)), greedy=True, sensor=camera()).order) == 0


def test_sensors_take_the_poses_of_views() -> None:
    """A camera that looks past the plate sees none of it; one that is rolled by a right angle sees its height."""
    sensor = camera({"width": 90, "height": 30, "fov": 60.0})
    views = zo.views.from_angles(0.0, 90.0, 2.0).around(np.zeros(3), 1.0)
    assert zo.coverage(PLATE, views, sensor=sensor).alone[0] == pytest.approx(1 / 9, abs=0.01)
    assert zo.coverage(PLATE, views.looking([0.0, 0.0, 9.0]), sensor=sensor).alone[0] == 0.0


def test_what_cannot_be_asked_is_refused() -> None:
    for wrong, words in (
        ({"min_density": 5.0}, "min_density must go with a sensor"),
        ({"min_density": -1.0, "sensor": "vlp-16"}, "min_density must be"),
        ({"greedy": "yes"}, "greedy must be"),
    ):
        with pytest.raises(zo.ArgumentError, match=words):
            zo.coverage(PLATE, ABOVE, **wrong)  # type: ignore[arg-type]
    for function in (zo.coverage, zo.visible_faces):
        with pytest.raises(zo.ArgumentError, match="scene must be"):
            function(3, ABOVE)  # type: ignore[arg-type]
    with pytest.raises(zo.OptionError, match="evenly spaced"):
        zo.coverage(PLATE, ABOVE, sensor="mid-40", min_density=1.0)
    with pytest.raises(zo.OptionError, match="coverage must be given its own options"):
        zo.coverage(PLATE, ABOVE, sensr="mid-40")
    with pytest.raises(zo.ArgumentError, match="coincides"):
        zo.coverage(PLATE, [0.0, 0.0, 0.0], sensor=camera())
    with pytest.raises(zo.ArgumentError, match="exactly must"):
        zo.visible_faces(PLATE, ABOVE, sensor=camera(), exactly=True)
