"""The small commands: help, methods, doctor, visible; exit codes and error lines."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.cli.conftest import Run, write_off
from zbuf_occlude import METHODS, load_mesh
from zbuf_occlude.dataset.point_files import write_ply
from zbuf_occlude.gl.probe import Probe
from zbuf_occlude.meshes.load import load_cloud


@pytest.fixture
def plates(tmp_path: Path) -> Path:
    """A square plate at z = 1 that hides the middle of a larger one at z = 0 from above."""
    small, large = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]), 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    vertices = np.vstack([np.c_[large, np.zeros(4)], np.c_[small, np.ones(4)]])
    quad = np.array([[0, 1, 2], [0, 2, 3]])
    return write_off(tmp_path / "plates.off", vertices, np.vstack([quad, quad + 4]))


def test_standard_streams_may_be_closed(tmp_path: Path) -> None:
    """As daemons have them; what is opened next must not be taken for one of them, nor a bar fail for want of it."""
    options = "--limit 1 --method oracle --views ring:1@0 --points 50 --sample-size 8 --workers 1"
    command = f"exec {sys.executable} -m zbuf_occlude generate {options} --out out <&- >&- 2>&-"
    assert subprocess.run(["sh", "-c", command], cwd=tmp_path, check=False).returncode == 0
    assert (tmp_path / "out" / "manifest.json").is_file()


@pytest.mark.parametrize(
    ("before", "code", "said"),
    [
        (
            "export NUMBA_NUM_THREADS=0",
            2,
            "NUMBA_NUM_THREADS must be 1 or more; it is 0. Unset it, or give a number.",
        ),
        (
            "ulimit -v 200000",
            1,
            "a process must be allowed 786,432 kB of address space; this one is allowed 200,000 kB. Raise the limit, "
            "as ulimit -v 786432 does.",
        ),
        (
            'cd "$(mktemp -d)" && rmdir "$PWD"',
            1,
            "the current folder must be there; it has been removed. Change to another: cd.",
        ),
    ],
)
def test_a_shell_that_lets_nothing_compiled_run_is_told_in_a_line(before: str, code: int, said: str) -> None:
    command = f"{before}; exec {sys.executable} -m zbuf_occlude generate --limit 1 --dry-run"
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (code, "", f"error: {said}\n")


def test_methods_lists_the_table(run: Run) -> None:
    rows = json.loads(run("methods", "--json").out)
    assert [row["name"] for row in rows] == [method.name for method in METHODS]
    text = run("methods").out
    assert "oracle  [exact, first hits]" in text
    assert "--set contact=1e-05" in text


def test_doctor_says_what_works(run: Run) -> None:
    report = json.loads(run("doctor", "--json").out)
    backends = {row["backend"] for row in report["gl"]}
    assert backends == {"egl", "osmesa"}
    for row in report["gl"]:
        assert row["renderer"] if row["works"] else row["reason"]
    assert report["methods"]["oracle"] == ""


@pytest.mark.parametrize(("named", "code"), [("", 0), ("osmesa", 0), ("egl", 1), ("egl:0", 1)])
def test_doctor_judges_the_backend_that_is_taken(
    run: Run, monkeypatch: pytest.MonkeyPatch, named: str, code: int
) -> None:
    probes = (
        Probe("egl", 0, works=False, reason="/nowhere not loaded.", fix="unset GLCONTEXT_LINUX_LIBEGL"),
        Probe("osmesa", None, works=True, renderer="llvmpipe", version="4.5", is_software=True),
    )
    monkeypatch.setattr("zbuf_occlude.cli.lists.probe_all", lambda: probes)
    monkeypatch.setattr("zbuf_occlude.cli.lists.why_lacking", lambda method: "")  # tests/test_extras.py tries packages
    monkeypatch.setenv("ZBUF_OCCLUDE_GL", named)
    outcome = run("doctor")
    assert outcome.code == code
    assert "OpenGL backends" in outcome.out
    assert "egl, device 0: does not work: /nowhere not loaded.\n    fix: unset GLCONTEXT_LINUX_LIBEGL" in outcome.out
    assert ("depth_buffer           ready" in outcome.out) == (code == 0)
    assert ("which does not work" in outcome.out) == (code == 1)


def test_visible_writes_what_the_camera_sees(run: Run, plates: Path, tmp_path: Path) -> None:
    out = tmp_path / "cloud.ply"
    arguments = ("--azimuth", 0, "--elevation", 90, "--distance", 1000, "--method", "oracle", "--points", 4000)
    outcome = run("visible", plates, *arguments, "--out", out)
    assert outcome.code == 0, outcome.err
    cloud = trimesh.load(out)
    vertices = np.asarray(cloud.vertices)
    lower = vertices[np.abs(vertices[:, 2]) < 1e-9]
    # from far above, the small plate hides a quarter of the large one
    assert (np.abs(lower[:, :2]).max(axis=1) > 0.999).all()
    assert f"{len(vertices)} of 4000 points visible, by oracle: {out}" in outcome.out
    assert abs(len(vertices) / 4000 - (16 - 4 + 4) / 20) < 0.04


@pytest.mark.parametrize("suffix", [".npy", ".csv"])
def test_visible_writes_arrays(run: Run, plates: Path, tmp_path: Path, suffix: str) -> None:
    out = tmp_path / f"cloud{suffix}"
    assert run("visible", plates, "--azimuth=0", "--elevation=30", "--method=oracle", "--out", out).code == 0
    cloud = np.load(out) if suffix == ".npy" else np.loadtxt(out, delimiter=",", skiprows=1)
    low, high = load_mesh(plates).bounds
    assert cloud.shape[1] == 3
    assert (cloud >= low - 1e-9).all()
    assert (cloud <= high + 1e-9).all()


@pytest.mark.parametrize("suffix", [".ply", ".npy", ".csv"])
def test_visible_with_normals_and_colours(run: Run, tmp_path: Path, suffix: str) -> None:
    """A square of colours that are its places, from below: its normals point down."""
    square, out = tmp_path / "square.obj", tmp_path / f"cloud{suffix}"
    square.write_text("".join(f"v {x} {y} 0 {x} {y} 1\n" for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))) + "f 1 2 3 4\n")
    arguments = ("--with", "normals,colors", "--azimuth=0", "--elevation=-40", "--method=oracle", "--points=50")
    assert run("visible", square, *arguments, "--out", out).code == 0
    if suffix == ".ply":
        cloud = trimesh.load(out)
        table = np.c_[cloud.vertices, cloud.metadata["_ply_raw"]["vertex"]["data"]["nz"], cloud.colors[:, :3]]
    elif suffix == ".npy":
        table = np.load(out)[:, [0, 1, 2, 5, 6, 7, 8]]
    else:
        assert out.read_text().splitlines()[0] == "x,y,z,nx,ny,nz,red,green,blue"
        table = np.loadtxt(out, delimiter=",", skiprows=1)[:, [0, 1, 2, 5, 6, 7, 8]]
    assert table.shape == (50, 7)
    assert (table[:, 3] == -1).all()
    np.testing.assert_allclose(table[:, 4:], 255 * np.c_[table[:, :2], np.ones(50)], atol=0.51)


def test_visible_says_that_there_are_no_colours(run: Run, plates: Path, tmp_path: Path) -> None:
    arguments = ("--with=colors", "--azimuth=0", "--elevation=30", "--method=oracle", "--out", tmp_path / "cloud.ply")
    outcome = run("visible", plates, *arguments)
    assert outcome.code == 0
    assert outcome.err == f"warning: {plates} has no colours, or not for all faces; there points are grey\n"
    outcome = run("visible", plates, "--with=rgb", *arguments[1:])
    assert (outcome.code, "attribute must be one of normals, colors; got 'rgb'" in outcome.err) == (2, True)


@pytest.mark.parametrize("suffix", [".ply", ".npy", ".csv"])
def test_visible_of_a_point_cloud(run: Run, tmp_path: Path, suffix: str) -> None:
    """Of a ball's points, given without faces, those on the near side are seen; each kind that is written is read."""
    pytest.importorskip("open3d", reason="the package open3d cannot be imported", exc_type=ImportError)
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(4000, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    first, second = tmp_path / f"ball{suffix}", tmp_path / f"seen{suffix}"
    if suffix == ".ply":
        write_ply(first, ball)
    elif suffix == ".npy":
        np.save(first, ball)
    else:
        np.savetxt(first, ball, delimiter=",", header="x,y,z", comments="")
    view = ("--azimuth=0", "--elevation=0", "--method=hidden_point_removal")
    outcome = run("visible", first, *view, "--out", second)
    assert outcome.code == 0, outcome.err
    assert " of 4000 points visible, by hidden_point_removal: " in outcome.out
    seen = load_cloud(second)
    assert seen is not None
    assert 0.3 < len(seen) / 4000 < 0.5, "from 8 radii away 7/16 of a sphere is visible"
    assert (seen[:, 0] > 0.0).mean() > 0.99
    refused = run("visible", first, *view, "--points=9", "--out", second)
    assert (refused.code, "--points must go with a mesh" in refused.err) == (2, True), refused
    other = run("visible", first, "--azimuth=0", "--elevation=0", "--method=oracle", "--out", second)
    assert (other.code, other.err.startswith("error: ")) == (1, True)


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (("--azimuth=0", "--elevation=91", "--out=x.ply"), 2, "91.0 is not in the range -90<=x<=90"),
        (("--azimuth=0", "--elevation=9", "--distance=0", "--out=x.ply"), 2, "0.0 is not in the range x>0"),
        (("--azimuth=0", "--elevation=9", "--out=x.xyz"), 2, "got 'x.xyz'"),
    ],
)
def test_visible_says_what_is_wrong(
    run: Run, plates: Path, arguments: tuple[str, ...], code: int, message: str
) -> None:
    outcome = run("visible", plates, "--method=oracle", *arguments)
    assert (outcome.code, message in outcome.err) == (code, True), outcome
    assert "Traceback" not in outcome.err
