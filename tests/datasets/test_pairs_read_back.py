"""Pairs in layouts of completion, read back and in the camera's frame: of a slab, where what is visible is known."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.datasets.test_export import plan, slab
from zbuf_occlude import DatasetError, OptionError
from zbuf_occlude.datasets.folder import read_finished
from zbuf_occlude.datasets.formats import find_format
from zbuf_occlude.datasets.generate import generate
from zbuf_occlude.datasets.plan import DatasetConfig
from zbuf_occlude.datasets.source import open_dataset

pytestmark = pytest.mark.usefixtures("no_pictures")
LAYOUTS = ["pcn", "completion3d", "epn3d", "mvp", "projected-shapenet"]
OF_ONE_FRAME = ["pcn", "mvp", "projected-shapenet", "pairs", "shapenet55"]
SIDES = np.concatenate([np.eye(3), -np.eye(3)])


def changes(format: str) -> dict[str, Any]:
    size = find_format(format).options.get("sample_size", 128)
    return {"sample_size": size, "views": "random:1" if format == "completion3d" else plan(format).config.views}


def sides_of(points: np.ndarray) -> np.ndarray:
    """Whether each point lies on each side, (n, 6), two at an edge; points are of the slab, in its coordinates."""
    mesh = slab()
    heights = ((points - mesh.centre) / (np.ptp(mesh.bounds, axis=0) / 2)) @ SIDES.T
    assert heights.max(axis=1) == pytest.approx(1.0, abs=3e-4)
    return heights > 1.0 - 6e-4


def all_seen(points: np.ndarray, eye: np.ndarray) -> bool:
    """Whether all points of the slab lie on a side that the eye is in front of."""
    mesh = slab()
    in_front = ((eye - mesh.centre) / (np.ptp(mesh.bounds, axis=0) / 2)) @ SIDES.T > 1.0
    return bool((sides_of(points) & in_front).any(axis=1).all())


def in_mesh(record: Any, pose: np.ndarray, frame: str) -> np.ndarray:
    points = record["data"] / record["factor"] + record["centre"]
    return (points - pose[:3, 3]) @ pose[:3, :3] if frame == "camera" else points


def check(out: Path, config: DatasetConfig) -> int:
    """Partial clouds lie on the sides that their eye sees, complete ones on all six; return the number of clouds."""
    source = open_dataset(out, to_show=True)
    assert source.complete is not None
    records = source.take(np.concatenate(list(source.order.values())))
    for record in records:
        pose = record["pose"]
        flip = np.diag([1, -1, -1]) if config.axes == "opencv" else np.eye(3)
        eye = -pose[:3, :3].T @ pose[:3, 3]
        back = (flip @ pose[:3, :3])[2]  # of OpenGL's axes: from what is looked at to the eye
        assert (eye - slab().centre) / np.linalg.norm(eye - slab().centre) == pytest.approx(back, abs=1e-6)
        assert all_seen(in_mesh(record, pose, config.frame), eye)
        whole = source.complete(record, 700)
        assert whole["data"].shape == (700, 3)
        assert sides_of(in_mesh(whole, pose, config.frame)).any(axis=0).all()
    return len(records)


@pytest.mark.parametrize("format", LAYOUTS)
def test_what_is_written_is_read_back_z_up(format: str, tmp_path: Path) -> None:
    made = plan(format, **changes(format))
    manifest = generate(made, tmp_path / "out")
    assert check(tmp_path / "out", made.config) == sum(manifest["counts"]["clouds_by_split"].values())


@pytest.mark.parametrize("format", ["completion3d", "epn3d"])
@pytest.mark.parametrize("scale", ["object", "mesh"])
@pytest.mark.parametrize("axes", ["opengl", "opencv"])
def test_pairs_in_the_cameras_frame(format: str, scale: str, axes: str, tmp_path: Path) -> None:
    made = plan(format, **changes(format) | {"frame": "camera", "scale": scale, "axes": axes})
    generate(made, tmp_path / "out")
    check(tmp_path / "out", made.config)
    words = {"opengl": ["right", "up", "backwards"], "opencv": ["right", "down", "forward"]}
    assert read_finished(tmp_path / "out")[1]["axes"] == words[axes]
    source = open_dataset(tmp_path / "out", to_show=True)
    forward = 1 if axes == "opencv" else -1
    for record in source.take(np.concatenate(list(source.order.values()))):
        if scale == "mesh":  # 16 units before the camera, whose origin it is; half its diagonal is 2.3
            assert np.abs(forward * record["data"][:, 2] - 16.0).max() < 2.4
            assert np.abs(record["data"][:, :2].mean(axis=0)).max() < 1.5
        else:
            assert np.ptp(record["data"], axis=0).max() <= 21**0.5 / 4 + 1e-3
            assert forward * record["data"][:, 2].mean() < 0.0, "the side towards the camera"


@pytest.mark.parametrize("format", OF_ONE_FRAME)
def test_layouts_of_one_complete_cloud_refuse_the_cameras_frame_and_name_those_that_do_not(format: str) -> None:
    made = plan(format, frame="camera", sample_size=find_format(format).options.get("sample_size", 128))
    expected = "completion3d or epn3d; or packed" if format in [*LAYOUTS, "shapenet55"] else "in one frame"
    with pytest.raises(OptionError, match=expected):
        find_format(format).check(made)
    with pytest.raises(OptionError, match="axes opencv must be of the camera's frame"):
        plan(format, axes="opencv")


@pytest.mark.needs("open3d")
@pytest.mark.parametrize("format", ["pcn", "projected-shapenet"])
def test_partial_clouds_of_varying_length_as_the_originals(format: str, tmp_path: Path) -> None:
    import open3d

    made = plan(format, sample_size=None, attributes=("normals",))
    generate(made, tmp_path / "out")
    check(tmp_path / "out", made.config)
    pattern = "train/partial/*/*/*.pcd" if format == "pcn" else "projected_partial_noise/*/*/models/*.pcd"
    fields = np.concatenate([np.load(path) for path in (tmp_path / "out").glob("clouds_*.npy")])
    sizes = []
    for path in sorted((tmp_path / "out").glob(pattern)):
        cloud = open3d.io.read_point_cloud(str(path))
        points, normals = np.asarray(cloud.points)[:, [0, 2, 1]] * [1, -1, 1], np.asarray(cloud.normals)
        sides = sides_of(points * 4 + slab().centre)
        up = normals[:, [0, 2, 1]] * [1, -1, 1]
        # a point on an edge may be seen from behind its face: its normal is turned towards the camera
        assert ((up @ SIDES.T > 1.0 - 1e-6) & sides).any(axis=1).mean() > 0.999
        sizes.append(len(points))
    assert len(set(sizes)) > 4
    assert set(sizes) <= set(fields["n_visible"].tolist())


def test_a_lost_file_is_named(tmp_path: Path) -> None:
    generate(plan("completion3d", **changes("completion3d")), tmp_path / "out")
    source = open_dataset(tmp_path / "out", to_show=True)
    gone = next((tmp_path / "out").glob("train/partial/*/*.h5"))
    gone.unlink()
    with pytest.raises(DatasetError, match=gone.name):
        source.take(np.arange(4))
    generate(plan("shapenet55"), tmp_path / "whole")
    with pytest.raises(DatasetError, match="shapenet55"):
        open_dataset(tmp_path / "whole", to_show=True)
