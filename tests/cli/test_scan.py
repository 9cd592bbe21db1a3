"""`scan`: one scan into a file, its picture, and what is typed wrongly."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from tests.cli.conftest import Run, write_off
from zbuf_occlude import shapes


@pytest.fixture(scope="module")
def car(tmp_path_factory: pytest.TempPathFactory) -> Path:
    mesh = shapes.make("car", 1)
    return write_off(tmp_path_factory.mktemp("cars") / "car_0001.off", mesh.vertices, mesh.faces)


def test_a_scan(run: Run, car: Path, tmp_path: Path) -> None:
    out, picture = tmp_path / "scan.ply", tmp_path / "scan.png"
    given = ("scan", car, "--sensor", "vlp-32c", "--range", 15, "--azimuth", 30, "--method", "embree")
    outcome = run(*given, "--out", out, "--picture", picture)
    assert outcome.code == 0, outcome.err
    n_points = int(outcome.out.split()[0])
    assert n_points > 100
    assert len(trimesh.load(out).vertices) == n_points
    with Image.open(picture) as image:
        assert len(image.getcolors(10**7)) > 100
    assert run(*given, "--out", tmp_path / "scan.npy").code == 0
    table = np.load(tmp_path / "scan.npy")
    assert {"x", "nx", "range", "incidence", "intensity", "ring", "column", "instance", "n_returns"} <= set(
        table.dtype.names
    )
    eye = 15.0 * np.array([np.cos(np.radians(30)), np.sin(np.radians(30)), 0.0])
    positions = np.stack([table["x"], table["y"], table["z"]], axis=1)
    assert np.allclose(np.linalg.norm(positions - eye, axis=1), table["range"])
    assert np.ptp(positions, axis=0).max() < 4.7  # a car of 4.5 m, and noise
    again = run(*given, "--keep-clean", "--set-sensor", "noise=0", "--out", tmp_path / "clean.csv")
    assert again.code == 0, again.err
    header, *rows = (tmp_path / "clean.csv").read_text().splitlines()
    clean = np.array([[float(x) for x in row.split(",")] for row in rows])
    assert np.allclose(clean[:, header.split(",").index("range")], clean[:, header.split(",").index("clean_range")])


def test_a_street(run: Run, car: Path, tmp_path: Path) -> None:
    out = tmp_path / "street.npy"
    given = ("scan", car, "--sensor", "vlp-16", "--range", 12, "--scene", "street", "--hidden", ".3..0.5")
    outcome = run(*given, "--keep", "all", "--method", "embree", "--out", out)
    assert outcome.code == 0, outcome.err
    assert "of the object hidden by others" in outcome.out
    table = np.load(out)
    assert {0, 1} < set(table["instance"].tolist())


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (("--range", "0"), "--range must be metres above 0"),
        (
            ("--range", "2"),
            "--range must be more than half of every object; one of class car has 4.5 m, the range is 2 m.",
        ),
        (("--range", "near"), "--range must be a number, or two as A..B; got 'near'."),
        (("--sensor", "vlp-17"), "sensor must be one of vlp-16,"),
        (("--sensor", "surface"), "scan needs a sensor; `zbuf-occlude visible` samples the surface."),
        (("--set-sensor", "colums=3"), "a number of the sensor vlp-32c must be one of"),
        (("--set-sensor", "columns"), "--set-sensor must be given KEY=VALUE; got 'columns'."),
        (("--size", "car=0"), "--size must be 'file', metres from 0.001 to 100000, or CLASS=metres"),
        (("--size", "1e-320"), "--size must be 'file', metres from 0.001"),
        (("--set-sensor", "sigma=1e300"), "from 0 to 10000 metres; got 1e+300."),
        (("--hidden", "0.2"), "--hidden needs a scene that can hide"),
        (("--scene", "none.json"), "a file must be readable; none.json: No such"),
        (("--picture", "a.gif"), "--picture must end in .png"),
        (("--picture", "/nowhere/a.png"), "--picture must be in a folder that there is; '/nowhere' is none."),
        (("--out", "/nowhere/scan.ply"), "--out must be in a folder that there is; '/nowhere' is none. Make it first."),
        (("--out", "scan.xyz"), "--out must end in .ply, .npz, .pcd, .npy, .csv"),
    ],
)
def test_what_is_typed_wrongly(run: Run, car: Path, tmp_path: Path, given: tuple[str, ...], words: str) -> None:
    outcome = run("scan", car, "--out", tmp_path / "scan.ply", *given)
    assert outcome.code == 2
    assert words in outcome.err
    assert len(outcome.err.strip().splitlines()) == 1


def test_a_class_without_a_size(run: Run, car: Path, tmp_path: Path) -> None:
    gizmo = tmp_path / "gizmo.off"
    gizmo.write_bytes(car.read_bytes())
    outcome = run("scan", gizmo, "--out", tmp_path / "scan.ply")
    assert outcome.code == 2
    assert "every class must have a size in metres; 'gizmo' has none. Give --size gizmo=METRES" in outcome.err
    assert run("scan", gizmo, "--size", "gizmo=3", "--out", tmp_path / "scan.ply", "--method", "embree").code == 0


def test_a_scan_in_the_unit_of_the_file(run: Run, car: Path, tmp_path: Path) -> None:
    """`visible` has no sensor: it says which command has; there --size file takes the file's unit for metres."""
    out = tmp_path / "v.npy"
    refused = run("visible", car, "--sensor", "vlp-16", "--out", out)
    assert refused.code == 2
    assert "zbuf-occlude scan" in refused.err
    assert "--size file" in refused.err
    given = ("--sensor", "pinhole:width=80,height=60,fov=20", "--range", 2000, "--size", "file", "--method", "embree")
    outcome = run("scan", car, *given, "--azimuth", 30, "--elevation", 10, "--out", out)
    assert outcome.code == 0, outcome.err
    found, half = np.load(out), np.ptp(shapes.make("car", 1).bounds, axis=0) / 2
    positions = np.stack([found[axis] for axis in "xyz"], axis=1)
    assert len(positions) > 200
    assert (abs(positions) <= half + 1e-6).all()


def test_a_scan_of_nothing_says_so(run: Run, car: Path, tmp_path: Path) -> None:
    outcome = run("scan", car, "--size", 4, "--range", 10_000, "--method", "embree", "--out", tmp_path / "s.ply")
    assert outcome.code == 0
    assert "warning: no ray met the object" in outcome.err
    for more, words in (
        (("--velocity", "nan,0,0"), "three finite numbers"),
        (("--size", "banana=2"), "classes that there are"),
        (("--sensor", "surface", "--range", 5), "scan needs a sensor"),
        (("--scene", "ground", "--sensor-height", -1), "above 0"),
    ):
        refused = run("scan", car, "--out", tmp_path / "s.ply", *more)
        assert refused.code == 2
        assert words in refused.err


def test_windows_by_name(run: Run, tmp_path: Path) -> None:
    """A box of glass around a ball: without --transparent only the glass is met, with it both."""
    ball, glass = trimesh.creation.icosphere(radius=0.5), trimesh.creation.box((2.0, 2.0, 2.0))
    lines = ["mtllib car.mtl", "usemtl driver"]
    for mesh, first in ((ball, 1), (glass, 1 + len(ball.vertices))):
        lines += [f"v {x} {y} {z}" for x, y, z in mesh.vertices]
        lines += [f"f {a} {b} {c}" for a, b, c in mesh.faces + first]
        lines += ["usemtl wind screen"]
    (tmp_path / "car.obj").write_text("\n".join(lines))
    (tmp_path / "car.mtl").write_text("newmtl driver\nKd 1 0 0\nnewmtl wind screen\nd 0.2\n")
    given = (
        "scan",
        tmp_path / "car.obj",
        "--size",
        "file",
        "--range",
        8,
        "--sensor",
        "vlp-16",
        "--set-sensor",
        "noise=0",
    )
    given += ("--set-sensor", "returns=all", "--out", tmp_path / "scan.npz")

    def near(*more: object) -> tuple[int, int]:
        outcome = run(*given, *more)
        assert outcome.code == 0, outcome.err
        away = np.linalg.norm(np.load(tmp_path / "scan.npz")["points"], axis=1)
        return int((away < 0.501).sum()), int((away > 0.501).sum())

    driver, around = near()
    assert (driver, around > 100) == (0, True)
    behind, screens = near("--transparent", "wind*")
    assert behind > 20
    assert screens == 2 * around - behind  # both sides of the box but where the ball is
    outcome = run(*given, "--transparent", "window")
    assert outcome.code == 2
    assert "driver, wind screen" in outcome.err
    assert run(*given, "--transparent", "wind*=much").code == 2
    out, more = tmp_path / "out", ("--transparent", "wind*", "--views", "ring:2@0", "--format", "npz", "--workers", 1)
    made = ("generate", *given[1:-2], *more, "--scale", "mesh", "--sample-size", "all", "--out", out)
    outcome = run(*made)
    assert outcome.code == 0, outcome.err
    assert run("verify", out, tmp_path / "car.obj").code == 0
    assert "names no material" not in outcome.out + outcome.err
    with np.load(next(out.rglob("*.npz"))) as cloud:
        away = np.linalg.norm(cloud["data"], axis=-1)
        assert cloud["share"][away < 0.501] == pytest.approx(0.8)
        assert np.unique(cloud["share"]) == pytest.approx([0.16, 0.2, 0.8])  # of the far pane, the near one, the ball
        assert set(cloud["return_number"].tolist()) == {1, 2}
    outcome = run(*(each if each != "wind*" else "pane" for each in made), "--overwrite")
    assert (outcome.code, (outcome.out + outcome.err).count("--transparent pane names no material")) == (0, 1)
    outcome = run(*given, "--transparent", "*=1")
    assert (outcome.code, "lets all light pass" in outcome.err) == (0, True)
