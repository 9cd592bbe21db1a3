"""`scan`: one scan to a file, its plot, and wrong arguments."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

import zbuf_occlude as zo
from tests.cli.conftest import Run, write_off
from zbuf_occlude.meshes import shapes


@pytest.fixture(scope="module")
def car(tmp_path_factory: pytest.TempPathFactory) -> Path:
    mesh = shapes.make("car", 1)
    return write_off(tmp_path_factory.mktemp("cars") / "car_0001.off", mesh.vertices, mesh.faces)


def test_a_scan(run: Run, car: Path, tmp_path: Path) -> None:
    line = f"scan {car} --sensor vlp-32c --range 15 --azimuth 30 --method embree"
    outcome = run(f"{line} --out scan.ply --picture scan.png")
    n_points = int(outcome.out.split()[0])
    assert n_points > 100
    assert len(trimesh.load(tmp_path / "scan.ply").vertices) == n_points
    with Image.open(tmp_path / "scan.png") as image:
        assert len(image.getcolors(10**7)) > 100
    run(f"{line} --out scan.npy")
    table = np.load(tmp_path / "scan.npy")
    columns = set(table.dtype.names)
    assert {"x", "nx", "range", "incidence", "intensity", "ring", "column", "instance", "n_returns"} <= columns
    eye = 15.0 * np.array([np.cos(np.radians(30)), np.sin(np.radians(30)), 0.0])
    positions = np.stack([table["x"], table["y"], table["z"]], axis=1)
    assert np.allclose(np.linalg.norm(positions - eye, axis=1), table["range"])
    assert np.ptp(positions, axis=0).max() < 4.7  # a car of 4.5 m, and noise
    run(f"{line} --keep-clean --set-sensor noise=0 --out clean.csv")
    clean = np.genfromtxt(tmp_path / "clean.csv", delimiter=",", names=True)
    assert np.allclose(clean["range"], clean["clean_range"])


def test_a_street(run: Run, car: Path, tmp_path: Path) -> None:
    line = f"scan {car} --sensor vlp-16 --range 12 --scene street --hidden .3..0.5 --keep all --method embree"
    assert "of the object hidden by others" in run(f"{line} --out street.npy").out
    assert {0, 1} < set(np.load(tmp_path / "street.npy")["instance"].tolist())


@pytest.mark.parametrize(
    ("typed", "arguments"),
    [("--size 4", {"size": 4.0}), ("--unit cm", {"unit": "cm"}), ("--size file", {}), ("", {"size": 4.5})],
)
def test_command_and_api_give_the_same_points(
    run: Run, tmp_path: Path, typed: str, arguments: dict[str, object]
) -> None:
    """In the coordinates of the file, of a car whose centre is not its origin."""
    mesh = shapes.make("car", 1)
    factor = (100.0 if "unit" in arguments else 1.0) * 4.2 / mesh.longest_side
    car = write_off(tmp_path / "car_0001.off", mesh.vertices * factor + [30.0, -20.0, 7.0], mesh.faces)
    sensor = "pinhole:width=60,height=40,fov=20"
    line = f"scan {car} --sensor {sensor} --set-sensor noise=0 --method embree --range 15 --azimuth 30 --elevation 10"
    run(f"{line} {typed} --out scan.npz")
    given: Any = {"range": 15, "azimuth": 30, "elevation": 10, "method": "embree", **arguments}
    found = zo.scan(car, zo.sensors.make(sensor, noise=0), **given)
    with np.load(tmp_path / "scan.npz") as typed_scan:
        assert len(found) > 300
        assert np.allclose(typed_scan["points"], found.points, atol=1e-6)
        assert np.allclose(typed_scan["origin"], found.origin)


def test_a_class_with_a_size_of_its_own(run: Run, car: Path, tmp_path: Path) -> None:
    (tmp_path / "gizmo.off").write_bytes(car.read_bytes())
    run("scan gizmo.off --size gizmo=3 --out scan.ply --method embree")


def test_a_size_of_no_object_is_said(run: Run, car: Path) -> None:
    line = f"scan {car} --range 15 --method embree --out scan.ply"
    said = "warning: --size bus, chair names no class of the meshes, car, or of the scene: it changes nothing"
    run(f"{line} --size bus=3,car=4,chair=1", says=said)
    assert "names no class" not in run(f"{line} --size chair=1 --scene room").err


def test_a_scan_in_the_unit_of_the_file(run: Run, car: Path, tmp_path: Path) -> None:
    sensor = "pinhole:width=80,height=60,fov=20 --range 2000 --size file --method embree"
    run(f"scan {car} --sensor {sensor} --azimuth 30 --elevation 10 --out v.npy")
    found, half = np.load(tmp_path / "v.npy"), np.ptp(shapes.make("car", 1).bounds, axis=0) / 2
    positions = np.stack([found[axis] for axis in "xyz"], axis=1)
    assert len(positions) > 200
    assert (abs(positions) <= half + 1e-6).all()


def test_a_scan_of_nothing_is_an_error_and_no_file(run: Run, car: Path) -> None:
    Path("sideways.csv").write_text("azimuth,elevation\n90,0\n")
    line = f"scan {car} --size 4 --method embree --out s.ply --picture s.png"
    run(f"{line} --range 10000", code=1, says="too far for vlp-32c, which measures at 0.9 to 200 m")
    run(f"{line} --range 9 --sensor sideways.csv", code=1, says="no ray of sideways meets")
    run(f"{line} --range 9 --sensor sideways.csv --keep all", code=1, says="nothing of the scene returns")
    assert not [each for each in Path().iterdir() if each.stem == "s"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--range 3 --set-sensor range_min=50", "too near .* Raise --range"),
        ("--range 9 --set-sensor range_max=5", "too far .* Lower --range"),
        ("--range 9 --set-sensor incidence_max=0.01", "steeper .* incidence_max=90"),
        ("--range 9 --set-sensor drop=1", "lost.* noise=0"),
        ("--range 9 --sensor far.yaml", "second camera .* baseline=0"),
    ],
)
def test_what_leaves_all_out_is_blamed(run: Run, car: Path, options: str, words: str) -> None:
    """Each parameter of the sensor alone; the ranges are right."""
    sensor = "--sensor pinhole:width=60,height=40,fov=40"
    Path("far.yaml").write_text("kind: pinhole\nwidth: 60\nheight: 40\nfov: 40\nbaseline: [0, -500, 0]\n")
    error = run(f"scan {car} --size 4 {sensor} {options} --azimuth 33 --elevation 17 --out s.ply", code=1).err
    assert re.search(f"error: .*{words}", error), error


@pytest.mark.parametrize(
    ("seconds", "words"), [(2.0, "lasts 2 s, a sweep 0.1 s: one sweep"), (0.01, "stands still"), (0.1, "")]
)
def test_a_trajectory_of_another_length_is_said(run: Run, car: Path, seconds: float, words: str) -> None:
    Path("t.txt").write_text(f"0 0 0 0 0 0 0 1\n{seconds} 1 0 0 0 0 0 1\n")
    error = run(f"scan {car} --size 4 --range 9 --sensor vlp-16 --trajectory t.txt --out s.ply").err
    assert (words in error) if words else ("trajectory" not in error)


def test_windows_by_name(run: Run, tmp_path: Path) -> None:
    """A glass box around a ball: without --transparent rays meet only the glass, with it both."""
    ball, glass = trimesh.creation.icosphere(radius=0.5), trimesh.creation.box((2.0, 2.0, 2.0))
    lines = ["mtllib car.mtl", "usemtl driver"]
    for mesh, first in ((ball, 1), (glass, 1 + len(ball.vertices))):
        lines += [f"v {x} {y} {z}" for x, y, z in mesh.vertices]
        lines += [f"f {a} {b} {c}" for a, b, c in mesh.faces + first]
        lines += ["usemtl wind screen"]
    (tmp_path / "car.obj").write_text("\n".join(lines))
    (tmp_path / "car.mtl").write_text("newmtl driver\nKd 1 0 0\nnewmtl wind screen\nd 0.2\n")
    scene = "car.obj --size file --range 8 --sensor vlp-16 --set-sensor noise=0 --set-sensor returns=all"
    line = f"scan {scene} --out scan.npz"

    def near(options: str) -> tuple[int, int]:
        run(f"{line} {options}")
        away = np.linalg.norm(np.load(tmp_path / "scan.npz")["points"], axis=1)
        return int((away < 0.501).sum()), int((away > 0.501).sum())

    driver, around = near("")
    assert (driver, around > 100) == (0, True)
    behind, screens = near("--transparent wind*")
    assert behind > 20
    assert screens == 2 * around - behind  # both sides of the box but where the ball is
    run(f"{line} --transparent window", code=2, says="driver, wind screen")
    run(f"{line} --transparent wind*=much", code=2)
    made = f"generate {scene} --views ring:2@0 --format npz --workers 1 --scale mesh --sample-size all --out out"
    outcome = run(f"{made} --transparent wind*")
    run("verify out car.obj")
    assert "names no material" not in outcome.out + outcome.err
    with np.load(next((tmp_path / "out").rglob("*.npz"))) as cloud:
        away = np.linalg.norm(cloud["data"], axis=-1)
        assert cloud["share"][away < 0.501] == pytest.approx(0.8)
        assert np.unique(cloud["share"]) == pytest.approx([0.16, 0.2, 0.8])  # of the far pane, the near one, the ball
        assert set(cloud["return_number"].tolist()) == {1, 2}
    outcome = run(f"{made} --transparent pane --overwrite")
    assert (outcome.out + outcome.err).count("--transparent pane names no material") == 1
    run(f"{line} --transparent *=1", code=1, says="lets all light pass")
