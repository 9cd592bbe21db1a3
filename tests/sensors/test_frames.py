"""Frames: depth, normals and instances against closed forms, the oracle and Open3D; their files, read back."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.needs import need
from tests.scenes import box, soup, sphere
from zbuf_occlude.datasets.formats import find_format
from zbuf_occlude.datasets.generate import generate
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.geometry.colors import GREY, Material, SurfaceColors
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry
from zbuf_occlude.sensors.frames import depth_unit
from zbuf_occlude.sensors.scan_config import ScanConfig
from zbuf_occlude.sensors.scenes import Placed, moved

SMALL = {"width": 64, "height": 48}
CAMERAS = [
    {
        "R": [[0.0, 1.0, 0.0], [0.6, 0.0, -0.8], [-0.8, 0.0, -0.6]],
        "t": [0.02, -0.01, 3.0],
        "K": [[90.0, 0.0, 30.5], [0.0, 75.0, 20.25], [0.0, 0.0, 1.0]],
        "width": 64,
        "height": 48,
    }
]
"""One that looks past the middle, with pixels that are not square."""


@pytest.fixture
def cameras(tmp_path: Path) -> Path:
    path = tmp_path / "cameras.json"
    path.write_text(json.dumps(CAMERAS))
    return path


def test_points_lie_on_the_box_and_their_normals_are_its_sides() -> None:
    half = np.array([0.5, 1.0, 2.0])
    mesh = box((1.0, 2.0, 4.0))
    mesh = zo.Mesh(mesh.vertices - mesh.centre, mesh.faces)
    for frame in zo.frames(mesh, zo.views.for_mesh(mesh, "fibonacci:9"), **SMALL):
        assert 0.05 < frame.mask.mean() < 0.6, "the whole box is in the picture, and not small"
        assert not frame.mask[[0, -1]].any()
        assert not frame.mask[:, [0, -1]].any()
        beyond = np.abs(frame.points) / half
        assert beyond.max(axis=1) == pytest.approx(1.0, abs=5e-6), "depths are float32"
        normals = frame.normals[frame.mask]
        assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0, abs=1e-6)
        assert ((np.abs(normals) > 0.9) <= (beyond > 1.0 - 5e-6)).all(), "each is of a side on which the point lies"
        assert (np.einsum("ij,ij->i", normals, frame.camera_to_world[:3, 3] - frame.points) > 0).all()


def test_points_project_to_the_centres_of_their_pixels(cameras: Path) -> None:
    (frame,) = zo.frames(soup(300, 0.4), zo.views.from_json(cameras), **SMALL)
    assert frame.intrinsics == pytest.approx(np.array(CAMERAS[0]["K"]))
    assert frame.extrinsics == pytest.approx(np.column_stack([CAMERAS[0]["R"], CAMERAS[0]["t"]]))
    seen = frame.points @ frame.extrinsics[:, :3].T + frame.extrinsics[:, 3]
    pixels = seen @ frame.intrinsics.T
    rows, columns = np.nonzero(frame.mask)
    assert pixels[:, :2] / pixels[:, 2:] == pytest.approx(np.stack([columns + 0.5, rows + 0.5], axis=1), abs=1e-4)
    assert seen[:, 2] == pytest.approx(frame.depth[frame.mask])


@pytest.mark.parametrize("method", ["exact", "embree"])
def test_all_methods_deliver_the_oracles_pictures(method: str) -> None:
    need(zo.METHODS[method].requires)
    mesh = soup(400, 0.3, seed=5)
    views = zo.views.for_mesh(mesh, "fibonacci:3", distance=1.5)
    for found, true in zip(
        zo.frames(mesh, views, method=method, **SMALL), zo.frames(mesh, views, method="oracle", **SMALL), strict=True
    ):
        same = found.face_ids == true.face_ids
        assert same.all() if method == "exact" else same.mean() > 0.999
        assert found.depth[same & true.mask] == pytest.approx(true.depth[same & true.mask], rel=1e-5)


@pytest.mark.gl
def test_the_gpu_delivers_the_same_but_at_edges() -> None:
    mesh = sphere()
    views = zo.views.for_mesh(mesh, "fibonacci:3")
    for found, true in zip(
        zo.frames(mesh, views, method="depth_buffer", **SMALL), zo.frames(mesh, views, **SMALL), strict=True
    ):
        assert (found.mask != true.mask).mean() < 0.002
        both = found.mask & true.mask
        assert found.depth[both] == pytest.approx(true.depth[both], rel=1e-3)


@pytest.mark.needs("open3d")
def test_open3d_casts_the_same_depths(cameras: Path) -> None:
    import open3d as o3d

    mesh = soup(300, 0.4)
    (frame,) = zo.frames(mesh, zo.views.from_json(cameras), **SMALL)
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(mesh.vertices.astype(np.float32)), o3d.core.Tensor(mesh.faces.astype(np.uint32))
    )
    outside = np.vstack([frame.extrinsics, [0, 0, 0, 1]])
    rays = scene.create_rays_pinhole(
        o3d.core.Tensor(frame.intrinsics), o3d.core.Tensor(outside), width_px=64, height_px=48
    )
    found = scene.cast_rays(rays)  # directions have depth 1
    same = found["primitive_ids"].numpy().astype(np.int32) == frame.face_ids
    assert same.mean() > 0.998, "float32 decides edges otherwise"
    there = same & frame.mask
    assert found["t_hit"].numpy()[there] == pytest.approx(frame.depth[there], rel=1e-4)
    picture, camera = frame.to_open3d()
    outside[:3] = frame.extrinsics
    cloud = o3d.geometry.PointCloud.create_from_rgbd_image(picture, camera, outside)
    assert np.asarray(cloud.points) == pytest.approx(frame.points, abs=1e-5)


SENSOR = zo.sensors.make("realsense-d435", width=80, height=60, match_window=1, drop=0.1)
TWO = zo.Scene.joined([Placed(box(), "a"), Placed(box(), "b", moved(scale=0.4, to=(1.2, 0.3, 0.1)))])
RING = zo.views.ring(3, elevation=25, distance=2.5)


def test_a_sensor_measures_depth_and_all_else_is_of_first_hits() -> None:
    """Depths are what `scan` gives of the same sensor and seed; the mask is that of a camera without fault."""
    rng = np.random.default_rng(7)
    exact = zo.frames(TWO, RING, width=80, height=60, fov=90)
    for frame, true, pose in zip(zo.frames(TWO, RING, sensor=SENSOR, seed=7), exact, RING.poses, strict=True):
        for name in ("mask", "instances", "face_ids", "normals", "rgba", "intrinsics"):
            assert np.array_equal(getattr(frame, name), getattr(true, name)), name
        measured = np.isfinite(frame.depth)
        assert not (measured & ~frame.mask).any()
        assert 0.2 < (frame.mask & ~measured).sum() / frame.mask.sum() < 0.8, "the second eye misses some"
        forward, left, up = -pose[2, :3], -pose[0, :3], pose[1, :3]
        place = np.eye(4)
        place[:3, :3], place[:3, 3] = np.stack([forward, left, up], axis=1), -pose[:3, :3].T @ pose[:3, 3]
        scan = zo.scan(TWO, SENSOR, place, seed=rng)
        assert len(scan) == measured.sum() == len(frame.points)
        at_pixel = np.zeros((60, 80, 3))
        at_pixel[scan.rings, scan.columns] = scan.points
        assert frame.points == pytest.approx(at_pixel[measured], abs=1e-5)
        steps = frame.depth[measured] / 0.001
        assert steps == pytest.approx(np.round(steps), abs=2e-3), "millimetres"


def test_the_same_seed_gives_the_same_frames() -> None:
    first, again, other = (
        [frame.depth.tobytes() for frame in zo.frames(TWO, RING, sensor=SENSOR, seed=seed)] for seed in (1, 1, 2)
    )
    assert first == again
    assert first != other


def test_what_a_sensor_cannot_be_given(cameras: Path) -> None:
    with pytest.raises(zo.ArgumentError, match="width, height and fov must be those of the sensor"):
        zo.frames(TWO, RING, sensor="kinect-v1", width=64)
    with pytest.raises(zo.OptionError, match="pinhole camera; got the sensor vlp-16, of the kind spinning"):
        zo.frames(TWO, RING, sensor="vlp-16")
    (frame,) = zo.frames(soup(300, 0.4), zo.views.from_json(cameras), sensor="kinect-v1")
    assert frame.depth.shape == (48, 64), "cameras of a file have pixels of their own"
    assert frame.intrinsics == pytest.approx(np.array(CAMERAS[0]["K"]))


def test_lost_pixels_leave_no_holes_in_files(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image", reason="the package Pillow is not installed")
    zo.write_frames(tmp_path, found := list(zo.frames(TWO, RING, sensor=SENSOR)))
    for i, frame in enumerate(found):
        depth, mask, picture = (np.array(image.open(tmp_path / f"{i:03d}{end}.png")) for end in ("_depth", "_mask", ""))
        assert ((mask > 0) == frame.mask).all()
        assert ((picture[..., 3] > 0) == frame.mask).all()
        assert picture[frame.mask].all(), "no pixel of the object is black"
        assert ((depth > 0) == np.isfinite(frame.depth)).all()


def test_objects_of_a_scene_have_their_own_colours() -> None:
    """Red and green boxes beside a grey one, by vertex colours: each pixel has that of its instance."""

    def coloured(rgb: tuple[int, int, int]) -> zo.Mesh:
        paint = Material(tuple(np.array(rgb) / 255.0))
        return zo.Mesh(box().vertices, box().faces, colors=SurfaceColors((paint,), np.zeros(12, np.int32)))

    placed = [Placed(coloured((200, 10, 10)), "red"), Placed(box(), "bare", moved(to=(0, 1.5, 0)))]
    placed.append(Placed(coloured((10, 180, 20)), "green", moved(to=(0, -1.5, 0))))
    (frame,) = zo.frames(zo.Scene.joined(placed), zo.views.from_angles(20, 30, distance=6.0), colors=True, **SMALL)
    for instance, rgb in enumerate([(200, 10, 10), (GREY, GREY, GREY), (10, 180, 20)]):
        mine = frame.rgba[frame.instances == instance]
        assert len(mine) > 20
        assert np.abs(mine[:, :3].astype(int) - rgb).max() <= 1


def test_instances_of_a_scene_and_the_nearest_wins() -> None:
    ball = sphere()
    scene = zo.Scene.joined([Placed(ball, "ball"), Placed(ball, "ball", moved(scale=0.5, to=(2.0, 0.0, 0.0)))])
    (frame,) = zo.frames(scene, zo.views.from_angles(0, 0, distance=6.0), fov=40, **SMALL)
    assert set(np.unique(frame.instances)) == {-1, 0, 1}
    assert ((frame.instances < 0) == ~frame.mask).all()
    assert frame.instances[24, 32] == 1, "the small ball stands before the large one"
    assert frame.depth[24, 32] == pytest.approx(6.0 - 2.5, abs=0.02)
    assert (frame.instances == scene.instances[frame.face_ids])[frame.mask].all()


def test_files_are_read_back(tmp_path: Path, cameras: Path) -> None:
    image = pytest.importorskip("PIL.Image", reason="the package Pillow is not installed")
    mesh = soup(300, 0.4)
    views = zo.views.for_mesh(mesh, "fibonacci:3", distance=2.0)
    found = list(zo.frames(mesh, views, **SMALL))
    names = zo.write_frames(tmp_path / "out", found)
    assert sorted(names) == sorted(path.name for path in (tmp_path / "out").iterdir())
    about = json.loads((tmp_path / "out" / "transforms.json").read_text())
    for i, frame in enumerate(found):
        depth, mask, normal, instance, picture = (
            np.array(image.open(tmp_path / "out" / f"{i:03d}{name}.png"))
            for name in ("_depth", "_mask", "_normal", "_instance", "")
        )
        unit = about["integer_depth_scale"]
        assert np.where(mask, depth * unit, np.inf) == pytest.approx(frame.depth, abs=unit / 2 * 1.001)
        assert ((mask == 255) == frame.mask).all()
        assert ((depth > 0) == frame.mask).all()
        assert (normal[frame.mask] / 127.5 - 1.0) == pytest.approx(frame.normals[frame.mask], abs=0.5 / 127.5 + 1e-6)
        assert (instance.astype(int) - 1 == frame.instances).all()
        assert ((picture[..., 3] == 255) == frame.mask).all()
        assert np.load(tmp_path / "out" / f"{i:03d}.npy") == pytest.approx(frame.pose[:3])
    for name in ("transforms.json", "cameras.json"):
        again = zo.views.from_json(tmp_path / "out" / name)
        assert again.poses == pytest.approx(views.poses)
        assert again.intrinsics(64, 48) == pytest.approx(np.array([frame.intrinsics for frame in found]))
    zo.write_frames(tmp_path / "other", [found[0], *zo.frames(mesh, zo.views.from_json(cameras), **SMALL)])
    again = zo.views.from_json(tmp_path / "other" / "transforms.json")
    assert again.intrinsics(64, 48)[1] == pytest.approx(np.array(CAMERAS[0]["K"]))


def test_what_is_wrong_is_said(tmp_path: Path, cameras: Path) -> None:
    views = zo.views.from_angles(30, 20)
    for message, call in (
        ("width must be", lambda: zo.frames(box(), views, width=0)),
        ("at most 67,108,864 pixels", lambda: zo.frames(box(), views, width=10**5, height=10**5)),
        ("fov must be a number from 0.001 to 179.9, degrees", lambda: zo.frames(box(), views, fov=200.0)),
        ("fov must not be given", lambda: zo.frames(box(), zo.views.from_json(cameras), fov=20.0)),
        ("colors must be True or False", lambda: zo.frames(box(), views, colors="no")),  # type: ignore[arg-type]
        ("views must be Views", lambda: zo.frames(box(), [[3.0, 2.0, 1.0]])),  # type: ignore[arg-type]
        (
            "occluder must be prepared for the mesh",
            lambda: zo.frames(box(), views, occluder=zo.prepare(sphere(), "exact")),
        ),
        (
            "occluder must be prepared for the mesh",
            lambda: zo.scan(box(), "vlp-16", range=3, occluder=zo.prepare(sphere(), "exact")),
        ),
        *(
            ("unit must be", lambda unit=unit: zo.write_frames(tmp_path / "out", zo.frames(box(), views), unit=unit))
            for unit in (np.nan, np.inf, -1.0, 0.0, "m", 1e9)
        ),
        ("at most 65535 steps", lambda: zo.write_frames(tmp_path / "out", zo.frames(box(), views, **SMALL), unit=1e-9)),
    ):
        with pytest.raises(zo.OccludeError, match=message):
            call()
    with pytest.raises(zo.OptionError, match="cast rays"):
        zo.frames(box(), views, method="occupancy_grid")


@pytest.mark.parametrize(("farthest", "unit"), [(5.0, 1e-4), (65.535, 1e-3), (66.0, 1e-2), (0.0, 1.0)])
def test_the_unit_is_the_finest_power_of_ten(farthest: float, unit: float) -> None:
    assert depth_unit(farthest) == pytest.approx(unit)


@pytest.mark.parametrize("from_file", [False, True])
def test_a_dataset_holds_the_same_frames(from_file: bool, cameras: Path, tmp_path: Path) -> None:
    """Of a mesh away from the origin: a dataset's world is the middle of its box."""
    image = pytest.importorskip("PIL.Image", reason="the package Pillow is not installed")
    mesh = box((0.3, 0.5, 0.8)).transformed(1.0, (0.1, -0.2, 0.05))
    width, height = (20, 30) if from_file else (64, 48)  # those of a file are in the file
    sensor = zo.sensors.make("pinhole", width=width, height=height, fov=30)
    config = DatasetConfig(
        method="exact",
        views=str(cameras) if from_file else "ring:3@25",
        scan=ScanConfig(sensor, size="file", keep="all", method="exact"),
        sample_size=None,
        scale="mesh",
        attributes=("normals",),
    )
    plan = Plan(MeshCollection([MeshEntry("a/box.off", "box", "train", lambda: mesh)]), config, "frames")
    manifest = generate(plan, tmp_path / "out")
    assert manifest["error"]["false_visible"] == manifest["error"]["false_hidden"] == 0.0
    (folder,) = json.loads((tmp_path / "out" / "valid_paths.json").read_text())
    if from_file:
        views, fov = zo.views.from_json(cameras), None
    else:
        views, fov = zo.views.for_mesh(mesh, "ring:3@25"), 30.0
    unit = json.loads((tmp_path / "out" / folder / "transforms.json").read_text())["integer_depth_scale"]
    for i, frame in enumerate(zo.frames(mesh, views, fov=fov, **SMALL)):
        steps = np.array(image.open(tmp_path / "out" / folder / f"{i:03d}_depth.png"))
        assert ((steps > 0) == frame.mask).mean() > 0.999
        both = frame.mask & (steps > 0)
        assert both.any()
        assert steps[both] * unit == pytest.approx(frame.depth[both], abs=unit)
    placed = zo.views.from_json(tmp_path / "out" / folder / "cameras.json")
    assert placed.eyes + mesh.centre == pytest.approx(views.eyes)
    assert placed.intrinsics(64, 48)[0] == pytest.approx(frame.intrinsics)


def of_camera(
    folder: Path,
    mesh: zo.Mesh,
    sensor: zo.sensors.Sensor,
    *,
    form: str = "frames",
    views: str = "ring:2@15",
    depth_unit: float | None = None,
    **given: Any,
) -> Path:
    """Generate views of a mesh; return the folder of its frames."""
    numbers = {"size": "file", "keep": "all", "range": (1.5, 1.5), **given}
    config = DatasetConfig(
        method="exact",
        views=views,
        depth_unit=depth_unit,
        scan=ScanConfig(sensor, **numbers),
        sample_size=None,
        scale="mesh",
    )
    generate(Plan(MeshCollection([MeshEntry("a/m.off", "m", "train", lambda: mesh)]), config, form), folder)
    return folder / "train/m/m"


def test_a_datasets_masks_are_silhouettes_and_its_depth_is_noisy(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image", reason="the package Pillow is not installed")
    noisy = of_camera(tmp_path / "noisy", box((0.5, 0.5, 0.5)), SENSOR, scene="ground")
    exact = of_camera(
        tmp_path / "exact", box((0.5, 0.5, 0.5)), SENSOR.with_numbers(noise=0, baseline=0), scene="ground"
    )
    for name in ("000.png", "001_mask.png", "001_normal.png", "000_instance.png"):
        assert (noisy / name).read_bytes() == (exact / name).read_bytes(), name
    depth, true, mask = (np.array(image.open(at)) for at in (noisy / "000_depth.png", exact / "000_depth.png",
                                                             noisy / "000_mask.png"))  # fmt: skip
    assert ((true > 0) == (mask > 0)).mean() > 0.5, "the ground ends where the camera no longer measures"
    assert not ((depth > 0) & (mask == 0)).any()
    assert 0 < ((depth == 0) & (true > 0)).sum() < (depth > 0).sum()


@pytest.mark.parametrize("form", ["frames", "bop"])
def test_a_depth_unit_is_that_of_all_datasets(form: str, tmp_path: Path) -> None:
    """Of two datasets, of a small object and of a large one farther away: a depth in metres is the image over 1000."""
    image = pytest.importorskip("PIL.Image", reason="the package Pillow is not installed")
    sensor = zo.sensors.make("pinhole:width=32,height=24,fov=40", range_max=65.0)
    for name, side, away in (("near", 0.1, 0.4), ("far", 5.0, 30.0)):
        mesh = box((side, side, side))
        given = {"range": (away, away), "depth_unit": 0.001, "form": form, "views": "ring:1@0"}
        of_camera(tmp_path / name, mesh, sensor, **given)
        (path,) = (tmp_path / name).glob("**/*_depth.png" if form == "frames" else "**/depth/*.png")
        assert np.array(image.open(path))[12, 16] == round(1000 * (away - side / 2))
        (about,) = (tmp_path / name).glob("**/transforms.json" if form == "frames" else "**/scene_camera.json")
        assert ('"integer_depth_scale": 0.001' if form == "frames" else '"depth_scale": 1.0') in about.read_text()


@pytest.mark.parametrize("form", ["frames", "bop"])
def test_a_unit_above_twice_all_depths_is_refused(form: str, tmp_path: Path) -> None:
    """Each depth of an object 1.5 m away would be one step, 5 m."""
    pytest.importorskip("PIL.Image", reason="the package Pillow is not installed")
    sensor = zo.sensors.make("pinhole:width=32,height=24,fov=40", range_max=9.0)
    with pytest.raises(zo.OccludeError, match=r"unit must be less than the depths, here at most 1\.\d+; got 5"):
        of_camera(tmp_path, box((0.1, 0.1, 0.1)), sensor, form=form, views="ring:1@0", depth_unit=5.0)


@pytest.mark.parametrize(
    ("message", "sensor", "given"),
    [
        ("pinhole camera; got the sensor vlp-16", "vlp-16", {}),
        ("65,535 steps of 0.001 end at 65.53 m, pinhole measures up to inf m", "pinhole", {}),
        ("pixels of all objects, --keep all; got target", "kinect-v1", {"keep": "target"}),
        (
            "must be of a camera and objects at rest",
            "pinhole:readout=0.1",
            {"motion": zo.sensors.Motion((1.0, 0.0, 0.0))},
        ),
    ],
)
def test_what_no_frames_are_made_of(message: str, sensor: str, given: dict[str, Any]) -> None:
    scan = ScanConfig(zo.sensors.make(sensor), **{"keep": "all", **given})
    config = DatasetConfig(scan=scan, sample_size=None, scale="mesh", depth_unit=0.001)
    plan = Plan(MeshCollection([MeshEntry("a/m.off", "m", "train", box)]), config, "frames")
    with pytest.raises(zo.OptionError, match=message):
        find_format("frames").check(plan)


@pytest.mark.parametrize("form", ["frames", "bop"])
def test_of_several_echoes_a_picture_has_the_first(form: str, tmp_path: Path) -> None:
    """Beams that spread over the edge of a plate meet the one behind it too: all returns show what the first do."""
    image = pytest.importorskip("PIL.Image", reason="the package Pillow is not installed")
    corners = [[-0.5, -0.4, -0.5], [-0.5, 0.4, -0.5], [-0.5, 0.4, 0.5], [-0.5, -0.4, 0.5]]
    behind = [[-2.0, 2 * y, 2 * z] for _, y, z in corners]
    mesh = zo.Mesh(corners + behind, [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    shown = {}
    for returns in ("first", "last", "all"):
        numbers = {"width": 64, "height": 48, "fov": 40, "divergence": 0.02, "echo_separation": 0.1}
        sensor = zo.sensors.make("pinhole", returns=returns, **numbers)
        config = DatasetConfig(
            method="exact",
            views="ring:1@0",
            scan=ScanConfig(sensor, size="file", keep="all", range=(4.0, 4.0), method="exact"),
            sample_size=None,
            scale="mesh",
            attributes=("normals",),
        )
        generate(
            Plan(MeshCollection([MeshEntry("a/m.off", "m", "train", lambda: mesh)]), config, form), tmp_path / returns
        )
        (file,) = (tmp_path / returns).glob("**/*_depth.png" if form == "frames" else "**/depth/*.png")
        shown[returns] = np.array(image.open(file))
    assert (shown["first"] != shown["last"]).sum() > 50
    assert (shown["all"] == shown["first"]).all()


@pytest.mark.parametrize(("away", "width"), [(1.05, 64), (1.6, 48), (20.0, 64)])
def test_without_a_field_of_view_the_whole_mesh_is_seen_from_near_too(away: float, width: int) -> None:
    """From 0.05 before a box of two metres: all corners are in the picture."""
    mesh = zo.Mesh(box((2.0, 1.0, 1.0)).vertices - box((2.0, 1.0, 1.0)).centre, box().faces)
    views = zo.views.from_angles(0.0, 0.0, distance=1.0).around(np.zeros(3), away)
    (frame,) = zo.frames(mesh, views, width=width, height=48)
    pixels = (mesh.vertices @ frame.extrinsics[:, :3].T + frame.extrinsics[:, 3]) @ frame.intrinsics.T
    places = pixels[:, :2] / pixels[:, 2:]
    assert (places >= 0).all()
    assert (places <= [width, 48]).all()


def test_a_camera_within_the_mesh_is_said() -> None:
    mesh = sphere()
    with pytest.warns(UserWarning, match="whole mesh"):
        next(zo.frames(mesh, zo.views.from_angles(0.0, 0.0, distance=0.3), **SMALL))


def test_older_frames_are_not_mixed_with_new_ones(tmp_path: Path) -> None:
    mesh = box()
    (tmp_path / "notes.txt").write_text("mine")
    zo.write_frames(tmp_path, zo.frames(mesh, zo.views.for_mesh(mesh, "ring:3@20"), **SMALL))
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(zo.ArgumentError, match=r"must be new.*older frames"):
        zo.write_frames(tmp_path, zo.frames(mesh, zo.views.for_mesh(mesh, "ring:1@20"), **SMALL))
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_what_is_met_is_never_a_depth_of_nothing(tmp_path: Path) -> None:
    """One plate lies before the camera, another a million times farther: the near one is one step away."""
    image = pytest.importorskip("PIL.Image", reason="the package Pillow is not installed")
    plate = zo.Mesh([[0.0, -1, -1], [0, 1, -1], [0, 1, 1], [0, -1, 1]], [[0, 1, 2], [0, 2, 3]])
    near, far = moved(scale=1e-3, to=(-1e-3, 0.0, 0.0)), moved(scale=1e3, to=(-1e3, 900.0, 0.0))
    scene = zo.Scene.joined([Placed(plate, "near", near), Placed(plate, "far", far)])
    frame = next(zo.frames(scene, zo.views.from_angles(0, 0, distance=1e-9), fov=120, **SMALL))
    zo.write_frames(tmp_path, [frame])
    assert set(np.unique(frame.instances)) >= {0, 1}
    assert ((np.array(image.open(tmp_path / "000_depth.png")) > 0) == frame.mask).all()


def test_cameras_of_a_file_have_its_pixels(tmp_path: Path) -> None:
    """Two cameras of unlike sizes; all can be given another."""
    other = {**CAMERAS[0], "width": 30, "height": 20, "K": [[40.0, 0.0, 14.0], [0.0, 40.0, 11.0], [0.0, 0.0, 1.0]]}
    (tmp_path / "two.json").write_text(json.dumps([CAMERAS[0], other]))
    views = zo.views.from_json(tmp_path / "two.json")
    one, two = zo.frames(soup(300, 0.4), views)
    assert (one.depth.shape, two.depth.shape) == ((48, 64), (20, 30))
    assert two.intrinsics == pytest.approx(np.array(other["K"]))
    assert [frame.depth.shape for frame in zo.frames(box(), views, width=64, height=48)] == [(48, 64)] * 2
    with pytest.raises(zo.ArgumentError, match="given together"):
        zo.frames(box(), views, width=64)
    kept = zo.Views.from_rows(views.around(np.ones(3), 2.0).select([1]).to_rows().tolist())
    assert kept.sizes is not None
    assert kept.sizes.tolist() == [[30, 20]]
    assert kept.looking(None, 0.5).sizes is None, "another field of view has other pixels"
    del other["width"]
    (tmp_path / "two.json").write_text(json.dumps([CAMERAS[0], other]))
    assert zo.views.from_json(tmp_path / "two.json").sizes is None, "one does not say"
