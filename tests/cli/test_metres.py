"""Clouds of their true size, `--scale metres`: centred by their own boxes, nothing else changed, in every format."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.cli.conftest import Run, write_off
from tests.scenes import box
from zbuf_occlude.datasets.folder import read_finished
from zbuf_occlude.datasets.source import open_dataset
from zbuf_occlude.meshes import shapes

SCANS = "--shapes road-users --classes bus,pedestrian --limit 4 --sensor hdl-64e --range 9 --views ring:2@0"
SMALL = "--sample-size 200 --workers 1"


def records_of(out: Path) -> Any:
    source = open_dataset(out)
    records = source.take(np.concatenate(list(source.order.values())))
    return records[np.lexsort((records["view_id"], records["mesh_id"]))]


@pytest.mark.parametrize("frame", ["object", "camera"])
def test_scans_keep_their_size(run: Run, tmp_path: Path, frame: str) -> None:
    """Nothing but the centre differs from `--scale mesh`, metres about the object's middle."""
    for scale in ("metres", "mesh"):
        run(f"generate {SCANS} {SMALL} --frame {frame} --scale {scale} --out {scale}")
    found, plain = records_of(tmp_path / "metres"), records_of(tmp_path / "mesh")
    plan, _ = read_finished(tmp_path / "metres")
    assert len(found) == 8
    for mine, other in zip(found, plain, strict=True):
        low, high = other["data"].min(axis=0), other["data"].max(axis=0)
        assert np.allclose(mine["data"], other["data"] - (low + high) / 2, atol=1e-5)
        assert np.allclose(mine["data"] / mine["factor"] + mine["centre"], other["data"], atol=1e-5)
        label = plan.meshes[int(mine["mesh_id"])].label
        assert (np.ptp(mine["data"], axis=0).max() > 2.3) == (label == "bus")
    assert "the same" in run("verify metres --samples 2").out


def test_packed_and_published_layouts_too(run: Run, tmp_path: Path) -> None:
    """A box of 30 x 10 x 10 cm; the layout of ModelNet40-C has the longest side 2 of scaled clouds alone."""
    mesh = box((30.0, 10.0, 10.0))
    write_off(tmp_path / "meshes" / "car" / "train" / "brick.off", mesh.vertices, mesh.faces)
    options = f"--unit cm --views ring:2@30 --points 4000 --complete {SMALL}"
    for format in ("hdf5", "packed", "modelnet40-c"):
        run(f"generate meshes {options} --scale metres --format {format} --out {format}")
    clouds = [record["data"] for name in ("hdf5", "packed") for record in records_of(tmp_path / name)]
    clouds.extend(np.load(next((tmp_path / "modelnet40-c" / "train").glob("data_*_1.npy"))))
    for cloud in clouds:
        sides = np.sort(np.ptp(cloud, axis=0))
        assert sides == pytest.approx([0.1, 0.1, 0.3], abs=0.01)
        assert np.allclose(cloud.min(axis=0) + cloud.max(axis=0), 0.0, atol=1e-6)
    run("convert packed --format npz --out npz")
    assert (records_of(tmp_path / "npz")["factor"] == 1.0).all()


def test_lengths_must_be_metres(run: Run, tmp_path: Path) -> None:
    run("generate --scale metres --out out", code=2, says="give --unit of the files, or --sensor")
    line = f"generate {SMALL} --limit 1 --scale metres --format pcn --sensor vlp-16 --range 9 --size 1"
    run(f"{line} --out out", code=2, says="must have all clouds of an object in one frame; got --scale metres")
    line = line.replace("pcn", "epn3d")
    run(f"{line} --frame camera --sample-size 2048 --out out", code=2, says="Give --scale object or mesh.")
    out = f"generate --shapes road-users --classes pedestrian --limit 1 {SMALL} --views ring:1@0 --scale metres"
    run(f"{out} --method exact --out out")
    assert 1.0 < np.ptp(records_of(tmp_path / "out")[0]["data"], axis=0).max() < 2.0


def test_on_the_fly() -> None:
    torch = pytest.importorskip("torch", reason="PyTorch is not installed")
    from zbuf_occlude.datasets.torch import OnTheFlyOcclusion, OnTheFlyScan

    brick, given = box((4.0, 2.0, 2.0)), {"sensor": "vlp-32c", "numbers": {"noise": 0}, "range": 9.0, "size": "file"}
    for transform in (
        OnTheFlyScan(500, scale="metres", views="ring:1@0", **given),  # type: ignore[arg-type]
        OnTheFlyOcclusion(5_000, scale="metres", elevation=(0, 0)),
    ):
        torch.manual_seed(0)
        cloud = transform(brick, "brick").numpy() if isinstance(transform, OnTheFlyScan) else transform(brick).numpy()
        assert np.allclose(cloud.min(axis=0) + cloud.max(axis=0), 0.0, atol=1e-6)
        assert np.ptp(cloud[:, 1:], axis=0) == pytest.approx([2.0, 2.0], abs=0.3)
    person = shapes.traffic.make("pedestrian", 0)
    assert 1.0 < np.ptp(OnTheFlyScan(500, scale="metres", range=5.0, size="file")(person).numpy()[:, 2]) < 2.0
