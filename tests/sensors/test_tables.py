"""Tables and objects at rest on them: stable poses against closed forms and the support of a solid; scenes of files."""

import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.cli.conftest import write_off
from tests.scenes import box, sphere
from tests.sensors.test_scenes import seeds
from zbuf_occlude.meshes import shapes
from zbuf_occlude.sensors import make
from zbuf_occlude.sensors.capture import captured_scenes, captures, in_metres, sensor_views
from zbuf_occlude.sensors.scan_config import ScanConfig
from zbuf_occlude.sensors.scenes import Scene
from zbuf_occlude.sensors.scenes.contents import Pool, read_scene, surroundings
from zbuf_occlude.sensors.scenes.kinds import plate_mesh
from zbuf_occlude.sensors.scenes.table import footprint, put_at_rest, stable_poses

pytestmark = [pytest.mark.needs("networkx"), pytest.mark.needs("scipy")]
PART = box((0.06, 0.04, 0.1))
VIEWS = zo.views.parse("fibonacci:6@20..60")


def scenes_of(seed: int = 0, mesh: zo.Mesh = PART, **given: Any) -> list[Scene]:
    asked = ScanConfig(make("realsense-d435"), keep="all", size="file", range=(0.6, 0.6), **given)
    standing, size = in_metres(mesh, "part", asked)
    floor, drawn = float(standing.bounds[0, 2]), partial(seeds, seed=seed)
    pool = Pool(surroundings(shapes.collection(n_members=1), asked.scene), {}, asked.scene, np.random.SeedSequence(1))
    places = sensor_views(VIEWS, size, floor, asked, drawn)
    return list(captured_scenes(standing, asked, places, floor, drawn, pool))


def write_scene(folder: Path, document: dict[str, Any]) -> Path:
    for name, mesh in {"brick": box((60.0, 40.0, 150.0)), "ball": sphere(8)}.items():
        write_off(folder / f"{name}.off", mesh.vertices, mesh.faces)
    (folder / "scene.json").write_text(json.dumps(document))
    return folder / "scene.json"


def test_a_brick_rests_on_its_sides_as_often_as_they_are_seen_from_its_middle() -> None:
    """The probability of a side is its solid angle over the sphere: 4 asin(ab / sqrt((a^2 + h^2)(b^2 + h^2)))."""
    sides = np.array([1.0, 1.5, 2.0])
    rotations, shares = stable_poses(box(tuple(sides)))
    assert len(shares) == 6
    for rotation, share in zip(rotations, shares, strict=True):
        down = int(np.abs(rotation[2]).argmax())
        h, (a, b) = sides[down] / 2, np.delete(sides, down) / 2
        assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-9)
        assert np.abs(rotation[2]).max() == pytest.approx(1.0)
        expected = 4 * np.arcsin(a * b / np.sqrt((a * a + h * h) * (b * b + h * h))) / (4 * np.pi)
        assert share == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("mesh", [box((1, 2, 3)), sphere(32), shapes.make("bottle", 1)], ids=["box", "ball", "bottle"])
def test_the_centre_of_mass_is_above_what_touches_the_table(mesh: zo.Mesh) -> None:
    rng, occupied = np.random.default_rng(3), []
    mesh = mesh.transformed(0.2 / mesh.longest_side)
    for _ in range(4):
        placed = put_at_rest(mesh, "a", (2.0, 2.0), 0.5, occupied, rng)
        vertices = placed.vertices
        assert vertices[:, 2].min() == pytest.approx(0.5, abs=1e-9)
        assert np.linalg.det(placed.pose[:3, :3]) == pytest.approx(1.0)
        touching = vertices[vertices[:, 2] < 0.5 + 2e-3]
        solid = placed.mesh.to_trimesh()
        solid.merge_vertices()
        solid = solid if solid.is_volume else solid.convex_hull
        centre = placed.pose[:2, :3] @ solid.center_mass + placed.pose[:2, 3]
        low, high = touching[:, :2].min(axis=0) - 5e-3, touching[:, :2].max(axis=0) + 5e-3
        assert ((low <= centre) & (centre <= high)).all()


def test_what_has_no_volume_does_not_rest() -> None:
    with pytest.raises(zo.MeshError, match="plate has no volume"):
        stable_poses(plate_mesh(0.1))


def test_footprints_do_not_overlap_and_lie_on_the_table() -> None:
    """As many bricks as nearly fill a table; then no place is free, which is said."""
    rng, occupied = np.random.default_rng(0), [(np.zeros(2), np.full(2, 0.05))]
    placed = list[zo.scenes.Placed]()

    def put_many() -> None:
        for _ in range(100):
            placed.append(put_at_rest(PART, "brick", (0.5, 0.4), 0.0, occupied, rng))

    with pytest.raises(zo.MeshError, match=r"brick has no free place on the table of 0.5 x 0.4 m; its footprint is"):
        put_many()
    assert len(placed) > 8
    boxes = [(np.zeros(2), np.full(2, 0.05)), *(footprint(each.vertices) for each in placed)]
    for i, (centre, half) in enumerate(boxes):
        assert (np.abs(centre) + half <= np.array([0.25, 0.2]) + 1e-9).all()
        for other, its_half in boxes[:i]:
            assert (np.abs(centre - other) >= half + its_half).any()


def test_a_table_of_a_file(tmp_path: Path) -> None:
    """Two bricks of a millimetre file and one at its place; the top touches the target's base, the ground is below."""
    objects = [
        {"mesh": "brick.off", "unit": "mm", "count": 2},
        {"mesh": "ball.off", "size": 0.05, "position": [0.1, 0, 0]},
    ]
    table = {"size": [0.6, 0.5], "height": 0.7, "albedo": 0.4}
    read = read_scene(write_scene(tmp_path, {"table": table, "objects": objects}))
    first, *rest = scenes_of(scene="file", **read)
    assert all(scene is first for scene in rest), "one scene of all views"
    assert first.labels == ("target", "ground", "table", "ball", "brick", "brick")
    assert [each.is_background for each in first.placed] == [False, True, True, False, False, False]
    floor = first.placed[0].vertices[:, 2].min()
    assert first.placed[2].vertices[:, 2].max() == pytest.approx(floor)
    assert np.ptp(first.placed[2].vertices, axis=0) == pytest.approx([0.6, 0.5, 0.7])
    assert first.placed[1].vertices[:, 2].max() == pytest.approx(floor - 0.7)
    assert first.albedos[2] == 0.4
    for brick in first.placed[4:]:
        assert sorted(np.linalg.norm(np.diff(brick.mesh.bounds, axis=0)[0] * np.eye(3), axis=1)) == pytest.approx(
            [0.04, 0.06, 0.15]
        )
        assert brick.vertices[:, 2].min() == pytest.approx(floor)
    again, other = scenes_of(scene="file", **read)[0], scenes_of(seed=1, scene="file", **read)[0]
    assert np.array_equal(again.mesh.vertices, first.mesh.vertices)
    assert not np.array_equal(other.mesh.vertices, first.mesh.vertices)


@pytest.mark.parametrize(
    ("document", "labels"),
    [
        ({"table": {}, "ground": False}, ("target", "table")),
        ({"objects": [], "ground": False}, ("target",)),
        ({"objects": [{"mesh": "ball.off", "position": [2, 0, 0]}], "ground": False}, ("target", "ball")),
        ({"table": {}}, ("target", "ground", "table")),
    ],
)
def test_without_a_ground(document: dict[str, Any], labels: tuple[str, ...], tmp_path: Path) -> None:
    assert scenes_of(scene="file", **read_scene(write_scene(tmp_path, document)))[0].labels == labels


def test_the_table_of_the_built_in_scene_has_things_on_it() -> None:
    scene = scenes_of(scene="table")[0]
    assert scene.labels[:3] == ("target", "ground", "table")
    assert len(scene.labels) > 4
    assert not {"chair", "car", "bed"} & set(scene.labels)
    floor = scene.placed[0].vertices[:, 2].min()
    assert all(each.vertices[:, 2].min() == pytest.approx(floor) for each in scene.placed[3:])


def test_cameras_keep_their_elevations_above_a_table() -> None:
    asked = ScanConfig(make("realsense-d435"), keep="all", size="file", range=(0.6, 0.6), scene="table")
    places = sensor_views(VIEWS, 0.1, -0.05, asked, seeds)
    assert places.elevation == pytest.approx(VIEWS.elevation)
    standing = zo.Mesh(PART.vertices - PART.centre, PART.faces)
    pool = Pool((), {}, "table", seeds("pool", 0))
    capture = next(captures(standing, asked, places, -0.05, seeds, pool))
    assert set(capture.scan.instances.tolist()) >= {0, 2}
    assert 0.0 <= capture.hidden < 1.0


def test_views_spread_evenly_over_a_band() -> None:
    """Heights are equally spaced between the sines of the band's edges; the whole sphere is as without a band."""
    views = zo.views.parse("fibonacci:50@20..70")
    edges = np.sin(np.radians([70, 20]))
    assert np.sin(views.elevation) == pytest.approx(edges[0] - np.ptp(edges) * (np.arange(50) + 0.5) / 50)
    eyes = views.eyes / 4.0
    nearest = np.sort(np.linalg.norm(eyes[:, None] - eyes, axis=2), axis=1)[:, 1]
    assert nearest.min() > 0.6 * nearest.mean()
    whole, same = zo.views.fibonacci(9), zo.views.parse("fibonacci:9@-90..90")
    assert np.array_equal(whole.eyes, same.eyes)
    with pytest.raises(zo.OptionError, match="elevations must run upwards"):
        zo.views.parse("fibonacci:9@70..20")
