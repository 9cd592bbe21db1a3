"""`compare-scans` from the command line: real scans of the bunny; wrong scans, poses and options."""

import json
from pathlib import Path

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.cli.conftest import Run
from tests.scenes import DATA
from zbuf_occlude.sensors import look_at, make
from zbuf_occlude.studies.compare.scan_comparison import NOT_SEEN

pytestmark = pytest.mark.needs("open3d")

BUNNY = DATA / "scans" / "bunny"


@pytest.fixture
def triangle(run: Run, tmp_path: Path) -> str:
    (tmp_path / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    return "m.obj"


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.txt", b"1 2 3", "must end in"),
        ("a.bin", b"123", "float32"),
        ("a.ply", b"ply\n", "cannot read"),
        ("a.npy", b"no", "cannot read"),
        ("e.bin", b"", "must have points"),
        ("a.png", b"no", "cannot read"),
    ],
)
def test_files_that_are_no_scan(run: Run, triangle: str, name: str, content: bytes, words: str) -> None:
    Path(name).write_bytes(content)
    error = run(f"compare-scans {triangle} {name} --sensor kinect-v1 --out o", code=1, says=words).err
    assert name in error
    assert len(error.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1 2 3", "12 or 16"),
        ("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 5", "last row"),
        ("2 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1", "rigid"),
        ("x", "cannot read"),
        ("", "pose for each"),
    ],
)
def test_poses_that_are_none(run: Run, triangle: str, text: str, words: str) -> None:
    np.save("s.npy", np.eye(3))
    Path("p.txt").write_text(text)
    run(f"compare-scans {triangle} s.npy --poses p.txt --out o", code=1, says=words)


@pytest.mark.parametrize("factor", [1000.0, 1.0])
def test_a_scan_that_is_elsewhere_is_no_success(run: Run, tmp_path: Path, factor: float) -> None:
    """Wrong unit and missing pose: nothing is written."""
    (tmp_path / "m.obj").write_text(f"v 0 0 0\nv {factor} 0 0\nv 0 {factor} 0\nf 1 2 3\n")
    np.save("s.npy", np.random.default_rng(0).uniform(3.0, 4.0, (500, 3)))
    error = run("compare-scans m.obj s.npy --sensor kinect-v1 --out o", code=1, says="near the mesh").err
    assert ("1,000 times" in error) == (factor == 1000.0)
    assert not (tmp_path / "o").exists()


@pytest.fixture
def bunny() -> Path:
    if not (BUNNY / "bun.conf").exists():
        pytest.skip(f"no scans of the bunny in {BUNNY}; set ZBUF_OCCLUDE_DATA")
    return BUNNY


def test_the_bunny_is_scanned_as_it_was(bunny: Path, run: Run, tmp_path: Path) -> None:
    """Real scans by a laser on a stage: agreement 0.92, 0.5 % of the points hidden."""
    scans = " ".join(f"{bunny}/{name}.ply" for name in ("bun000", "bun180", "top2"))
    eye = "--eye 0,0.178,1.3 --look-at 0,0.178,0 --up-axis 0,1,0"
    run(f"compare-scans {bunny}/bun_zipper.ply {scans} --sensor cyberware-3030 --poses {bunny}/bun.conf {eye} --out .")
    found = json.loads((tmp_path / "scans.json").read_text())["scans"]
    assert np.mean([each["agreement"] for each in found]) >= 0.92
    assert max(each["false_hidden"] for each in found) <= 0.005
    assert {path.name for path in tmp_path.iterdir()} >= {"scans.html", "scans.md", "scan_0.png", "scan_2.png"}
    one_eye = zo.compare_scans(
        bunny / "bun_zipper.ply",
        [bunny / "bun000.ply"],
        make("cyberware-3030", baseline=0, incidence_max=90),
        poses=bunny / "bun.conf",
        sensor_pose=look_at([0, 0.178, 1.3], [0, 0.178, 0], [0, 1, 0]),
    )[0]
    assert one_eye.agreement < found[0]["agreement"] - 0.02
    assert one_eye.share(NOT_SEEN) < 0.01
