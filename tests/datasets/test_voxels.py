"""`--format voxels` of a box: its complete and partial distances against closed forms, and the arrays by name."""

from pathlib import Path

import numpy as np
import pytest

from tests.scenes import box
from zbuf_occlude.base.errors import OptionError
from zbuf_occlude.datasets.generate import generate
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry

pytestmark = pytest.mark.needs("open3d")

SIDES = np.array([0.4, 0.3, 1.0])
N = 32


def plan(size: float = 1.0, **changes: object) -> Plan:
    mesh = box(tuple(SIDES)).transformed(size, (3.0 * size, 1.0 * size, 2.0 * size))
    config = DatasetConfig(method="exact", views="ring:2@0", n_points=500, sample_size=64, **changes)
    return Plan(MeshCollection([MeshEntry("crate/one.off", "crate", "train", lambda: mesh)]), config, "voxels")


@pytest.mark.parametrize(("scale", "size"), [("mesh", 1.0), ("object", 1.0), ("object", 1e60), ("object", 1e-60)])
def test_distances_of_a_box(tmp_path: Path, scale: str, size: float) -> None:
    generate(plan(size, scale=scale), tmp_path)
    (folder,) = (tmp_path / "train.txt").read_text().splitlines()
    centres = ((np.arange(N) + 0.5) / N - 0.5) * 1.1
    at = np.stack(np.meshgrid(centres, centres, centres, indexing="ij"), axis=-1)
    half = SIDES[[0, 2, 1]] / 2  # y is up, and z points towards -y
    outside = np.abs(at) - half
    closed = np.linalg.norm(np.maximum(outside, 0), axis=-1) + np.minimum(outside.max(axis=-1), 0)
    whole = np.load(tmp_path / folder / "gt.npz")
    assert whole["tsdf"].dtype == np.float32
    assert whole["tsdf"] == pytest.approx(np.clip(closed / 1.1, -3 / N, 3 / N), abs=1e-6)
    assert np.array_equal(whole["voxels"], closed < 0)
    first = np.load(tmp_path / folder / "input_0.npz")
    eye = (first["eye"] - 0.5) * 1.1
    assert eye[1:] == pytest.approx(0, abs=1e-9)
    assert eye[0] > half[0], "the first view of a ring stands on +x"
    t = (eye[0] - half[0]) / (eye[0] - at[..., 0])
    meets = (np.abs(t * at[..., 1]) < half[1]) & (np.abs(t * at[..., 2]) < half[2])
    along = (t - 1) * np.linalg.norm(at - eye, axis=-1)
    assert first["tsdf"][meets] == pytest.approx(np.clip(along / 1.1, -3 / N, 3 / N)[meets], abs=1e-6)
    assert (first["tsdf"][~meets] > 0).all()
    points = (first["points"] - 0.5) * 1.1
    assert points[:, 0] == pytest.approx(half[0], abs=1e-6), "of a box an eye on its axis sees one side"
    assert (np.abs(points[:, 1:]) <= half[1:] + 1e-6).all()


def test_what_has_no_voxels() -> None:
    from zbuf_occlude.datasets.formats import find_format

    with pytest.raises(OptionError, match="frame"):
        find_format("voxels").check(plan(frame="camera"))
