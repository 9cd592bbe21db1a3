"""Which way is up in the scans: votes of scans that a simulated HDL-64E made of cars, and of what stands on a pole."""

from pathlib import Path

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.paper.test_sydney import write_bin
from zbuf_occlude import shapes
from zbuf_occlude.paper import sydney
from zbuf_occlude.paper.sydney import Frame, decided, find_frame, picture_of_scans, vote
from zbuf_occlude.shapes.solids import box

N_CARS = 10


@pytest.fixture(scope="module")
def cars() -> list[np.ndarray]:
    """Cars 4.5 m long, seen from 8 to 26 m by a scanner 1.9 m above the ground; metres, z up, about the scanner."""
    scans, sensor = [], zo.sensors.make("hdl-64e", columns=900)
    for number in range(N_CARS):
        mesh = shapes.make("car", number).normalized()
        mesh = zo.Mesh(mesh.vertices * 4.5, mesh.faces)
        azimuth, distance = 0.6 * number, 8.0 + 2 * number
        at = distance * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        at[2] = mesh.bounds[0, 2] + 1.9
        scan = zo.scan(mesh, sensor, zo.sensors.look_at(at, [0, 0, at[2]]), seed=number)
        scans.append(scan.positions.astype(np.float64) - at)
    return scans


def signs() -> list[np.ndarray]:
    """A plate on a pole, z up."""
    rng = np.random.default_rng(0)
    pole = np.column_stack([rng.normal(0, 0.03, (60, 2)), rng.uniform(0, 2.0, 60)])
    plate = np.column_stack([rng.uniform(-0.5, 0.5, 80), rng.normal(0, 0.02, 80), rng.uniform(2.0, 2.8, 80)])
    return [np.concatenate([pole, plate])] * 6


def write(root: Path, scans: dict[str, list[np.ndarray]]) -> Path:
    """Write a dataset of one fold's worth in each."""
    (root / "objects").mkdir(parents=True)
    (root / "folds").mkdir()
    names: list[list[str]] = [[], [], [], []]
    for label, clouds in scans.items():
        for number, points in enumerate(clouds):
            write_bin(root / "objects" / f"{label}.{number}.1.bin", points)
            names[number % 4].append(f"{label}.{number}.1.bin")
    for fold, lines in enumerate(names):
        (root / "folds" / f"fold{fold}.txt").write_text("\n".join(lines))
    return root


def test_simulated_scans_of_cars_say_which_way_is_up(cars: list[np.ndarray]) -> None:
    said = [vote(points, "car") for points in cars]
    assert said.count(1) >= N_CARS - 1, said
    assert [vote(points * [1, -1, -1], "car") for points in cars] == [-one for one in said]
    assert [vote(points, "tree") for points in signs()] == [1] * 6
    assert vote(signs()[0], "pole") == vote(signs()[0][:20], "traffic_sign") == 0


def test_the_frame_is_found_and_scans_are_turned_by_it(tmp_path: Path, cars: list[np.ndarray]) -> None:
    upright = write(tmp_path / "z", {"car": cars, "traffic_sign": signs()})
    turned = write(tmp_path / "-z", {"car": [p * [1, -1, -1] for p in cars], "traffic_sign": signs()})
    assert find_frame(upright).up == "z"
    assert "z of the files is up, found from the scans" in find_frame(upright).said
    assert find_frame(turned).votes["tops"] == (6, 0), "in this one they contradict each other"
    down = write(tmp_path / "down", {"car": [p * [1, -1, -1] for p in cars]})
    frame = find_frame(down)
    assert frame.up == "-z"
    one, other = (sydney.read_clouds(root, 64, find_frame(root).up) for root in (upright, down))
    both = one.labels == sydney.CLASSES.index("car")
    assert np.abs(one.positions[both] - other.positions).max() < 1e-4
    picture_of_scans(down, frame.up).savefig(tmp_path / "scans.png")
    assert (tmp_path / "scans.png").stat().st_size > 2_000


def test_what_says_nothing_is_assumed_and_what_a_person_says_holds(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    frame = find_frame(write(tmp_path, {"car": [rng.uniform(0, 2, (100, 3)) for _ in range(8)]}))
    assert frame.up == "-z"
    assert "-z of the files is up, assumed" in frame.said
    assert Frame("z", {}).said == "z of the files is up, as --sydney-up says."
    assert decided({"vehicles": (90, 98), "tops": (0, 0)}) == ""
    assert decided({"vehicles": (30, 158), "tops": (20, 50)}) == "-z"


def test_a_box_on_the_ground_says_nothing() -> None:
    points = zo.sample_surface(box(), n_points=20, seed=0).positions
    assert vote(points, "car") == 0
