"""`visible`, `depth` and `views`: visible part of a mesh as cloud, mesh, image or fraction; up axis."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.creation import icosphere

import zbuf_occlude as zo
from tests.cli.conftest import Run, write_off
from tests.scenes import HALVES, SQUARE, box
from zbuf_occlude.base.point_files import write_ply
from zbuf_occlude.engines.gl.context import GlContext
from zbuf_occlude.meshes.load import load_cloud


@pytest.fixture
def plates(tmp_path: Path) -> Path:
    """A square plate at z = 1 that hides the middle of a larger one at z = 0 from above."""
    middle = 2 * SQUARE - [1, 1, 0]
    corners = np.vstack([2 * middle, middle + np.array([0, 0, 1])])
    return write_off(tmp_path / "plates.off", corners, np.vstack([HALVES, HALVES + 4]))


@pytest.mark.usefixtures("plates")
def test_a_cloud_has_what_the_camera_sees(run: Run, tmp_path: Path) -> None:
    line = "visible plates.off --elevation 90 --distance 1000 --method oracle --points 4000 --out cloud.ply"
    outcome = run(line)
    vertices = np.asarray(trimesh.load(tmp_path / "cloud.ply").vertices)
    lower = vertices[np.abs(vertices[:, 2]) < 1e-9]
    # from far above, the small plate hides a quarter of the large one
    assert (np.abs(lower[:, :2]).max(axis=1) > 0.999).all()
    assert f"{len(vertices)} of 4000 points visible, by oracle: cloud.ply" in outcome.out
    assert abs(len(vertices) / 4000 - (16 - 4 + 4) / 20) < 0.04


@pytest.mark.parametrize("suffix", [".npy", ".csv"])
def test_arrays_hold_positions(run: Run, plates: Path, tmp_path: Path, suffix: str) -> None:
    out = tmp_path / f"cloud{suffix}"
    run(f"visible {plates} --elevation=30 --method=oracle --out {out}")
    cloud = np.load(out) if suffix == ".npy" else np.loadtxt(out, delimiter=",", skiprows=1)
    low, high = zo.load_mesh(plates).bounds
    assert cloud.shape[1] == 3
    assert (cloud >= low - 1e-9).all()
    assert (cloud <= high + 1e-9).all()


def test_a_csv_has_all_digits(run: Run, tmp_path: Path) -> None:
    """At 1,000 km from the origin, nine digits resolve 5 mm."""
    corners = np.array([[1e6, 0, 0], [1e6 + 1, 0, 0], [1e6, 1, 0]])
    write_off(tmp_path / "far.off", corners, np.array([[0, 1, 2]]))
    for suffix in ("npy", "csv"):
        run(f"visible far.off --elevation=60 --method=oracle --points=50 --out c.{suffix}")
    assert np.array_equal(np.load("c.npy"), np.loadtxt("c.csv", delimiter=",", skiprows=1))
    run("views far.off --views ring:3@60 --coverage --points 50 --out v.csv")
    written = np.genfromtxt("v.csv", delimiter=",", names=True)
    about = zo.views.for_mesh(zo.Mesh(corners, [[0, 1, 2]]), "ring:3@60").eyes[written["view"].astype(int)]
    assert np.array_equal(np.stack([written[axis] for axis in "xyz"], axis=1), about)


@pytest.mark.parametrize("suffix", [".ply", ".npy", ".csv"])
def test_normals_and_colours(run: Run, tmp_path: Path, suffix: str) -> None:
    """A square coloured by position, seen from below: its normals point down."""
    square, out = tmp_path / "square.obj", tmp_path / f"cloud{suffix}"
    square.write_text("".join(f"v {x} {y} 0 {x} {y} 1\n" for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))) + "f 1 2 3 4\n")
    run(f"visible square.obj --with normals,colors --elevation=-40 --method=oracle --points=50 --out {out}")
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


@pytest.mark.usefixtures("plates")
def test_it_is_said_that_there_are_no_colours(run: Run) -> None:
    outcome = run("visible plates.off --with=colors --elevation=30 --method=oracle --out cloud.ply")
    assert outcome.err == "warning: plates.off has no colours for some faces; points there are grey\n"


@pytest.mark.needs("open3d")
@pytest.mark.parametrize("suffix", [".ply", ".npy", ".csv"])
def test_of_a_point_cloud(run: Run, tmp_path: Path, suffix: str) -> None:
    """The near side of a ball's points, without faces, is visible; every format that is written is read."""
    ball = np.random.default_rng(0).normal(size=(4000, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    first, second = tmp_path / f"ball{suffix}", tmp_path / f"seen{suffix}"
    if suffix == ".ply":
        write_ply(first, ball)
    elif suffix == ".npy":
        np.save(first, ball)
    else:
        np.savetxt(first, ball, delimiter=",", header="x,y,z", comments="")
    line = f"visible {first} --out {second} --method"
    assert " of 4000 points visible, by hidden_point_removal: " in run(f"{line} hidden_point_removal").out
    seen = load_cloud(second)
    assert seen is not None
    assert 0.3 < len(seen) / 4000 < 0.5, "from 8 radii away 7/16 of a sphere is visible"
    assert (seen[:, 0] > 0.0).mean() > 0.99
    run(f"{line} hidden_point_removal --points=9", code=2, says="--points must go with a mesh")
    run(f"{line} oracle", code=1, says="error: ")


@pytest.mark.parametrize("suffix", ["obj", "off", "stl"])
def test_the_visible_part_as_a_mesh(run: Run, tmp_path: Path, suffix: str) -> None:
    write_off(tmp_path / "box.off", box().vertices, box().faces)
    line = f"visible box.off --azimuth 30 --elevation 20 --out part.{suffix}"
    assert "50.0% of the surface" in run(line).out
    assert zo.load_mesh(tmp_path / f"part.{suffix}", up="z").areas.sum() == pytest.approx(box().areas.sum() / 2)
    run(f"{line} --method exact")


def test_depth_is_the_same_numbers_everywhere(gl: GlContext, run: Run, tmp_path: Path) -> None:
    exr = pytest.importorskip("OpenEXR")
    tilted = np.array([[-2, -1, -1], [2, -1, 1], [2, 1, 1], [-2, 1, -1]])
    write_off(tmp_path / "tilted.off", tilted, HALVES)
    for name in ("depth.npy", "depth.exr", "depth.png"):
        assert f": {name}" in run(f"depth tilted.off --elevation=90 --size=64 --out {name}").out
    array = np.load(tmp_path / "depth.npy")
    with exr.File(str(tmp_path / "depth.exr")) as file:
        assert np.array_equal(file.channels()["Z"].pixels, array)
    grey = np.asarray(Image.open(tmp_path / "depth.png")).astype(int)
    assert ((grey > 0) == np.isfinite(array)).all()
    assert grey.max() == 65535
    assert np.unravel_index(grey.argmax(), grey.shape)[0] == np.unravel_index(array.argmin(), array.shape)[0]


# ---- several cameras: a ball's closed form, and files that are read again --------------------------------------------

ALONE = (1 - 1 / 8) / 2
"""Visible fraction of a ball's surface from eight radii, the default distance."""


@pytest.fixture
def ball(tmp_path: Path) -> Path:
    mesh = icosphere(subdivisions=4)
    return write_off(tmp_path / "ball.off", mesh.vertices, mesh.faces)


def test_coverage_of_a_ball(run: Run, ball: Path, tmp_path: Path) -> None:
    (tmp_path / "rig.csv").write_text("azimuth,elevation\n0,0\n180,0\n0,0\n")
    outcome = run(f"views {ball} --views rig.csv --coverage")
    rows = np.array([line.split() for line in outcome.out.splitlines()[1:4]], dtype=float)
    assert rows[:, 1].tolist() == [0, 180, 0]
    assert rows[:, 4] == pytest.approx([ALONE] * 3, abs=0.015)
    assert rows[:, 5] == pytest.approx([ALONE, ALONE, 0], abs=0.015)
    assert rows[:, 6] == pytest.approx([ALONE, 2 * ALONE, 2 * ALONE], abs=0.015)
    assert f"{rows[-1, 6]:.1%}" in outcome.out.splitlines()[-1]
    run(f"views {ball} --views paper100 --coverage --out coverage.png")
    assert (tmp_path / "coverage.png").read_bytes().startswith(b"\x89PNG")


def test_a_sensor_covers_a_ball_in_the_best_order(run: Run, ball: Path, tmp_path: Path) -> None:
    """Of a ball in millimetres 2 m away, a camera that measures up to 40 degrees of incidence sees a known cap."""
    (tmp_path / "rig.csv").write_text("azimuth,elevation\n0,0\n5,0\n180,0\n")
    line = f"views {ball} --views rig.csv --distance 1000 --unit mm --coverage --order --set-sensor incidence_max=40"
    line += " --sensor pinhole"
    outcome = run(f"{line} --out order.csv")
    table = np.genfromtxt(tmp_path / "order.csv", delimiter=",", names=True)
    assert table["view"].tolist() == [0, 2, 1]
    assert table["azimuth"].tolist() == [0, 180, 5]
    cap = (1 - np.cos(np.radians(40))) / 2
    assert table["alone"] == pytest.approx([cap] * 3, abs=0.015)
    assert table["gain"][:2] == pytest.approx([cap] * 2, abs=0.015)
    assert np.cumsum(table["gain"]) == pytest.approx(table["together"], abs=1e-6)
    assert "by the first 3 as by all" in outcome.out
    assert [row.split()[0] for row in run(line).out.splitlines()[1:4]] == ["0", "2", "1"]
    assert run(f"{line} --out order.png").out.endswith(": order.png\n")
    assert (tmp_path / "order.png").read_bytes().startswith(b"\x89PNG")
    run(f"views {ball} --views order.csv --coverage --out again.csv")
    assert np.genfromtxt(tmp_path / "again.csv", delimiter=",", names=True)["azimuth"].tolist() == [0, 180, 5]
    run(f"{line} --min-density 1e9 --out none.csv", code=1, says="nothing of the surface")
    assert not (tmp_path / "none.csv").exists()
    run(f"{line.replace('pinhole', 'realsense-d435')} --set-sensor range_max=1.5", code=1, says="0.168 to 1.5 m")


def test_a_sensor_needs_lengths_in_metres(run: Run, ball: Path, tmp_path: Path) -> None:
    """glTF is in metres by its standard; other files need a unit."""
    line = "--views ring:1@0 --coverage --sensor pinhole --points 100"
    run(f"views {ball} {line}", code=2, says="give --unit of the file")
    run(f"views {ball} {line} --unit m")
    icosphere().export(tmp_path / "ball.glb")
    run(f"views ball.glb {line}")


def test_a_list_of_views_is_read_again(run: Run, ball: Path, tmp_path: Path) -> None:
    run(f"views {ball} --views random:5 --distance 2..3 --seed 4 --out a.csv")
    run(f"views {ball} --views a.csv --out b.csv")
    a, b = (np.loadtxt(tmp_path / name, delimiter=",", skiprows=1) for name in ("a.csv", "b.csv"))
    assert np.allclose(a, b)
    assert len(a) == 5
    assert ((a[:, 2] >= 2) & (a[:, 2] <= 3)).all()


def test_what_any_of_a_files_cameras_sees(run: Run, ball: Path, tmp_path: Path) -> None:
    (tmp_path / "rig.csv").write_text("azimuth,elevation\n0,0\n180,0\n")
    line = f"visible {ball} --cameras rig.csv --method exact --out c.csv --with normals"

    def points(option: str) -> np.ndarray:
        outcome = run(f"{line} {option}")
        found: np.ndarray = np.loadtxt(tmp_path / "c.csv", delimiter=",", skiprows=1)
        assert int(re.findall(r"\d+", outcome.out)[0]) == len(found)
        return found

    first, second, both = points("--index 0"), points("--index 1"), points("--union")
    assert len(both) == len(first) + len(second)
    assert (np.einsum("na,na->n", both[:, :3], both[:, 3:]) > 0).all(), "normals look outwards, to an eye that sees"


# ---- what docs/datasets.md says of the up axis: how clouds are turned back, where cameras are with --up z -----------

SIDES = np.array([2.0, 4.0, 6.0])
"""Sides of a box in the axes of its file, y up."""


@pytest.fixture
def tall(tmp_path: Path) -> Path:
    path = tmp_path / "tall.obj"
    path.write_text(box(tuple(SIDES)).to_trimesh().export(file_type="obj"))
    return path


def sides(positions: np.ndarray) -> set[str]:
    """Return the sides of the box on which points lie."""
    on = {"+": np.isclose(positions, SIDES / 2), "-": np.isclose(positions, -SIDES / 2)}
    assert (on["+"] | on["-"]).any(axis=1).all()
    return {sign + axis for sign in on for axis, there in zip("xyz", on[sign].any(axis=0), strict=True) if there}


@pytest.mark.parametrize(
    ("azimuth", "elevation", "turned", "untouched"),
    [(90, 0, "-z", "+y"), (270, 0, "+z", "-y"), (0, 90, "+y", "+z"), (0, -90, "-y", "-z"), (0, 0, "+x", "+x")],
)
def test_what_a_camera_sees_in_the_axes_of_the_file(
    run: Run, tall: Path, tmp_path: Path, azimuth: int, elevation: int, turned: str, untouched: str
) -> None:
    line = f"visible {tall} --azimuth {azimuth} --elevation={elevation} --points 500 --method exact --out cloud.npy"
    run(f"{line} --up z")
    assert sides(np.load(tmp_path / "cloud.npy")) == {untouched}
    run(f"{line} --up y")
    x, y, z = np.load(tmp_path / "cloud.npy").T
    assert sides(np.stack([x, z, -y], axis=1)) == {turned}


def test_cameras_in_the_axes_of_the_file_go_with_up_z(run: Run, tall: Path, tmp_path: Path) -> None:
    """A camera above the object, along the file's y, that looks down."""
    down = {"R": [[1, 0, 0], [0, 0, 1], [0, -1, 0]], "t": [0, 0, 20]}
    (tmp_path / "cameras.json").write_text(json.dumps([down]))
    run(f"visible {tall} --cameras cameras.json --points 500 --method exact --up z --out cloud.npy")
    assert sides(np.load(tmp_path / "cloud.npy")) == {"+y"}


def refuse_to_look_past(run: Run, command: str, out: Path) -> None:
    """The camera is 8 from the ball, and looks past it at what lies at the same distance."""
    line = f"{command} --azimuth 0 --distance 4 --fov 5 --out {out}"
    run(f"{line} --look-at 0 8 0", code=1, says="turn it by --look-at")
    assert not out.exists()


def test_a_camera_that_looks_past_the_mesh_is_an_error_and_no_file(run: Run, ball: Path, tmp_path: Path) -> None:
    refuse_to_look_past(run, f"visible {ball} --method exact", tmp_path / "cloud.ply")


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
def test_depths_of_a_camera_that_looks_past_the_mesh_are_an_error(run: Run, ball: Path, tmp_path: Path) -> None:
    refuse_to_look_past(run, f"depth {ball}", tmp_path / "depth.png")
