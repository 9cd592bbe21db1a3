"""SemanticKITTI's layout of a sequence, which semantic-kitti-api reads.

sequences/00/velodyne/000000.bin   float32 x, y, z, remission; the frame of the rig's first sensor
sequences/00/labels/000000.label   uint32: class in the lower 16 bits, instance in the upper ones
sequences/00/poses.txt             12 numbers a sweep: camera 0 to camera 0 of the first sweep
sequences/00/times.txt             seconds from the first sweep
sequences/00/calib.txt             P0 to P3, all the same; Tr, the LiDAR's frame to that of camera 0

The cameras are KITTI's, beside the first sensor; there are no pictures. Remission is albedo times the cosine of the
incidence.

References
----------
Behley and others: SemanticKITTI, ICCV 2019. Geiger, Lenz, Urtasun: Are we ready for autonomous driving?, CVPR 2012.
"""

import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base import atomic
from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import DatasetError
from zbuf_occlude.meshes.shapes.road_users import RIDDEN_FROM
from zbuf_occlude.sensors.boxes import CENTRE, FOCAL, TO_CAMERA
from zbuf_occlude.sensors.drives import DriveSweep
from zbuf_occlude.sensors.rigs import Rig
from zbuf_occlude.sensors.scenes.scene import Scene

LABELS = MappingProxyType({
    "unlabeled": 0, "outlier": 1, "car": 10, "bicycle": 11, "bus": 13, "motorcycle": 15, "on-rails": 16, "truck": 18,
    "other-vehicle": 20, "person": 30, "bicyclist": 31, "motorcyclist": 32, "road": 40, "parking": 44, "sidewalk": 48,
    "other-ground": 49, "building": 50, "fence": 51, "other-structure": 52, "lane-marking": 60, "vegetation": 70,
    "trunk": 71, "terrain": 72, "pole": 80, "traffic-sign": 81, "other-object": 99,
})  # fmt: skip
"""Numbers of SemanticKITTI's classes (its config/semantic-kitti.yaml)."""
SYNONYMS = MappingProxyType({
    "van": "car", "motorbike": "motorcycle", "train": "on-rails", "tram": "on-rails", "tractor": "other-vehicle",
    "trailer": "other-vehicle", "pedestrian": "person", "cyclist": "bicyclist", "ground": "road", "wall": "fence",
})  # fmt: skip
"""SemanticKITTI's names of other classes; it counts vans among the cars. Classes in neither table are other-object."""
RIDDEN = MappingProxyType({"bicycle": "bicyclist", "motorcycle": "motorcyclist"})
"""Names of a bicycle and a motorcycle at least `RIDDEN_FROM` high: they have a rider."""
MOVING = MappingProxyType({10: 252, 13: 257, 16: 256, 18: 258, 20: 259, 30: 254, 31: 253, 32: 255})
"""Numbers of the classes of objects that move, by those of the classes."""
FIRST_STUFF = LABELS["road"]
"""Number from which on classes have no instances, moving ones excepted."""


def folder_of(out: Path, sequence: int) -> Path:
    """Return the folder of a sequence."""
    return out / "sequences" / f"{sequence:02d}"


def check(out: Path, sequence: int, rig: Rig) -> None:
    """Raise DatasetError where a sequence is there already."""
    if (folder := folder_of(out, sequence)).exists():
        raise DatasetError(f"{folder} is there already. Give another --sequence or --out, or remove it.")


def write(out: Path, sequence: int, rig: Rig, sweeps: Iterable[DriveSweep]) -> Iterator[DriveSweep]:
    """Write a sequence; yield each sweep when its files are written. The folder has its name when all are written."""
    folder = folder_of(out, sequence).with_suffix(".part")
    shutil.rmtree(folder, ignore_errors=True)
    for name in ("velodyne", "labels"):
        (folder / name).mkdir(parents=True)
    camera = np.vstack([TO_CAMERA, [0.0, 0.0, 0.0, 1.0]])
    poses, times = list[FloatArray](), list[str]()
    for sweep in sweeps:
        pose = sweep.pose @ rig[0].pose
        points, labels = _points(sweep, pose), _labels(sweep)
        (folder / f"velodyne/{sweep.number:06d}.bin").write_bytes(points.tobytes())
        (folder / f"labels/{sweep.number:06d}.label").write_bytes(labels.tobytes())
        poses.append(camera @ pose @ np.linalg.inv(camera))
        times.append(f"{sweep.time:.6e}")
        yield sweep
    first = np.linalg.inv(poses[0])
    atomic.write_lines(folder / "poses.txt", [_row(first @ pose) for pose in poses])
    atomic.write_lines(folder / "times.txt", times)
    projection = np.array([[FOCAL, 0.0, CENTRE[0], 0.0], [0.0, FOCAL, CENTRE[1], 0.0], [0.0, 0.0, 1.0, 0.0]])
    lines = [f"P{number}: {_row(projection)}" for number in range(4)]
    atomic.write_lines(folder / "calib.txt", [*lines, f"Tr: {_row(TO_CAMERA)}"])
    folder.rename(folder_of(out, sequence))


def _row(matrix: FloatArray) -> str:
    return " ".join(f"{number:.12e}" for number in matrix[:3].ravel())


def _points(sweep: DriveSweep, pose: FloatArray) -> NDArray[np.float32]:
    """Return points and remissions (n, 4) of all sensors in the frame of the first one, given its pose."""
    scans = sweep.scans.values()
    local = np.concatenate([(scan.points - pose[:3, 3]) @ pose[:3, :3] for scan in scans])
    remissions = np.concatenate([np.minimum(scan.intensities * scan.clean_ranges**2, 1.0) for scan in scans])
    return np.column_stack([local, remissions]).astype("<f4")


def _labels(sweep: DriveSweep) -> NDArray[np.uint32]:
    """Return the classes and instances (n,) of the points of all sensors."""
    of_objects = labels_of(sweep.scene)
    return of_objects[np.concatenate([scan.instances for scan in sweep.scans.values()])]


def labels_of(scene: Scene) -> NDArray[np.uint32]:
    """Return the label (o,) of each object: its class, and from 1 on its instance where its class has instances."""
    found = np.zeros(len(scene.labels), "<u4")
    for number, label in enumerate(scene.labels):
        name = label.strip().lower()
        placed = scene.placed[number] if scene.placed else None
        if name in RIDDEN and placed is not None and np.ptp(placed.vertices[:, 2]) >= RIDDEN_FROM:
            name = RIDDEN[name]
        kind = LABELS.get(SYNONYMS.get(name, name), LABELS["other-object"])
        instance = (number + 1) << 16 if kind < FIRST_STUFF else 0
        found[number] = (MOVING.get(kind, kind) if placed is not None and placed.moves else kind) | instance
    return found
