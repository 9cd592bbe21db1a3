"""`compare-drives`: a report of a log, and wrong arguments."""

from pathlib import Path

import pytest

from tests.cli.conftest import Run
from tests.studies.compare.test_drive_comparison import turn, write_kitti
from zbuf_occlude.sensors import make


def test_a_report(run: Run, tmp_path: Path) -> None:
    write_kitti(tmp_path / "log", turn(make("vlp-16", noise=0, columns=600)).points)
    outcome = run("compare-drives log --sensor vlp-16:columns=600 --out report.md")
    assert "KITTI, 3 sightings in 1 of 1 sweeps. Sensor: vlp-16 (told)" in outcome.out
    assert (tmp_path / "report.md").read_text().splitlines() == outcome.out.splitlines()
    (tmp_path / "log/training/velodyne/000009.bin").write_bytes(b"")
    run("compare-drives log --sensor vlp-16", says="skipped: ")


def test_a_lidar_of_ones_own_that_loses_no_returns(run: Run, tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("kind: spinning\nelevations: {from: -15, to: 15, n: 16}\ncolumns: 600\n")
    write_kitti(tmp_path / "log", turn(make("vlp-16", noise=0, columns=600)).points)
    said = run("compare-drives log --sensor mine.yaml").out
    assert "600 firings a turn, no lost returns." in said
    rows = [line.split(" | ") for line in said.splitlines() if line.startswith("| ") and ".." in line]
    assert len(rows) == 3
    for *_, simulated, _, without_dropout in rows:
        assert int(simulated) == pytest.approx(int(without_dropout.rstrip(" |")), rel=0.05)


def test_wrong_arguments(run: Run, tmp_path: Path) -> None:
    run("compare-drives nowhere", code=1, says="nowhere does not exist")
    (tmp_path / "empty").mkdir()
    run("compare-drives empty", code=1, says="must hold labelled sweeps")
    write_kitti(tmp_path / "log", turn(make("vlp-16", noise=0, columns=90)).points)
    run("compare-drives log --sensor vlp-17", code=2, says="one of vlp-16")
    run("compare-drives log --sensor mid-360", code=2, says="must be a spinning LiDAR; mid-360 is non_repetitive")
