"""KITTI's object benchmark: folders velodyne, label_2 and calib, in a root or its folder `training`, a file per sweep.

velodyne   float32 x, y, z, reflectance; x forward, y left, z up
label_2    type, truncated, occluded, alpha, 4 of the picture, height, width, length, x, y, z, rotation_y: the centre of
           the box's lower side in the rectified camera's frame (x right, y down, z forward), turned about its y axis
calib      lines NAME: numbers, with R0_rect (3 x 3) and Tr_velo_to_cam (3 x 4)

References: Geiger, Lenz, Urtasun, "Are we ready for autonomous driving? The KITTI vision benchmark suite", CVPR 2012,
and the readme of its object development kit.
"""

from functools import partial
from pathlib import Path

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import DatasetError
from zbuf_occlude.datasets.cloud_files import read_points
from zbuf_occlude.datasets.real.sweeps import REMEDY, LabelledBox, Loader, Sweep, checked_sides

FOLDERS = ("velodyne", "label_2", "calib")
NOT_AN_OBJECT = "DontCare"
"""Label of regions without labelled objects."""
_N_FIELDS = 15


def find(root: Path) -> list[Loader]:
    """Return a loader for each file of points; raises DatasetError where there is none, or a folder is missing."""
    for folder in (root, root / "training"):
        missing = [name for name in FOLDERS if not (folder / name).is_dir()]
        if len(missing) == len(FOLDERS):
            continue
        if missing:
            raise DatasetError(
                f"{folder} must have KITTI's folders {', '.join(FOLDERS)}; it lacks {', '.join(missing)}. {REMEDY}"
            )
        if not (files := sorted((folder / "velodyne").glob("*.bin"))):
            raise DatasetError(f"{folder / 'velodyne'} must hold a .bin file per sweep; it has none. {REMEDY}")
        return [partial(read_kitti, path) for path in files]
    return []


def read_kitti(path: Path) -> Sweep:
    """Read the sweep of a file of points."""
    folder = path.parents[1]
    label, calibration = (folder / name / f"{path.stem}.txt" for name in FOLDERS[1:])
    for file in (label, calibration):
        if not file.is_file():
            raise DatasetError(f"{path} must have its {file.parent.name}/{file.name}; it is missing. {REMEDY}")
    points = read_points(path)
    to_points = np.asarray(np.linalg.inv(_to_camera(calibration)), dtype=np.float64)
    return Sweep(path.stem, points, _boxes(label, to_points))


def _boxes(path: Path, to_points: FloatArray) -> list[LabelledBox]:
    boxes = []
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
        fields = line.split()
        if not fields or fields[0] == NOT_AN_OBJECT:
            continue
        try:
            height, width, length, x, y, z, turned = np.array(fields[8:_N_FIELDS], dtype=np.float64)
            size = checked_sides([length, width, height])
            if not np.isfinite([x, y, z, turned]).all():
                raise ValueError("a place must be finite numbers")
        except ValueError as error:
            raise DatasetError(
                f"{path} must have {_N_FIELDS} fields per line, from the 9th on numbers; line {number} is {line!r:.60} "
                f"({error}). {REMEDY}"
            ) from None
        along = np.array([np.cos(turned), 0.0, -np.sin(turned)])
        up = np.array([0.0, -1.0, 0.0])
        axes = to_points[:3, :3] @ np.stack([along, np.cross(up, along), up], axis=1)
        centre = to_points @ [x, y - height / 2.0, z, 1.0]
        boxes.append(LabelledBox(fields[0], centre[:3], axes, size))
    return boxes


def _to_camera(path: Path) -> FloatArray:
    """Return the transform (4, 4) from the frame of the points to that of the rectified camera."""
    found: dict[str, FloatArray] = {}
    shapes = {"R0_rect": (3, 3), "Tr_velo_to_cam": (3, 4)}
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        name, _, numbers = line.partition(":")
        if name in shapes:
            try:
                values = np.array(numbers.split(), dtype=np.float64).reshape(shapes[name])
            except ValueError:
                wanted = np.prod(shapes[name])
                raise DatasetError(
                    f"{name} in {path} must be {wanted} numbers; it is {numbers.strip()!r:.60}. {REMEDY}"
                ) from None
            found[name] = np.eye(4)
            found[name][:3, : values.shape[1]] = values
    if missing := [name for name in shapes if name not in found]:
        raise DatasetError(f"{path} must have {' and '.join(missing)}; it does not. Take the object benchmark's calib.")
    with np.errstate(all="ignore"):  # the result is checked below
        matrix = found["R0_rect"] @ found["Tr_velo_to_cam"]
    if not np.isfinite(matrix).all() or abs(np.linalg.det(matrix[:3, :3])) < 0.5:
        raise DatasetError(f"R0_rect and Tr_velo_to_cam in {path} must be rotations; they are not. {REMEDY}")
    return matrix
