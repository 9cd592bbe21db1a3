"""Normals and colours of points, in every format: a cube whose colour at a place is the place, so each point tells."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.scenes import box
from zbuf_occlude import Mesh
from zbuf_occlude.datasets.formats import FORMATS, find_format
from zbuf_occlude.datasets.generate import generate
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.datasets.source import open_dataset
from zbuf_occlude.datasets.verify import verify
from zbuf_occlude.geometry.colors import GREY, WHITE, SurfaceColors
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.sensors import make
from zbuf_occlude.sensors.scan_config import ScanConfig

pytestmark = pytest.mark.usefixtures("no_pictures")
N_POINTS = {"pcn": 16_384, "projected-shapenet": 8_192, "shapenet55": 8_192, "mvp": 2_048, "completion3d": 2_048}


def painted() -> Mesh:
    """The unit cube at (5, 0, 0); red, green and blue are x, y and z from its lower corner."""
    cube = box((1.0, 1.0, 1.0))
    vertices = cube.vertices - cube.bounds[0]
    colors = SurfaceColors((WHITE,), np.zeros(len(cube.faces), np.int32), vertices[cube.faces])
    return Mesh(vertices + np.array([5.0, 0, 0]), cube.faces, "painted", colors=colors)


def bare() -> Mesh:
    return box((1.0, 1.0, 1.0)).transformed(1.0, [5.5, 0.5, 0.5])


def plan(format: str, load: Callable[[], Mesh] = painted, **config: object) -> Plan:
    row = find_format(format)
    drawn = {name: value for name, value in row.options.items() if name in ("views", "sample_size", "scale")}
    settings = {"views": "fibonacci:5", "sample_size": 200, **drawn, "n_points": N_POINTS.get(format, 1_000), **config}
    made = DatasetConfig(method="oracle", attributes=("colors", "normals"), complete=row.complete, **settings)
    label = "table" if row.class_list else "cube"
    entries = [MeshEntry(f"cube/{split}/cube_{split}", label, split, load) for split in ("train", "test")]
    return Plan(MeshCollection(entries), made, format)


def check(records: np.ndarray, plan: Plan, *, within: float) -> None:
    """Every point lies on the cube, has the colour of its place and the normal of its side, towards the eye."""
    for record in records:
        rotation, translation = record["pose"][:3, :3], record["pose"][:3, 3]
        positions, normals = record["data"] / record["factor"] + record["centre"], record["normal"].astype(float)
        if plan.config.frame == "camera":
            positions, normals = (positions - translation) @ rotation, normals @ rotation
        place = positions - [5.0, 0.0, 0.0]
        assert np.abs(record["color"] - 255 * place).max() <= 255 * within + 0.6
        axis = np.argmin(np.minimum(np.abs(place), np.abs(1 - place)), axis=1)
        assert np.abs(np.abs(np.take_along_axis(normals, axis[:, None], 1)) - 1).max() < 1e-5
        if not plan.config.complete:
            eye = -rotation.T @ translation
            assert ((eye - positions) * normals).sum(axis=1).min() > -1e-4


@pytest.mark.parametrize("format", [row.name for row in FORMATS if not row.exported_from])
def test_every_format_gives_back_the_normals_and_colours_of_its_points(format: str, tmp_path: Path) -> None:
    made = plan(format)
    manifest = generate(made, tmp_path / "out")
    assert manifest["counts"]["meshes_without_colors"] == 0
    source = open_dataset(tmp_path / "out")
    for numbers in source.order.values():
        check(source.take(numbers), made, within=2e-5)
    assert source.n_clouds == {"train": 5, "test": 5}
    assert verify(tmp_path / "out", MeshCollection(made.meshes)).faults == []


def test_the_same_clouds_with_attributes_and_without(tmp_path: Path) -> None:
    generate(plan("npz"), tmp_path / "with")
    without = plan("npz")
    without = Plan(without.meshes, DatasetConfig(**{**without.config.to_dict(), "attributes": ()}), "npz")
    generate(without, tmp_path / "without")
    with (
        np.load(tmp_path / "with" / "train-000000.npz") as one,
        np.load(tmp_path / "without" / "train-000000.npz") as two,
    ):
        assert set(one) - set(two) == {"normal", "color"}
        np.testing.assert_array_equal(one["data"], two["data"])


@pytest.mark.needs("open3d")
def test_open3d_reads_normals_and_colours_of_pcd(tmp_path: Path) -> None:
    import open3d as o3d

    generate(plan("pcn"), tmp_path)
    for path, n in (("complete/cube/cube_train.pcd", 16_384), ("partial/cube/cube_train/03.pcd", 200)):
        cloud = o3d.io.read_point_cloud(str(tmp_path / "train" / path))
        positions, colors, normals = (np.asarray(each) for each in (cloud.points, cloud.colors, cloud.normals))
        assert positions.shape == colors.shape == normals.shape == (n, 3)
        own = positions[:, [0, 2, 1]] * [1, -1, 1]  # y is up there
        np.testing.assert_allclose(colors, own + 0.5, atol=0.004)  # the whole cube is centred, its side 1
        np.testing.assert_allclose(np.abs(normals).max(axis=1), 1, atol=1e-6)


@pytest.mark.parametrize("format", ["hdf5", "packed"])
def test_scans_have_the_colours_that_their_rays_met(format: str, tmp_path: Path) -> None:
    scan = ScanConfig(make("vlp-16"), range=(4.0, 4.0), size={"cube": 1.0}, scene="ground", keep="all")
    made = plan(format, scan=scan, views="ring:3@20", scale="mesh", sample_size=None)
    generate(made, tmp_path)
    source = open_dataset(tmp_path)
    for record in np.concatenate([source.take(numbers) for numbers in source.order.values()]):
        target = record["instance"] == 0
        # the middle of the box is the origin; ranges err by 3 cm, those of mixed points at edges by more
        place = record["data"][target] / record["factor"] + record["centre"] + 0.5
        assert target.sum() > 50
        assert not target.all()
        assert np.quantile(np.abs(record["color"][target] / 255 - place), 0.95) < 0.1
        assert (record["color"][~target] == GREY).all()
    assert verify(tmp_path, MeshCollection(made.meshes)).faults == []


def test_a_mesh_without_colours_is_grey_and_counted(tmp_path: Path) -> None:
    manifest = generate(plan("npz", bare), tmp_path)
    assert manifest["counts"]["meshes_without_colors"] == 2
    with np.load(tmp_path / "train-000000.npz") as archive:
        assert (archive["color"] == GREY).all()


def test_colours_stay_with_their_points() -> None:
    colors = np.arange(12, dtype=np.uint8).reshape(4, 3)
    points = SurfacePoints(np.zeros((4, 3)), np.full(4, -1), np.zeros((4, 3)), colors)
    np.testing.assert_array_equal(points.select([2, 0]).colors, colors[[2, 0]])
    np.testing.assert_array_equal(points.transformed(2.0).colors, colors)
    with pytest.raises(ValueError, match=r"colors must be \(4, 3\) uint8; got \(4, 3\) int64"):
        SurfacePoints(np.zeros((4, 3)), np.full(4, -1), np.zeros((4, 3)), colors.astype(int))
