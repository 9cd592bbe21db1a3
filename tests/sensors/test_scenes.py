"""Scenes: what is put around a target, how much of it others hide, what is kept; sizes; a user's JSON."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.cli.conftest import write_off
from tests.scenes import box
from zbuf_occlude.datasets.pipeline import scanned_scenes
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.meshes import shapes
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.meshes.sampling import sample_surface
from zbuf_occlude.sensors import make
from zbuf_occlude.sensors.capture import Capture, captures, in_metres, n_raised, sensor_views
from zbuf_occlude.sensors.scan_config import ScanConfig, span_of
from zbuf_occlude.sensors.scenes import KINDS, Placed, Scene, moved
from zbuf_occlude.sensors.scenes.contents import BELONGING, Pool, read_scene, surroundings
from zbuf_occlude.sensors.scenes.scene import ALBEDOS, TYPICAL_ALBEDO, draw_albedos
from zbuf_occlude.sensors.scenes.sizes import SIZES, Sizes, size_of, sizes_of
from zbuf_occlude.sensors.sensor import Sensor
from zbuf_occlude.views import Views

SHAPES = shapes.collection(n_members=2)
CAR = shapes.make("car", 1)


def seeds(what: str, view: int, *, seed: int = 0) -> np.random.SeedSequence:
    return np.random.SeedSequence([seed, *what.encode(), view])


def scan_config(sensor: str = "vlp-32c", **given: Any) -> ScanConfig:
    return ScanConfig(make(sensor), method="embree", **given)


def scans(asked: ScanConfig, views: Views, mesh: zo.Mesh = CAR, label: str = "car", seed: int = 0) -> list[Capture]:
    standing, size = in_metres(mesh, label, asked)
    floor, drawn = float(standing.bounds[0, 2]), partial(seeds, seed=seed)
    places = sensor_views(views, size, floor, asked, drawn)
    pool = Pool(SHAPES, asked.size, asked.scene, np.random.SeedSequence(1))
    return list(captures(standing, asked, places, floor, drawn, pool))


def ring(n: int, distance: float = 4.0) -> Views:
    return zo.views.ring(n, elevation=0, distance=distance)


def test_a_yaw_is_in_degrees() -> None:
    assert moved(yaw=90.0, scale=2.0, to=(5, 0, 1))[:3] == pytest.approx(
        np.array([[0, -2, 0, 5], [2, 0, 0, 0], [0, 0, 2, 1]]), abs=1e-12
    )


def test_joined_keeps_whose_face_is_whose() -> None:
    scene = Scene.joined([Placed(box(), "a"), Placed(CAR, "b", moved(scale=0.1, yaw=60.0, to=(5, 0, 0)), 0.5)])
    assert (scene.instances[:12] == 0).all()
    assert (scene.instances[12:] == 1).all()
    assert len(scene.mesh.faces) == 12 + len(CAR.faces)
    low, high = scene.mesh.vertices[8:].min(axis=0), scene.mesh.vertices[8:].max(axis=0)
    assert np.allclose(((low + high) / 2)[0], 5.0 + 0.1 * CAR.centre[0], atol=1.0)
    some = Scene.joined([Placed(box(), "a"), Placed(CAR, "b")], np.array([False, True]))
    assert set(some.instances.tolist()) == {1}
    with pytest.raises(zo.ArgumentError, match="a scene must have at least one mesh"):
        Scene.joined([])
    with pytest.raises(zo.ArgumentError, match=r"pose of a must be \(4, 4\), finite"):
        Placed(box(), "a", np.zeros((4, 4)))


@pytest.mark.parametrize("scene", ["none", "file", "ground", "street", "room", "table"])
@pytest.mark.parametrize("sensor", ["kinect-v1", "realsense-d435", "cyberware-3030"])
def test_cameras_stand_where_their_views_say(sensor: str, scene: str) -> None:
    views = zo.views.parse("grid:3x10@15..75")
    asked = scan_config(sensor, scene=scene, range=(0.4, 0.4))
    places = sensor_views(views, 0.3, -0.15, asked, seeds)
    assert np.allclose(places.eyes, 0.4 / 4.0 * views.eyes)
    standing = box((0.3, 0.3, 0.3))
    for view in (0, 29):  # an elevation of 75 degrees, too: nothing stands between it and the target
        (capture,) = captures(standing, asked, places[[view]], -0.15, seeds, Pool((), {}, scene, seeds("pool", 0)))
        axis = capture.pose[:3, 0]
        assert np.allclose(capture.pose[:3, 3], places.eyes[view])
        assert np.allclose(axis, -places.eyes[view] / 0.4)  # it looks at the target's middle


@pytest.mark.parametrize("sensor", ["vlp-16", "mid-40"])
def test_lidars_are_mounted_above_the_ground(sensor: str) -> None:
    views = zo.views.parse("grid:3x10@15..75")
    for height in (None, 2.5):
        places = sensor_views(
            views, 0.3, -0.15, scan_config(sensor, scene="ground", range=(5, 5), sensor_height=height), seeds
        )
        assert np.allclose(places.eyes[:, 2], (height or 1.73) - 0.15)
        assert np.allclose(np.linalg.norm(places.eyes[:, :2], axis=1), 5.0)


def test_cameras_below_the_ground_stand_on_it() -> None:
    views, asked = zo.views.parse("grid:4x2@-60..0"), scan_config("kinect-v1", scene="room", range=(2.0, 2.0))
    places = sensor_views(views, 1.0, -0.5, asked, seeds)
    wanted = 2.0 * np.sin(views.elevation)
    assert np.allclose(places.eyes[:, 2], np.maximum(wanted, -0.49))
    assert np.allclose(np.linalg.norm(places.eyes, axis=1), 2.0)
    assert n_raised(views, places, asked) == (wanted < -0.49).sum() == 6
    assert (
        n_raised(views, sensor_views(views, 1.0, -0.5, scan_config(scene="room"), seeds), scan_config(scene="room"))
        == 0
    )


def test_albedos_are_drawn_of_objects_that_have_none() -> None:
    drawn = draw_albedos(np.random.default_rng(0), 20_000)
    assert (drawn >= ALBEDOS[0]).all()
    assert (drawn <= ALBEDOS[1]).all()
    quarters = np.quantile(np.log(drawn / ALBEDOS[0]) / np.log(ALBEDOS[1] / ALBEDOS[0]), [0.25, 0.5, 0.75])
    assert quarters == pytest.approx([0.25, 0.5, 0.75], abs=0.01)
    placed = [Placed(box(), "a"), Placed(box(), "b", albedo=0.5), Placed(box(), "c")]
    assert Scene.joined(placed).albedos.tolist() == [TYPICAL_ALBEDO, 0.5, TYPICAL_ALBEDO]
    assert Scene.from_mesh(box()).albedos.tolist() == [TYPICAL_ALBEDO]
    assert np.median(drawn) == pytest.approx(TYPICAL_ALBEDO, rel=0.05)
    first, second = (Scene.joined(placed, rng=np.random.default_rng(seed)).albedos for seed in (3, 4))
    assert first[1] == second[1] == 0.5
    assert len({first[0], first[2], second[0], second[2]}) == 4
    some = Scene.joined(placed, np.array([True, False, True]), np.random.default_rng(3)).albedos
    assert some.tolist() == first.tolist()  # what is left out changes nobody's


def test_returns_over_all_paints() -> None:
    """Of a plate across the line of sight: exp(-(range / reach)^2 / albedo), its mean over albedos of every factor."""
    plate = zo.Mesh([[0, -1, -1], [0, 1, -1], [0, 1, 1], [0, -1, 1]], [[0, 1, 2], [0, 2, 3]])
    camera = make("pinhole:width=20,height=20,fov=2", axial=False, detection_range=40.0)
    asked = ScanConfig(camera, range=(20.0, 20.0), size={"plate": 2.0}, method="exact")
    n_draws = 300
    found = [len(scans(asked, ring(1), plate, "plate", seed=seed)[0].scan) / 400 for seed in range(n_draws)]
    factors = (np.arange(10_000) + 0.5) / 10_000
    shares = np.exp(-0.25 / (ALBEDOS[0] * (ALBEDOS[1] / ALBEDOS[0]) ** factors))
    assert np.mean(found) == pytest.approx(shares.mean(), abs=3 * shares.std() / np.sqrt(n_draws))
    assert np.quantile(found, [0.1, 0.9]) == pytest.approx(np.quantile(shares, [0.1, 0.9]), abs=0.08)


def test_a_capture_is_the_scan_of_its_scene() -> None:
    """What generate and the loops' transform keep is what `zo.scan` gives of the same scene, place and seed."""
    for capture in scans(scan_config(scene="street", range=(8.0, 30.0), keep="all"), ring(2)):
        view = int(capture.scan.origin[0] < 0.0)
        again = zo.scan(capture.scene, make("vlp-32c"), capture.pose, seed=seeds("scan", view), method="embree")
        assert len(again) > 1000
        for name in ("positions", "intensities", "rings", "columns", "instances"):
            assert getattr(again, name).tobytes() == getattr(capture.scan, name).tobytes()


@pytest.mark.parametrize("kind", [kind.name for kind in KINDS])
def test_every_kind_of_scene(kind: str) -> None:
    asked = scan_config(range=(12.0, 12.0) if kind != "room" else (4.0, 4.0), scene=kind, keep="all")
    (capture,) = scans(asked, ring(1))
    labels = set(capture.scene.labels)
    assert capture.scene.labels[0] == "target"
    expected = {"street": {"ground", "pole", "wall"}, "table": {"ground", "table"}, "none": set()}
    assert expected.get(kind, {kind}) <= labels
    if kind == "street":
        assert len(labels & set(shapes.CLASSES)) >= 3
        assert len(capture.scene.labels) > 15
    assert (capture.scan.instances == 0).any()
    height = capture.pose[2, 3] - CAR.bounds[0, 2] * 4.5 / CAR.longest_side
    if asked.height is not None:
        below = 0.0 if asked.table is None else asked.table["height"]
        assert (
            abs(capture.pose[2, 3] + below - (asked.height - 4.5 / CAR.longest_side * np.ptp(CAR.bounds[:, 2]) / 2))
            < 1e-9
        )
        assert np.allclose(capture.pose[:3, 2], [0, 0, 1])  # level
    else:
        assert height > 0


@pytest.mark.parametrize(
    ("kind", "share"),
    [("street", (0.0, 0.0)), ("street", (0.3, 0.6)), ("street", (0.5, 0.5)), ("room", (0.3, 0.6))],
)
def test_hidden_means_what_it_says(kind: str, share: tuple[float, float]) -> None:
    """Measured anew by the oracle on other points: within 2 percent of what the capture says, which is as asked."""
    asked = scan_config(range=(14.0, 14.0) if kind == "street" else (5.0, 5.0), scene=kind, hidden=share, keep="all")
    reached = 0
    for capture in scans(asked, ring(4)):
        mesh = capture.scene.mesh
        own = np.flatnonzero(capture.scene.instances == 0)
        alone = zo.Mesh(mesh.vertices, mesh.faces[own])
        points, eye = sample_surface(alone, n_points=20_000, seed=9), capture.pose[None, :3, 3]
        with zo.prepare(alone, "embree") as one, zo.prepare(mesh, "embree") as whole:
            showing = points.select(one.visible(points, eye)[0])
            hidden = 1.0 - whole.visible(showing, eye).mean()
        assert hidden == pytest.approx(capture.hidden, abs=0.02)
        if capture.reached:
            reached += 1
            assert share[0] - 0.02 <= capture.hidden <= share[1] + 0.02
    assert reached >= 3


def test_what_is_left_out_of_a_scene_changes_no_point_of_the_target() -> None:
    """`keep=target` casts rays towards the target only, past objects near them only; `all` casts every ray."""
    given = {"range": (14.0, 14.0), "scene": "street", "hidden": (0.3, 0.3)}
    few = scans(ScanConfig(make("vlp-32c", noise=0), method="embree", **given), ring(2))  # type: ignore[arg-type]
    every = scans(ScanConfig(make("vlp-32c", noise=0), method="embree", keep="all", **given), ring(2))  # type: ignore[arg-type]
    for one, other in zip(few, every, strict=True):
        mine = other.scan.select(other.scan.instances == 0)
        assert len(one.scan) == len(mine) > 50
        assert np.allclose(one.scan.positions, mine.positions, atol=1e-6)
        assert len(one.scene.mesh.faces) < len(other.scene.mesh.faces)


def test_keep_box() -> None:
    on_ground = {"range": (8.0, 8.0), "scene": "ground"}
    (target,), (boxed,), (every,) = (
        scans(scan_config(keep=keep, **on_ground), ring(1)) for keep in ("target", "box", "all")
    )
    assert (target.scan.instances == 0).all()
    assert 0 < (boxed.scan.instances != 0).sum() < (every.scan.instances != 0).sum()  # some ground
    half = 1.1 * np.ptp(CAR.bounds, axis=0) * 4.5 / CAR.longest_side / 2
    assert (np.abs(boxed.scan.positions) <= half + 1e-9).all()
    disturbed = [
        scans(scan_config(keep="box:shift=.5,rotate,scale", **on_ground), ring(1), seed=s)[0] for s in range(4)
    ]
    counts = {len(capture.scan) for capture in disturbed}
    assert len(counts) == 4
    assert any((np.abs(capture.scan.positions) > half).any() for capture in disturbed)


def test_sizes() -> None:
    assert size_of("car", {}, 123.0) == 4.5
    assert size_of("Night Stand", {}, 1.0) == 0.6
    assert size_of("car", sizes_of("car=3.9,chair=1"), 1.0) == 3.9
    assert size_of("gizmo", sizes_of("2.5"), 1.0) == 2.5
    assert size_of("gizmo", sizes_of("file"), 7.0) == 7.0
    mesh, size = in_metres(CAR, "car", scan_config())
    assert size == mesh.longest_side == pytest.approx(4.5)
    assert np.allclose(mesh.centre, 0.0)
    with pytest.raises(zo.OptionError, match=r"every class must have a size in metres; 'gizmo' has none\. Give --size"):
        size_of("gizmo", {}, 1.0)
    for wrong in ("car=", "car=-1", "=3", "car=x", "0", "nan"):
        with pytest.raises(zo.OptionError, match=r"--size must be 'file', metres from 0\.001 to 100000, or CLASS="):
            sizes_of(wrong)


def test_a_scene_of_a_file(tmp_path: Path) -> None:
    crate = box()
    write_off(tmp_path / "crate.off", crate.vertices, crate.faces)
    path = tmp_path / "scene.json"
    objects = [
        {"mesh": "crate.off", "class": "crate", "position": [0, 6, 0], "size": 2, "yaw": 30, "albedo": 0.9},
        {"class": "truck", "position": [-20, 0, 0]},
    ]
    path.write_text(json.dumps({"objects": objects}))
    asked = scan_config(scene="file", **read_scene(path), range=(10.0, 10.0), keep="all")
    (capture,) = scans(asked, ring(1))
    assert capture.scene.labels == ("target", "ground", "crate", "truck")
    truck = capture.scene.mesh.corners[capture.scene.instances == 3].reshape(-1, 3)
    assert np.allclose(np.ptp(truck, axis=0), [2.5, 8.0, 3.2])  # built-in: in metres, without a file
    assert capture.scene.albedos[2] == 0.9
    assert (capture.scene.albedos[:2] < 0.9).all()
    crate_points = capture.scan.positions[capture.scan.instances == 2]
    assert len(crate_points) > 20
    assert np.linalg.norm(crate_points[:, :2] - [0, 6], axis=1).max() < 1.5
    floor = CAR.bounds[0, 2] - CAR.centre[2]
    assert crate_points[:, 2].min() > floor * 4.5 / CAR.longest_side - 0.1


PLACED = '{"objects": [{"mesh": "a.off", "position": [0, 0, %s}]}'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "must be JSON"),
        ("[" * 100_000, "must be JSON"),
        ("[]", "no list of objects"),
        ('{"objects": [{"mesh": "a.off"}]}', "object 0: .*has no mesh or position"),
        ('{"objects": [{"class": "tank", "position": [0, 0, 0]}]}', "mesh, unless its class is pedestrian, .*truck"),
        (PLACED % '0], "colour": 1', "object 0: .*; got 'colour'"),
        (PLACED % "]", r"must be JSON"),
        (PLACED % "0, 0]", r"object 0: position must be 3 numbers.*; got \[0, 0, 0, 0\]"),
        (PLACED % '0], "size": 0', "size must be a number, from .*; got 0"),
        (PLACED % "0]", "must name a file; .*a.off' does not exist"),
        ('{"objects": [], "tabel": {}}', "one of objects, table, ground; got 'tabel'"),
        ('{"table": {"size": 2}}', r"size of a table must be 2 numbers, from 0.01 to 100 metres; got 2"),
        ('{"table": "oak"}', "a table must be given as"),
        ('{"objects": [], "ground": 3}', "ground must be true or false"),
        (PLACED % '0], "unit": "mm", "size": 2', "one of unit and size"),
        (PLACED % '0], "count": 2', "one of count and position"),
        (PLACED % '0], "count": 2, "unit": "mm"', "one of count and position"),
        ('{"table": {}, "objects": [{"mesh": "a.off", "yaw": 20}]}', "object 0: .*yaw must have a position"),
        (PLACED % '0], "count": 0', "count must be a whole number, from 1 to 100; got 0"),
    ],
)
def test_a_wrong_scene_file(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "scene.json").write_text(text)
    with pytest.raises(zo.OptionError, match=words):
        read_scene(tmp_path / "scene.json")


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"range": (0.0, 5.0)}, r"--range must be metres above 0.*; got 0\.\.5"),
        ({"range": (9.0, 5.0)}, r"got 9\.\.5"),
        ({"scene": "forest"}, "one of none, ground, street, room, table; got 'forest'"),
        ({"hidden": (0.1, 0.2)}, "can hide: street, room; got --scene none"),
        ({"scene": "street", "hidden": (0.5, 1.5)}, r"within 0\.\.0\.9; got 0\.5\.\.1\.5"),
        ({"keep": "most"}, "one of target, box, all; got 'most'"),
        ({"keep": "box:twist"}, "got 'box:twist'"),
        ({"sensor_height": 2.0}, r"--scene none lacks; got 2\.0"),
        ({"sensor": "kinect-v1", "scene": "room", "sensor_height": 1.5}, "is for a LiDAR .* kinect-v1 is a camera"),
    ],
)
def test_what_a_setup_refuses(given: dict[str, Any], words: str) -> None:
    with pytest.raises(zo.OptionError, match=words):
        scan_config(**given)


def test_a_range_within_the_object() -> None:
    with pytest.raises(zo.MeshError, match=r"the range must be more than half the object's 4\.5 m; it is 2 m\."):
        scans(scan_config(range=(2.0, 2.0)), ring(1))
    assert span_of("--range", "5..50") == (5.0, 50.0)
    assert span_of("--range", "7") == (7.0, 7.0)
    with pytest.raises(zo.OptionError, match=r"--range must be a number, or two as A\.\.B; got 'near'\."):
        span_of("--range", "near")


def test_a_sensor_goes_through_a_plan_and_back() -> None:
    for name in zo.sensors.SENSORS:
        document = json.loads(json.dumps(make(name).to_dict()))
        back = Sensor.from_dict(document)
        assert back.rays().directions.tobytes() == make(name).rays().directions.tobytes()
        assert back.to_dict() == document


def test_a_pool_has_what_it_is_given_and_else_what_is_built_in() -> None:
    labels = {Pool(MeshCollection([]), {}, "street", np.random.SeedSequence(0))(x)[1] for x in np.linspace(0, 0.99, 20)}
    assert labels == {"car", "pedestrian", "bicycle", "motorcycle"}
    mesh, label = Pool(SHAPES, {}, "street", np.random.SeedSequence(0))(0.99)
    assert label in shapes.CLASSES
    assert label != "airplane"  # longer than what goes into a street
    assert abs(mesh.bounds[0, 2]) < 1e-9


@pytest.mark.parametrize(
    ("scene", "belonging", "strange"),
    [
        ("street", {"car", "pedestrian", "bicycle", "motorcycle"}, {"bottle", "chair", "lamp"}),
        ("room", {"bed", "bookshelf", "chair", "lamp", "table"}, {"airplane", "car", "bottle"}),
    ],
)
def test_streets_have_road_users_and_rooms_furniture(scene: str, belonging: set[str], strange: set[str]) -> None:
    """Of a collection of all classes, and of one of classes that do not belong there."""
    for entries in (SHAPES, [entry for entry in SHAPES if entry.label in strange]):
        pool = Pool(surroundings(entries, scene), {}, scene, np.random.SeedSequence(3))
        assert {pool(x)[1] for x in np.linspace(0.0, 0.999, 60)} == belonging


@pytest.mark.parametrize(("scene", "distance"), [("street", 8.0), ("room", 2.0)])
def test_a_plan_s_scenes_are_as_large_as_they_are_in_the_world(scene: str, distance: float) -> None:
    """As `generate --scene room --size 0.5` makes them, of all the built-in classes: what stands about the target."""
    asked = scan_config("vlp-16", scene=scene, range=(distance, distance), size={"*": 0.5}, keep="all")
    plan = Plan(SHAPES, DatasetConfig("exact", views="ring:2@20", sample_size=None, scale="mesh", scan=asked))
    for number in (0, 5):
        for made in scanned_scenes(plan, asked, number, 0):
            target, *others = (each for each in made.placed if not each.is_background)
            assert target.mesh.longest_side == pytest.approx(0.5)
            assert len(others) > 2
            for each in others:
                assert each.mesh.longest_side == pytest.approx({**SIZES, "screen": 1.8}[each.label], rel=1e-3)
                assert each.label in {*BELONGING[scene], "screen"}


@pytest.mark.parametrize("scene", ["street", "room"])
@pytest.mark.parametrize("sizes", [{}, {"*": 4.6}, {"car": 4.2, "*": 0.3}, "file"])
def test_one_number_is_the_target_s_size_alone(scene: str, sizes: Sizes) -> None:
    """All else keeps the size of its class, also where files say their metres: built-in objects have no file."""
    collection = [replace(entry, label="gizmo") for entry in SHAPES if entry.label == "bottle"]
    pool = Pool(surroundings(SHAPES[:0], scene), sizes, scene, np.random.SeedSequence(3))
    for x in np.linspace(0.0, 0.999, 40):
        mesh, label = pool(x)
        known = sizes if isinstance(sizes, dict) else {}
        assert mesh.longest_side == pytest.approx(known.get(label, SIZES[label]), rel=1e-3), label
    if isinstance(sizes, dict) and "*" in sizes:  # of a class of which nothing else is known
        assert Pool(collection, sizes, "ground", np.random.SeedSequence(3))(0.0)[0].longest_side == sizes["*"]
        assert size_of("car", {"*": 4.6}, 1.0) == 4.6
