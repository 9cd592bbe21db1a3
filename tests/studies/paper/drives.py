"""Hand-made drives: one sweep in KITTI's and in Argoverse 2's layout, with the same objects."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow
from pyarrow import feather

RNG = np.random.default_rng(15)
TURN = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""Rotation from KITTI's LiDAR (x forward, y left, z up) to its camera (x right, y down, z forward)."""


@dataclass(frozen=True)
class Thing:
    """A box on the ground: labels in both layouts, centre, sides, rotation about z, number of points within."""

    kitti: str
    argoverse: str
    middle: tuple[float, float, float]
    sides: tuple[float, float, float]
    yaw: float
    n_points: int


THINGS = (
    Thing("Car", "REGULAR_VEHICLE", (12.0, 3.0, -0.9), (4.4, 1.8, 1.5), 0.4, 60),
    Thing("Van", "REGULAR_VEHICLE", (20.0, -6.0, -0.7), (5.0, 2.0, 2.0), -1.2, 40),
    Thing("Pedestrian", "PEDESTRIAN", (9.0, -2.0, -0.8), (0.7, 0.6, 1.75), 2.0, 30),
    Thing("Truck", "BUS", (30.0, 8.0, 0.0), (9.0, 2.6, 3.2), 0.1, 50),
    Thing("Cyclist", "BICYCLIST", (15.0, 9.0, -0.8), (1.8, 0.6, 1.7), 0.9, 5),  # too few points
)


def points_in(thing: Thing) -> np.ndarray:
    """Return random points within a box, in the LiDAR's frame."""
    local = RNG.uniform(-0.45, 0.45, (thing.n_points, 3)) * thing.sides
    cos, sin = np.cos(thing.yaw), np.sin(thing.yaw)
    return local @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]]) + thing.middle


def sweep() -> np.ndarray:
    """Return the points of all boxes, and a ring of others far from them."""
    angle = RNG.uniform(0.0, 2 * np.pi, 300)
    far = np.stack([60 * np.cos(angle), 60 * np.sin(angle), np.full(300, -1.7)], axis=1)
    return np.concatenate([*(points_in(thing) for thing in THINGS), far])


def write_kitti(root: Path) -> Path:
    """Write it as KITTI's object benchmark does; return the folder."""
    for name in ("velodyne", "label_2", "calib"):
        (root / "training" / name).mkdir(parents=True)
    points = sweep()
    np.concatenate([points, np.zeros((len(points), 1))], axis=1).astype("<f4").tofile(
        root / "training/velodyne/000007.bin"
    )
    shift = np.array([0.05, -0.08, -0.27])
    lines = ["P0: " + " ".join(["0"] * 12), "R0_rect: " + " ".join(map(str, np.eye(3).ravel()))]
    lines.append("Tr_velo_to_cam: " + " ".join(map(str, np.concatenate([TURN, shift[:, None]], axis=1).ravel())))
    (root / "training/calib/000007.txt").write_text("\n".join([*lines, "", ""]))
    labels = []
    for thing in THINGS:
        length, width, height = thing.sides
        foot = TURN @ (np.array(thing.middle) - [0.0, 0.0, height / 2]) + shift
        turned = -thing.yaw - np.pi / 2  # about the camera's y axis, which points down; 0 is along its x
        numbers = [0.0, 0, 0.0, 1.0, 2.0, 3.0, 4.0, height, width, length, *foot, turned]
        labels.append(" ".join([thing.kitti, *(f"{number:.6f}" for number in numbers)]))
    labels.append("DontCare -1 -1 -10 503.89 169.71 590.61 190.13 -1 -1 -1 -1000 -1000 -1000 -10")
    (root / "training/label_2/000007.txt").write_text("\n".join(labels) + "\n")
    return root


def write_argoverse(root: Path, time: int = 315966265259836000) -> Path:
    """Write it as a log of Argoverse 2's sensor dataset; return the folder that holds the log."""
    lidar = root / "val" / "log-1" / "sensors" / "lidar"
    lidar.mkdir(parents=True)
    points = sweep()
    columns = {name: points[:, i].astype(np.float16) for i, name in enumerate("xyz")}
    columns |= {name: np.zeros(len(points), np.uint8) for name in ("intensity", "laser_number")}
    feather.write_feather(
        pyarrow.table({**columns, "offset_ns": np.zeros(len(points), np.int32)}), lidar / f"{time}.feather"
    )
    rows: dict[str, list[object]] = {}
    for moment in (time, time + 10**8):  # a second sweep's boxes, which are elsewhere
        for number, thing in enumerate(THINGS):
            x, y, z = thing.middle if moment == time else (0.0, 0.0, 50.0)
            cells = {
                "timestamp_ns": moment, "track_uuid": f"track-{number}", "category": thing.argoverse,
                "length_m": thing.sides[0], "width_m": thing.sides[1], "height_m": thing.sides[2],
                "qw": np.cos(thing.yaw / 2), "qx": 0.0, "qy": 0.0, "qz": np.sin(thing.yaw / 2),
                "tx_m": x, "ty_m": y, "tz_m": z, "num_interior_pts": thing.n_points,
            }  # fmt: skip
            for name, cell in cells.items():
                rows.setdefault(name, []).append(cell)
    table = pyarrow.table({**rows, "category": pyarrow.array(rows["category"]).dictionary_encode()})
    feather.write_feather(table, root / "val" / "log-1" / "annotations.feather")
    return root
