"""Names that people type: the Python API, and every command with every option of options.json."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import zbuf_occlude as zo
from tests.needs import lacking
from tests.net import options
from tests.net.digests import write_meshes

OPTIONS = json.loads(Path(__file__).with_name("options.json").read_text())
EXACT = {"exact", "exact_gl", "oracle", "warp"}
WITH_GL = {"depth_buffer", "exact_gl"}
EXTRAS = {"embree": "embree", "pyrender": "pyrender", "hidden_point_removal": "open3d", "warp": "warp"}
OTHERS = {"exact_hsr", "vertex_hsr", "vertex_hsr_culled", "occupancy_grid"}
CASTERS = ("oracle", "exact", "embree", "warp", "depth_buffer")
ERRORS = ("ArgumentError", "DatasetError", "GlError", "MeshError", "OptionError", "UnavailableError")

REPLACED = {"experiment", "figure"}
"""Names that are listed no more, and go on working; `options.py` finds none of theirs: keep their entries."""

every_command = pytest.mark.parametrize("name", OPTIONS)


def _marks(name: str) -> list[pytest.MarkDecorator]:
    if name in WITH_GL:
        return [pytest.mark.gl]
    return [pytest.mark.needs(zo.METHODS[name].requires)] if name in EXTRAS else []


def with_gl(*names: str) -> list[Any]:
    return [pytest.param(name, marks=_marks(name)) for name in names]


@pytest.fixture(scope="module")
def off(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plate at z = 1 that hides, from above, the middle of one at z = 0 of twice its size; one face has no area."""
    path = tmp_path_factory.mktemp("plates") / "plates.off"
    path.write_text(
        "OFF\n8 5 0\n-2 -2 0\n2 -2 0\n2 2 0\n-2 2 0\n-1 -1 1\n1 -1 1\n1 1 1\n-1 1 1\n"
        "3 0 0 1\n3 0 1 2\n3 0 2 3\n3 4 5 6\n3 4 6 7\n"
    )
    return path


@pytest.fixture(scope="module")
def mesh(off: Path) -> zo.Mesh:
    return zo.load_mesh(off)


def test_meshes(off: Path, mesh: zo.Mesh) -> None:
    assert (mesh.vertices.shape, mesh.vertices.dtype) == ((8, 3), np.float64)
    assert (mesh.faces.shape, mesh.faces.dtype) == ((4, 3), np.int32)
    assert mesh.source_face_ids.tolist() == [1, 2, 3, 4]
    whole = mesh.normalized().vertices
    assert np.ptp(whole, axis=0).max() == 1.0
    np.testing.assert_allclose(whole.max(axis=0) + whole.min(axis=0), 0.0, atol=1e-12)
    for other in (zo.Mesh(mesh.vertices, mesh.faces), zo.Mesh.from_trimesh(trimesh.load_mesh(off, process=False))):
        np.testing.assert_array_equal(other.vertices, mesh.vertices)
    collection = zo.MeshCollection.from_paths([off])
    assert [(entry.key, len(entry.load().faces)) for entry in collection] == [("plates.off", 4)]


def test_points(mesh: zo.Mesh) -> None:
    points = zo.sample_surface(mesh, n_points=500, seed=0)
    assert (points.positions.shape, points.positions.dtype) == ((500, 3), np.float64)
    assert (points.face_ids.shape, points.normals.shape) == ((500,), (500, 3))
    assert set(points.face_ids.tolist()) == {0, 1, 2, 3}
    np.testing.assert_array_equal(points.positions, zo.sample_surface(mesh, n_points=500, seed=0).positions)
    assert 15 * 20 < len(zo.sample_surface(mesh, density=20, seed=0)) < 25 * 20  # an area of 20
    free = zo.SurfacePoints.free(points.positions)
    assert (free.face_ids == -1).all()


@pytest.mark.parametrize(
    ("views", "n_views"),
    [
        (zo.views.paper100(distance=4.0), 100),
        (zo.views.modelnet8(), 25),
        (zo.views.ring(8, elevation=30), 8),
        (zo.views.fibonacci(7), 7),
        (zo.views.parse("grid:3x4"), 12),
        (zo.views.parse("random:5@0..50"), 5),
    ],
)
def test_views(views: Any, n_views: int) -> None:
    assert isinstance(views, zo.Views)
    assert views.eyes.shape == (n_views, 3)
    assert views.azimuth.shape == views.elevation.shape == views.distance.shape == (n_views,)
    np.testing.assert_allclose(np.linalg.norm(views.eyes, axis=1), views.distance)
    np.testing.assert_allclose(views.eyes[:, 2], views.distance * np.sin(views.elevation), atol=1e-9)


def test_the_table_of_methods() -> None:
    rows = {row.name: (row.exact, row.needs_gl, row.extra) for row in zo.METHODS}
    names = EXACT | WITH_GL | EXTRAS.keys() | OTHERS
    assert rows == {name: (name in EXACT, name in WITH_GL, EXTRAS.get(name, "")) for name in names}
    assert all(row.summary for row in zo.METHODS)
    assert [row.name for row in zo.METHODS if row.missing() and not lacking(row.requires)] == []


@pytest.mark.parametrize("name", with_gl(*sorted(EXACT | WITH_GL | EXTRAS.keys() | OTHERS)))
def test_methods(name: str, mesh: zo.Mesh) -> None:
    points = zo.SurfacePoints(
        [[0.1, 0.2, 0.0], [1.7, 1.8, 0.0], [0.3, 0.1, 1.0]],
        face_ids=[0, 0, 2],
        normals=np.tile([0.0, 0.0, 1.0], (3, 1)),
    )
    eyes = [[0.0, 0.0, 20.0], [0.0, 0.0, -20.0]]
    chosen = {"resolution": 128} if name == "depth_buffer" else {}
    with zo.prepare(mesh, method=name, **chosen) as occluder:
        mask = occluder.visible(points, eyes)
    assert (mask.shape, mask.dtype) == ((2, 3), np.bool_)
    if name in EXACT | {"depth_buffer", "embree", "pyrender"}:
        assert mask.tolist() == [[False, True, True], [True, True, False]]


@pytest.mark.parametrize("name", with_gl(*CASTERS))
def test_first_hits(name: str, mesh: zo.Mesh) -> None:
    with zo.prepare(mesh, method=name) as occluder:
        hits = occluder.first_hits([[0.1, 0.2, 5.0]], [[0.0, 0.0, -1.0], [0.3, 0.3, -1.0], [0.0, 0.0, 1.0]])
    assert hits.face_ids[1] in (0, 1)
    assert (hits.face_ids[0], hits.face_ids[2]) == (3, -1)
    np.testing.assert_allclose(hits.distances, [4.0, 5.0 * np.sqrt(1.18), np.inf], rtol=1e-6)


def test_sensors_and_scans(mesh: zo.Mesh, tmp_path: Path) -> None:
    sensor = zo.sensors.make("vlp-32c", columns=180, noise=0)
    assert sensor.rays().directions.shape == (32 * 180, 3)
    assert {"vlp-16", "hdl-32e", "hdl-64e", "vls-128", "os1-64"} <= zo.sensors.SENSORS.keys()
    mine = tmp_path / "mine.yaml"
    mine.write_text("kind: spinning\nlasers: [-2, 0, 2]\ncolumns: 36\nsource: mine\n")
    for name, n_rays in ((mine, 108), ("pinhole:width=8,height=6,fov=60", 48)):
        rays = zo.sensors.make(name).rays()
        assert rays.directions.shape == (n_rays, 3)
        assert rays.rings.shape == rays.columns.shape == (n_rays,)
    pose = zo.sensors.look_at([-15, 0, 1.5], [0, 0, 0.5])
    assert pose.shape == (4, 4)
    placed = zo.scenes.Placed(mesh, "plates"), zo.scenes.Placed(mesh, "others", zo.scenes.moved(to=(3.0, 0.0, 0.0)))
    scene = zo.Scene.joined(placed)
    scan = zo.scan(scene, sensor, pose, seed=0)
    assert len(scan) > 20
    assert scan.positions.shape == scan.normals.shape == (len(scan), 3)
    for field in ("ranges", "clean_ranges", "incidences", "intensities", "rings", "columns", "instances", "n_returns"):
        assert getattr(scan, field).shape == (len(scan),), field
    assert set(scan.instances.tolist()) == {0, 1}
    np.testing.assert_allclose(np.linalg.norm(scan.positions - [-15, 0, 1.5], axis=1), scan.ranges)


def test_errors(mesh: zo.Mesh) -> None:
    assert all(issubclass(getattr(zo, name), zo.OccludeError) for name in ERRORS)
    with pytest.raises(zo.OptionError, match="depth_buffer"):
        zo.prepare(mesh, "zbuffer")
    with pytest.raises(ValueError, match=r"\(3, 100\)"):
        zo.SurfacePoints.free(np.zeros((3, 100)))
    with pytest.raises(zo.MeshError, match="nothere"):
        zo.load_mesh("nothere.off")


def test_commands_are_all_there() -> None:
    assert set(OPTIONS) - REPLACED <= set(options.commands())


@every_command
def test_a_command_takes_its_options_and_helps(name: str) -> None:
    given, argument = dict(OPTIONS[name]), OPTIONS[name]["argument"]
    del given["argument"]
    done = options.run(name, *(word for option, metavar in given.items() for word in options.use(option, metavar)))
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"Usage: zbuf-occlude {name}")
    now = options.shown(done.stdout)
    for option, metavar in given.items():
        assert options.choices(metavar) <= options.choices(now.get(option, metavar)), option
    assert options.choices(argument) <= options.choices(options.argument(done.stdout))


def test_an_option_that_is_not_there_is_refused() -> None:
    """As the test before needs: options are looked at before --help."""
    done = options.run("merge", "--no-such-option", "--help")
    assert (done.returncode, done.stdout) == (2, "")
    assert "--no-such-option" in done.stderr


def test_small_commands(off: Path, tmp_path: Path) -> None:
    cloud, scan = tmp_path / "cloud.ply", tmp_path / "scan.ply"
    exact = ("--method", "exact", "--azimuth", 30, "--elevation", 20)
    for line in (
        ("visible", off, *exact, "--points", 400, "--out", cloud),
        ("scan", off, *exact, "--sensor", "vlp-16", "--range", 5, "--size", "file", "--out", scan),
    ):
        done = options.run(*line)
        assert done.returncode == 0, done.stderr
    assert 200 < len(trimesh.load(cloud).vertices) <= 400  # type: ignore[attr-defined]
    assert len(trimesh.load(scan).vertices) > 20  # type: ignore[attr-defined]
    assert all(row.name in options.run("methods").stdout for row in zo.METHODS)
    assert "vlp-32c" in options.run("sensors").stdout


def test_a_dataset_by_commands(tmp_path: Path) -> None:
    meshes, out = write_meshes(tmp_path / "meshes"), tmp_path / "out"
    line = (
        "generate",
        meshes,
        "--views",
        "ring:2@20",
        "--method",
        "exact",
        "--points",
        100,
        "--limit",
        4,
        "--out",
        out,
    )
    codes = {"missing": 1, "usage": 2, "done": 0}
    assert options.run("generate", tmp_path / "nothere", "--out", out).returncode == codes["missing"]
    assert options.run(*line, "--views", "nothing:2").returncode == codes["usage"]
    assert options.run(*line, "--dry-run").returncode == codes["done"]
    assert not out.exists()
    assert options.run(*line).returncode == codes["done"]
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest.keys() >= {"seed", "options", "versions", "renderer", "counts", "failures", "seconds", "error"}
    assert manifest["error"].keys() >= {"false_visible", "false_hidden", "n_checked"}
    assert manifest["renderer"] == "none"
    for command in ("status", "verify", "merge"):
        done = options.run(command, out)
        assert done.returncode == codes["done"], done.stderr
    assert options.run("show", out, "--out", tmp_path / "sheet.html").returncode == codes["done"]
    assert options.run("status", tmp_path / "nothere").returncode == codes["missing"]
