"""The API of one line: partial clouds, depth images and scans of whatever is a mesh."""

import doctest
import inspect
import math
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh

import zbuf_occlude as zo
from tests.scenes import box, sphere, together, two_plates
from zbuf_occlude.engines.gl.context import GlContext
from zbuf_occlude.engines.gl.depth_pass import render_depth
from zbuf_occlude.meshes.load import load_cloud

PLATES = two_plates()
"""Unit squares at z = 0 and z = 0.5."""


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The files that examples name: a chair of three boxes, and a box for a car."""
    monkeypatch.chdir(tmp_path)
    parts = [
        box((1, 1, 0.1)),
        box((0.1, 1, 1)).transformed(1, (0.5, 0, 0.6)),
        box((0.2, 0.2, 1)).transformed(1, (0, 0, -0.6)),
    ]
    together(*parts).to_trimesh().export("chair.off")
    box((4, 2, 1)).to_trimesh().export("car.obj")


OPEN3D = pytest.mark.needs("open3d")


def tensor_mesh(mesh: zo.Mesh) -> Any:
    import open3d

    return open3d.t.geometry.TriangleMesh.from_legacy(mesh.to_open3d())


OF_OTHERS: list[Any] = [
    zo.Mesh.to_trimesh,
    pytest.param(zo.Mesh.to_open3d, marks=OPEN3D),
    pytest.param(tensor_mesh, marks=OPEN3D),
    lambda mesh: SimpleNamespace(vertices=mesh.vertices.tolist(), triangles=mesh.faces.tolist()),
    lambda mesh: (mesh.vertices, mesh.faces),
    lambda mesh: [mesh.vertices.tolist(), mesh.faces.tolist()],
]


@pytest.mark.parametrize("other", OF_OTHERS)
def test_whatever_is_a_mesh_is_taken_wherever_one_is(other: Callable[[zo.Mesh], Any]) -> None:
    mesh = box((4, 2, 1))
    given, eye = other(mesh), [9.0, 1.0, 2.0]
    points = zo.sample_surface(mesh, n_points=50, seed=3)
    np.testing.assert_allclose(zo.sample_surface(given, n_points=50, seed=3).positions, points.positions, atol=1e-6)
    with zo.prepare(mesh, "oracle") as ours, zo.prepare(given, "exact") as theirs:
        np.testing.assert_array_equal(theirs.visible(points, eye), ours.visible(points, eye))
    for make in (
        lambda m: zo.occlude(m, eye=eye, n_points=40).points,
        lambda m: zo.depth_image(m, eye=eye, resolution=9),
        lambda m: zo.scan(m, "pinhole:width=9,height=9", range=9).points,
        lambda m: zo.views.for_mesh(m, "ring:3@10").eyes,
    ):
        np.testing.assert_allclose(make(given), make(mesh), atol=1e-5)


def test_a_path_is_a_mesh_too() -> None:
    assert len(zo.sample_surface("chair.off", n_points=7)) == 7
    with zo.prepare(Path("chair.off"), "exact") as occluder:
        assert repr(occluder) == "VisibilityQuery('exact', Mesh('chair', 24 vertices, 36 faces))"
    assert repr(occluder).endswith(", closed)")
    assert zo.views.for_mesh("car.obj", "fibonacci:5", distance=2).distance.tolist() == [8.0] * 5


def test_a_pcd_of_a_cloud_far_from_the_origin_warns() -> None:
    near = zo.occlude(box(), azimuth=30, elevation=20, n_points=60)
    far = replace(near, points=near.points + np.array([5e5, 0.0, 0.0]))
    far.save("far.npz")
    with pytest.warns(UserWarning, match=r"far\.pcd has float32; its coordinates reach 50000\d.* are 0\.031 apart"):
        far.save("far.pcd")


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]]), r"got quads, \(1, 4\)\. Triangulate first\."),
        (([[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 1, 2], [0, 1]]), "unequal length. Triangulate first."),
        (7, "mesh must be a path, a Mesh, .* got int"),
        (trimesh.Scene(), r"got Scene\. Make one mesh of a scene: scene\.to_mesh\(\)\."),
    ],
)
def test_what_is_no_mesh_says_what_is(mesh: Any, message: str) -> None:
    with pytest.raises(zo.ArgumentError, match=message):
        zo.occlude(mesh, azimuth=0, elevation=0)


def test_a_partial_cloud_is_what_the_camera_sees() -> None:
    cloud = zo.occlude(PLATES, azimuth=0, elevation=90, n_points=500, seed=1)
    assert cloud.points.shape == cloud.normals.shape == (500, 3)
    assert len(np.unique(cloud.points, axis=0)) == 500
    assert cloud.colors is None
    assert cloud.eye.tolist() == [0.5, 0.5, 4.25]
    upper = cloud.points[:, 2] == 0.5
    np.testing.assert_array_equal(np.isin(cloud.face_ids, [2, 3]), upper)
    assert upper.all()  # the lower plate is behind the upper one, seen from there
    assert (cloud.normals == [0, 0, 1]).all()
    assert cloud.visible_fraction == pytest.approx(0.5, abs=0.05)
    again, other = (zo.occlude(PLATES, azimuth=0, elevation=90, n_points=500, seed=seed) for seed in (1, 2))
    np.testing.assert_array_equal(again.points, cloud.points)
    assert not np.array_equal(other.points, cloud.points)


def test_the_visible_share_of_a_sphere_is_that_of_its_closed_form() -> None:
    cloud = zo.occlude(sphere(64), eye=(3.0, 0.0, 0.0), n_points=20_000)
    assert cloud.visible_fraction == pytest.approx((1 - 1 / 3) / 2, abs=0.01)
    assert (cloud.points[:, 0] > 1 / 3 - 0.02).all()


def test_points_are_enough_where_little_is_visible() -> None:
    mesh = together(sphere(12), sphere(12).transformed(0.98))
    cloud = zo.occlude(mesh, azimuth=10, elevation=10, distance=0.55, n_points=3000)
    assert cloud.visible_fraction < 0.25 / 2
    assert len(np.unique(cloud.points, axis=0)) == 3000


def test_a_density_keeps_all_that_is_visible() -> None:
    cloud = zo.occlude(PLATES, azimuth=0, elevation=90, density=1000.0)
    assert len(cloud) == pytest.approx(1000, abs=150)
    assert len(np.unique(cloud.points, axis=0)) == len(cloud)


def test_angles_are_degrees_about_the_centre() -> None:
    mesh = box((4, 2, 1)).transformed(1.0, (10, 0, 0))
    cloud = zo.occlude(mesh, azimuth=90, elevation=30, distance=2, n_points=10)
    np.testing.assert_allclose(cloud.eye, [10, 8 * math.cos(math.pi / 6), 4], atol=1e-12)
    np.testing.assert_allclose((cloud.pose @ [*cloud.eye, 1])[:3], 0.0, atol=1e-9)
    one = zo.views.for_mesh(mesh, zo.views.from_angles(90, 30), distance=4)[0]
    np.testing.assert_allclose(zo.occlude(mesh, eye=one, n_points=10).eye, one.eyes[0])


def test_the_frame_of_the_camera() -> None:
    world, camera = (zo.occlude("chair.off", azimuth=30, elevation=20, frame=f) for f in ("object", "camera"))
    assert camera.eye.tolist() == [0, 0, 0]
    np.testing.assert_allclose(camera.points, world.points @ world.pose[:3, :3].T + world.pose[:3, 3], atol=1e-12)
    assert (camera.points[:, 2] < 0).all()
    assert (np.einsum("ij,ij->i", camera.normals, camera.points) <= 1e-12).all()


def test_a_sensors_cloud_are_its_returns() -> None:
    eye = np.array([9.0, 1.0, 2.0])
    cloud = zo.occlude("car.obj", eye=eye, sensor="pinhole:width=40,height=40,fov=40,noise=0")
    assert cloud.visible_fraction is None
    assert 50 < len(cloud) < 1600
    with zo.prepare("car.obj", "oracle") as oracle:
        hits = oracle.first_hits(eye[None], cloud.points - eye)
    np.testing.assert_allclose(hits.distances, np.linalg.norm(cloud.points - eye, axis=1), rtol=1e-9)
    assert len(zo.occlude("car.obj", eye=eye, sensor="vlp-16", n_points=33)) == 33


@OPEN3D
def test_colours_come_from_what_has_them() -> None:
    mesh = box().to_trimesh()
    mesh.visual.face_colors = np.tile([[10, 20, 30, 255]], (12, 1))
    ours = box().to_open3d()
    ours.paint_uniform_color([10 / 255, 20 / 255, 30 / 255])
    for given in (mesh, ours):
        assert (zo.occlude(given, azimuth=0, elevation=0, n_points=9, colors=True).colors == [10, 20, 30]).all()
        assert zo.occlude(given, azimuth=0, elevation=0, n_points=9).colors is None
    with_sensor = zo.occlude(mesh, azimuth=0, elevation=0, colors=True, sensor="pinhole:width=9,height=9")
    assert (with_sensor.colors == [10, 20, 30]).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "give azimuth and elevation, degrees, or eye"),
        ({"azimuth": 1, "eye": (1, 2, 3)}, "must not be given with eye"),
        ({"distance": 5, "eye": (1, 2, 3)}, "must not be given with eye"),
        ({"eye": (1, float("nan"), 3)}, "eye must be finite"),
        ({"azimut": 1, "elevation": 0}, "Did you mean 'azimuth'"),
        ({"azimuth": 1, "points": 9}, "Did you mean 'n_points'"),
        ({"azimuth": 1, "density": 1e-9}, "gives no point on an area"),
        ({"azimuth": 0, "elevation": 100}, r"elevation must be a number in \[-90, 90\], degrees; got 100"),
        ({"azimuth": "north", "elevation": 0}, "azimuth must be a number, degrees; got 'north'"),
        ({"eye": (0, 0, 0)}, "eye must not be the mesh's centre"),
        ({"eye": (1, 2)}, r"eye must be \(3,\); got \(2,\)"),
        ({"eye": zo.views.paper100()}, r"eye must be one view; got 100\. Take one: views\[0\]"),
        ({"azimuth": 0, "n_points": 0}, "n_points must be a positive int; got 0"),
        ({"azimuth": 0, "n_points": 10**12}, "n_points must be at most 536,870,911; got 1,000,000,000,000"),
        ({"azimuth": 0, "n_points": 9, "density": 9.0}, "give n_points or density, not both"),
        ({"azimuth": 0, "frame": "world"}, "frame must be one of object, camera; got 'world'"),
        ({"azimuth": 0, "method": "exakt"}, "got 'exakt'"),
        ({"azimuth": 0, "resolution": 9}, "got 'resolution'"),
        ({"azimuth": 0, "sensor": "vlp-61"}, "got 'vlp-61'"),
        ({"azimuth": 0, "sensor": "vlp-16", "density": 9.0}, "density must not be given with a sensor"),
    ],
)
def test_bad_calls(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(zo.OccludeError, match=message):
        zo.occlude(box(), **arguments)


def test_an_eye_inside_warns_once() -> None:
    with pytest.warns(UserWarning, match="inside the mesh's bounding box") as said:
        zo.occlude(sphere(12), eye=(0.1, 0.0, 0.0), n_points=50)
    assert len(said) == 1
    with pytest.warns(UserWarning, match="inside the mesh's bounding box"):
        zo.scan("car.obj", "vlp-16", range=0.5)


@OPEN3D
def test_files_and_objects_of_others() -> None:
    mesh = box().to_trimesh()
    mesh.visual.face_colors = np.tile([[10, 20, 30, 255]], (12, 1))
    cloud = zo.occlude(mesh, azimuth=30, elevation=20, n_points=60, colors=True)
    assert np.asarray(cloud).shape == (60, 3)
    assert np.asarray(cloud, dtype=np.float32).dtype == np.float32
    for name in ("a.ply", "a.npz", "a.pcd", "a.npy", "a.csv"):
        cloud.save(name)
    for name in ("a.ply", "a.npy", "a.csv"):
        assert np.array_equal(load_cloud(name), cloud.points)
    np.testing.assert_array_equal(trimesh.load("a.ply").colors[:, :3], cloud.colors)
    with np.load("a.npz") as stored:
        assert {"points", "normals", "colors", "face_ids", "eye", "visible_fraction", "pose"} == set(stored)
        np.testing.assert_array_equal(stored["face_ids"], cloud.face_ids)
    assert np.load("a.npy")["nx"].tolist() == cloud.normals[:, 0].astype("f4").tolist()
    table = np.loadtxt("a.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(table[:, :3], cloud.points, rtol=1e-8)
    import open3d

    for seen in (open3d.io.read_point_cloud("a.pcd"), open3d.io.read_point_cloud("a.ply"), cloud.to_open3d()):
        np.testing.assert_allclose(np.asarray(seen.points), cloud.points, atol=1e-6)
        np.testing.assert_allclose(np.asarray(seen.normals), cloud.normals, atol=1e-6)
        np.testing.assert_allclose(np.asarray(seen.colors) * 255, cloud.colors, atol=1e-4)
    np.testing.assert_array_equal(cloud.to_trimesh().vertices, cloud.points)
    with pytest.raises(zo.OptionError, match=r"must end in \.ply, \.npz, \.pcd, \.npy, \.csv; got 'a\.xyz'"):
        cloud.save("a.xyz")


@OPEN3D
def test_a_scan_from_a_range() -> None:
    found = zo.scan("car.obj", "pinhole:width=20,height=20,fov=20,noise=0", range=15, azimuth=90, elevation=0)
    assert found.eye.round(9).tolist() == [0, 15, 0]
    np.testing.assert_allclose(found.points[:, 1], 1.0)  # the side towards it
    small = zo.scan("car.obj", "pinhole:width=20,height=20,fov=20,noise=0", range=15, azimuth=90, size=2.0)
    np.testing.assert_allclose(small.points[:, 1], 0.5)
    for name in ("s.ply", "s.npz", "s.pcd", "s.npy", "s.csv"):
        found.save(name)
    with np.load("s.npz") as stored:
        np.testing.assert_array_equal(stored["points"], found.points)
        assert {"ranges", "rings", "intensities", "origin"} <= set(stored)
    assert np.array_equal(load_cloud("s.ply"), found.points)
    assert len(found.to_open3d().points) == len(np.asarray(found)) == len(found)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"range": -1}, "range must be metres above 0; got -1"),
        ({"azimuth": 3}, "azimuth and elevation must go with range"),
        ({"range": 9, "pose": np.eye(4)}, "give pose or range, not both"),
        ({"range": 9, "size": "large"}, "size must be metres above 0"),
    ],
)
def test_bad_scans(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(zo.ArgumentError, match=message):
        zo.scan("car.obj", "vlp-16", **arguments)


def test_a_depth_image_is_the_distance_along_the_axis() -> None:
    depth = zo.depth_image(PLATES, azimuth=0, elevation=90, distance=4, resolution=50)
    seen = np.isfinite(depth)
    np.testing.assert_allclose(depth[seen], 4.25 - 0.5)
    assert seen.mean() == pytest.approx(1 / 1.1**2, abs=0.05)
    wide = zo.depth_image(PLATES, azimuth=0, elevation=90, distance=4, resolution=50, fov=60)
    assert np.isfinite(wide).mean() == pytest.approx((0.5 / (3.75 * math.tan(math.pi / 6))) ** 2, abs=0.03)


@pytest.mark.gl
def test_a_depth_image_is_the_depth_buffers(gl: GlContext) -> None:
    view = zo.views.for_mesh("chair.off", zo.views.from_angles(30, 20))
    ours, theirs = (
        zo.depth_image("chair.off", eye=view, resolution=64),
        render_depth(gl, zo.load_mesh("chair.off"), view, 64),
    )
    both = np.isfinite(ours) & np.isfinite(theirs)
    assert both.mean() > 0.95 * np.isfinite(theirs).mean() > 0.05
    np.testing.assert_allclose(ours[both], theirs[both], rtol=1e-4)


def test_one_eye_several_and_views_are_asked_alike() -> None:
    points, views = zo.sample_surface("chair.off", n_points=100), zo.views.for_mesh("chair.off", "ring:4@20")
    with zo.prepare("chair.off", "exact") as occluder:
        mask = occluder.visible(points, views)
        assert mask.shape == (4, 100)
        np.testing.assert_array_equal(occluder.visible(points, views.eyes), mask)
        np.testing.assert_array_equal(occluder.visible(points, views.eyes[2]), mask[2])
        np.testing.assert_array_equal(occluder.visible(points, views[2]), mask[2:3])
        narrow = views.looking(field_of_view=0.05)
        np.testing.assert_array_equal(occluder.visible(points, narrow), mask & narrow.in_frustum(points.positions))
    np.testing.assert_array_equal(points[mask[0]].positions, points.positions[mask[0]])
    assert zo.METHODS["exact"].name == "exact"
    assert zo.METHODS[0].name == "depth_buffer"
    assert [view.azimuth[0] for view in views] == views.azimuth.tolist()


def test_public_objects_are_shown_in_one_line() -> None:
    cloud = zo.occlude("car.obj", azimuth=0, elevation=0, n_points=5)
    scan = zo.scan("car.obj", "vlp-16", range=9)
    for shown in (
        cloud,
        scan,
        zo.sensors.make("hdl-64e"),
        zo.views.paper100(),
        zo.sample_surface("car.obj", n_points=1),
    ):
        assert "\n" not in repr(shown)
        assert len(repr(shown)) < 120
    assert repr(cloud).startswith("PartialCloud(5 points, ")


def test_dir_shows_the_public_face_only() -> None:
    assert set(dir(zo)) == {*zo.__all__, "__version__", "torch"}
    for module in (zo.views, zo.sensors, zo.scenes):
        assert dir(module) == sorted(module.__all__)
    assert zo.torch.CloudDataset.__name__ == "CloudDataset"


def face() -> dict[str, Any]:
    """What has examples: all of the face that can be called but exceptions, and functions of its modules."""
    found = {name: getattr(zo, name) for name in zo.__all__ if callable(getattr(zo, name))}
    for module in (zo.views, zo.sensors, zo.scenes):
        members = ((name, getattr(module, name)) for name in module.__all__)
        found |= {f"{module.__name__}.{name}": each for name, each in members if inspect.isfunction(each)}
    return {name: each for name, each in found.items() if not (inspect.isclass(each) and issubclass(each, Exception))}


def train_pointnet() -> None:
    """Train a classifier that knows chairs alone, into the folder pointnet."""
    pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")
    from zbuf_occlude.studies.learn.data import CloudSet
    from zbuf_occlude.studies.learn.training import TrainConfig, train

    clouds = [zo.occlude("chair.off", azimuth=45 * i, elevation=20, n_points=64, seed=i).points for i in range(8)]
    chairs = CloudSet(np.stack(clouds), np.zeros(8), ("chair", "lamp"), np.arange(8), np.zeros(8))
    train(TrainConfig("pointnet", epochs=5, batch_size=4), chairs, chairs, Path("pointnet"))


@pytest.mark.parametrize("name", [pytest.param(name, marks=[OPEN3D] * (name == "compare_scans")) for name in face()])
def test_the_examples_are_true(name: str) -> None:
    if name == "load_classifier":
        train_pointnet()
    (test,) = doctest.DocTestFinder(recurse=False).find(face()[name], name, globs={"zo": zo, "np": np})
    assert test.examples, f"{name} must have Examples"
    said: list[str] = []
    doctest.DocTestRunner().run(test, out=said.append)
    assert not said, "".join(said)


def test_without_torch_one_line_says_what_it_needs() -> None:
    program = (
        "import sys; sys.modules['torch'] = None\nimport importlib.util\nfind = importlib.util.find_spec\n"
        "importlib.util.find_spec = lambda name, *more: None if name == 'torch' else find(name, *more)\n"
        "try:\n    from zbuf_occlude.datasets.torch import CloudDataset\n"
        "except Exception as error:\n    print(type(error).__name__, error)"
    )
    said = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert said.startswith(
        "UnavailableError zbuf_occlude.datasets.torch needs the package torch; install it: pip install"
    )


def test_a_mistyped_argument_names_the_class_that_was_called() -> None:
    pytest.importorskip("torch")
    with pytest.raises(TypeError, match=r"CloudDataset\.__init__\(\) got an unexpected keyword argument 'n_point'"):
        zo.torch.CloudDataset("nowhere", n_point=3)
