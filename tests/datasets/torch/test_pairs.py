"""Pairs with the pose of the camera, stored and on the fly: what is visible of a box says where the camera is."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="PyTorch is not installed")

import zbuf_occlude as zo  # noqa: E402
from tests.datasets.test_export import slab  # noqa: E402
from tests.datasets.test_pairs_read_back import all_seen, sides_of  # noqa: E402
from zbuf_occlude.datasets.generate import generate  # noqa: E402
from zbuf_occlude.datasets.plan import DatasetConfig, Plan  # noqa: E402
from zbuf_occlude.datasets.torch import CompletionPairs, OnTheFlyOcclusion, OnTheFlyPairs, OnTheFlyScan  # noqa: E402
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry  # noqa: E402

FRAMES = [("object", "opengl"), ("camera", "opengl"), ("camera", "opencv")]


def check(partial: Any, complete: Any, pose: Any, frame: str, axes: str, scale: str, longest: float = 4.0) -> None:
    """Bring both clouds back by the pose: they lie on the slab's sides, the partial one on those that are seen.

    `longest` is the length of the slab's longest side where the scale is "mesh".
    """
    pose = pose.numpy().astype(float)
    assert pose[:3, :3] @ pose[:3, :3].T == pytest.approx(np.eye(3), abs=1e-6)
    unit, centre = (4.0 / longest, np.zeros(3)) if scale == "mesh" else (4.0, np.zeros(3))
    if scale == "mesh" and longest == 4.0:
        centre = -slab().centre  # in the file's coordinates
    clouds = [cloud.numpy().astype(float) for cloud in (partial, complete)]
    if frame == "camera":
        shift = pose[:3, 3] if scale == "mesh" else np.zeros(3)
        clouds = [(cloud - shift) @ pose[:3, :3] for cloud in clouds]
    in_mesh = [(cloud + centre) * unit + slab().centre for cloud in clouds]
    eye = (-pose[:3, :3].T @ pose[:3, 3] + centre) * unit + slab().centre
    assert all_seen(in_mesh[0], eye)
    assert sides_of(in_mesh[1]).any(axis=0).all()
    forward = pose[2, :3] * (1 if axes == "opencv" else -1)
    towards = slab().centre - eye
    assert forward == pytest.approx(towards / np.linalg.norm(towards), abs=1e-5)


@pytest.mark.parametrize(("frame", "axes"), FRAMES)
@pytest.mark.parametrize("scale", ["cloud", "mesh"])
def test_stored_pairs_have_their_pose(frame: str, axes: str, scale: str, tmp_path: Path) -> None:
    entries = [MeshEntry("slab", "slab", "train", slab)]
    views = {"views": "random:5", "n_points": 3000, "variations": 2}
    config = DatasetConfig(method="exact", scale=scale, frame=frame, axes=axes, **views)  # type: ignore[arg-type]
    generate(Plan(MeshCollection(entries), config, "packed"), tmp_path / "packed")
    pairs = CompletionPairs(tmp_path / "packed", n_partial=300, n_complete=500, return_pose=True)
    assert len(pairs) == 10
    for partial, complete, _, pose in (pairs[i] for i in range(len(pairs))):
        assert pose.dtype == torch.float32
        check(partial, complete, pose, frame, axes, "mesh" if scale == "mesh" else "object")
    assert len(CompletionPairs(tmp_path / "packed")[0]) == 3


@pytest.mark.parametrize(("frame", "axes"), FRAMES)
@pytest.mark.parametrize("scale", ["cloud", "mesh"])
def test_pairs_on_the_fly(frame: str, axes: str, scale: str) -> None:
    torch.manual_seed(1)
    pairs = OnTheFlyPairs(OnTheFlyOcclusion(200, scale=scale, frame=frame, axes=axes), n_complete=400)
    for _ in range(4):
        partial, complete, pose = pairs(slab())
        assert (partial.shape, complete.shape, pose.shape) == ((200, 3), (400, 3), (4, 4))
        check(partial, complete, pose, frame, axes, scale)


@pytest.mark.parametrize(("frame", "axes"), FRAMES)
@pytest.mark.parametrize("scale", ["cloud", "mesh"])
def test_pairs_of_scans_on_the_fly(frame: str, axes: str, scale: str) -> None:
    torch.manual_seed(1)
    sensor = zo.sensors.make("pinhole", width=40, height=30, fov=40.0, noise=0.0)
    placed = {"scale": scale, "frame": frame, "axes": axes}
    scan = OnTheFlyScan(100, sensor=sensor, range=(2, 3), size=1.0, elevation=(-60, 60), **placed)
    pairs = OnTheFlyPairs(scan, n_complete=300)
    for _ in range(3):
        partial, complete, pose = pairs(slab(), "slab")
        check(partial, complete, pose, frame, axes, scale, longest=1.0 if scale == "mesh" else 4.0)
        unit = 1.0
        assert 2.0 * unit <= float(torch.linalg.vector_norm(pose[:3, 3])) <= 3.0 * unit


def test_on_the_fly_takes_what_calls_take() -> None:
    """Elevations as one number, a pair or a text; views as a text or Views; clouds in the camera's frame."""
    torch.manual_seed(0)
    views = zo.views.ring(5, elevation=35, distance=3)
    for given in (
        {"elevation": 35},
        {"elevation": (35, 35)},
        {"elevation": "35..35"},
        {"views": "ring:7@35"},
        {"views": views},
    ):
        for partial in (
            OnTheFlyOcclusion(64, **given),  # type: ignore[arg-type]
            OnTheFlyScan(64, sensor="kinect-v1", range=2.0, size="1", **given),  # type: ignore[arg-type]
        ):
            _, _, pose = OnTheFlyPairs(partial, n_complete=64)(slab(), "slab")
            assert np.degrees(np.arcsin(float(pose[2, 2]))) == pytest.approx(35, abs=0.01)
    narrow = zo.views.ring(3, elevation=35).looking(field_of_view=np.radians(4))
    seen = OnTheFlyOcclusion(200, views=narrow, scale="mesh", frame="camera")(slab())
    tangents = seen[:, :2] / -seen[:, 2:]
    assert 0.9 * np.tan(np.radians(2)) < tangents.abs().max() <= np.tan(np.radians(2)) + 1e-6
    cloud = OnTheFlyOcclusion(500, scale="mesh", frame="camera", axes="opencv", attributes=("normals",))(slab())
    assert (cloud[:, 2] > 13).all()
    assert (torch.sum(cloud[:, :3] * cloud[:, 3:], dim=1) < 0).all(), "normals are turned towards the camera"


def test_what_pairs_refuse() -> None:
    with pytest.raises(zo.ArgumentError, match="partial must be an OnTheFlyOcclusion"):
        OnTheFlyPairs("packed")  # type: ignore[arg-type]
    with pytest.raises(zo.OptionError, match="n_complete"):
        OnTheFlyPairs(OnTheFlyOcclusion(), n_complete=0)
    with pytest.raises(zo.ArgumentError, match="views must be Views or a specification"):
        OnTheFlyScan(views=7)  # type: ignore[arg-type]
    with pytest.raises(zo.OptionError, match="axes opencv must be of frame 'camera'"):
        OnTheFlyScan(axes="opencv")
    with pytest.raises(zo.OptionError, match="elevation must be a number, or two"):
        OnTheFlyOcclusion(elevation="high")
    with pytest.raises(zo.OptionError, match="frame"):
        OnTheFlyOcclusion(frame="world")
    with pytest.raises(zo.OptionError, match="on a device must have frame 'object'"):
        OnTheFlyOcclusion(device="cpu", frame="camera")
    with pytest.raises(zo.OptionError, match="on a device must have no views"):
        OnTheFlyOcclusion(device="cpu", views="ring:3@0")
