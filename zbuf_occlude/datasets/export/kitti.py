"""KITTI's object benchmark: frames of a LiDAR with calibrations, pictures and labelled boxes."""

from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.base import atomic
from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import OptionError
from zbuf_occlude.base.extras import importing
from zbuf_occlude.datasets.export import Exported, check_as_they_are
from zbuf_occlude.datasets.plan import BOXES, Plan
from zbuf_occlude.datasets.source import CloudReader
from zbuf_occlude.meshes.shapes.road_users import RIDDEN_FROM
from zbuf_occlude.sensors.boxes import CENTRE, FOCAL, TO_CAMERA
from zbuf_occlude.sensors.frames import png
from zbuf_occlude.sensors.poses import look_at

FOLDERS = {"train": "training", "val": "training", "test": "testing"}
TYPES = {
    "car": "Car", "van": "Van", "truck": "Truck", "pedestrian": "Pedestrian", "person": "Pedestrian",
    "cyclist": "Cyclist", "train": "Tram", "tram": "Tram",
}  # fmt: skip
"""KITTI's types of classes; others are Misc."""
RIDDEN = ("bicycle", "motorcycle")
"""Classes that are a Cyclist from a height on at which `shapes.road_user` puts a rider on them."""
DONT_CARE = "DontCare -1 -1 -10 0 0 0 0 -1 -1 -1 -1000 -1000 -1000 -10"
"""The line of a frame without objects: loaders expect one."""
OCCLUDED = (0.1, 0.5, 0.9)
"""Hidden shares from which on `occluded` is 1, 2 and 3. KITTI's people judged it by eye: assumed."""


def export(source: CloudReader, out: Path) -> Exported:
    """Write a frame for each cloud.

    training/velodyne/000000.bin   float32 x, y, z, reflectance; the LiDAR's frame, x towards the target, z up
    training/label_2/000000.txt    type, truncated, occluded, alpha, window, height, width, length, middle of the foot,
                                   rotation_y; of objects in the picture, unless neither camera nor LiDAR meets them
    training/calib/000000.txt      P0 to P3, all the same; R0_rect, Tr_velo_to_cam, Tr_imu_to_velo
    training/image_2/000000.png    grey, lit from the camera
    testing/...                    the split test, with labels
    ImageSets/train.txt            numbers of frames; val.txt, trainval.txt, test.txt

    Reflectance is albedo times the cosine of the incidence. `Exported.counts` has the boxes and the points in them.

    References
    ----------
    Geiger, Lenz, Urtasun: Are we ready for autonomous driving?, CVPR 2012; the readme of the object development kit.
    """
    files, numbers_of, n_boxes, calibration = dict[str, list[str]](), dict[str, list[str]](), 0, _calibration()
    for split, folder in FOLDERS.items():
        files[split], first = [], len(numbers_of["train"]) if split == "val" else 0
        clouds = source.order.get(split, np.empty(0, np.intp))
        numbers_of[split] = [f"{first + i:06d}" for i in range(len(clouds))]
        for number, cloud in zip(numbers_of[split], clouds, strict=True):
            record = source.take(np.array([cloud]))[0]
            labels = _labels(record)
            n_boxes += len(labels)
            picture = png(np.repeat(record["picture"][..., None], 3, axis=2))
            for name, content in (
                (f"velodyne/{number}.bin", _points(record).tobytes()),
                (f"label_2/{number}.txt", "".join(f"{line}\n" for line in labels or [DONT_CARE]).encode()),
                (f"calib/{number}.txt", calibration),
                (f"image_2/{number}.png", picture),
            ):
                path = out / folder / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
                files[split].append(f"{folder}/{name}")
    (out / "ImageSets").mkdir()
    for name, numbers in {**numbers_of, "trainval": numbers_of["train"] + numbers_of["val"]}.items():
        atomic.write_lines(out / f"ImageSets/{name}.txt", numbers)
    return Exported(files, {split: len(numbers) for split, numbers in numbers_of.items()}, {"boxes": n_boxes})


def _pose(record: Any) -> FloatArray:
    """Return the LiDAR's pose, level, from that of a camera which stands there and looks at the target."""
    eye = -record["pose"][:3, :3].T @ record["pose"][:3, 3]
    return look_at(eye, [0.0, 0.0, eye[2]])


def _points(record: Any) -> FloatArray:
    """Return points and reflectances (n, 4), float32, the LiDAR's frame."""
    pose = _pose(record)
    found = np.empty((len(record["data"]), 4), "<f4")
    found[:, :3] = (record["data"] - pose[:3, 3]) @ pose[:3, :3]
    found[:, 3] = np.minimum(record["intensity"] * record["range"] ** 2, 1.0)
    return found


def _labels(record: Any) -> list[str]:
    pose, lines = _pose(record), list[str]()
    n_points = np.bincount(record["instance"], minlength=len(record["boxes"]))
    for box, n in zip(record["boxes"], n_points, strict=True):
        label = box["label"].decode(errors="replace").strip().lower()
        if box["truncated"] == 1.0 or not box["sides"].any() or (box["hidden"] == 1.0 and not n):
            continue
        length, width, height = box["sides"]
        foot = (box["centre"] - [0.0, 0.0, height / 2] - pose[:3, 3]) @ pose[:3, :3]
        x, y, z = TO_CAMERA[:, :3] @ foot + TO_CAMERA[:, 3]
        heading = pose[:3, :3].T @ [np.cos(box["yaw"]), np.sin(box["yaw"]), 0.0]
        turned = np.arctan2(-heading[0], -heading[1])
        alpha = (turned - np.arctan2(x, z) + np.pi) % (2 * np.pi) - np.pi
        occluded = int(np.searchsorted(OCCLUDED, box["hidden"], side="right"))
        numbers = (alpha, *box["bbox"], height, width, length, x, y, z, turned)
        words = " ".join(f"{number:.4f}" for number in numbers)
        kind = "Cyclist" if label in RIDDEN and height >= RIDDEN_FROM else TYPES.get(label, "Misc")
        lines.append(f"{kind} {box['truncated']:.2f} {occluded} {words}")
    return lines


def _calibration() -> bytes:
    camera = [[FOCAL, 0.0, CENTRE[0], 0.0], [0.0, FOCAL, CENTRE[1], 0.0], [0.0, 0.0, 1.0, 0.0]]
    rows = {f"P{i}": camera for i in range(4)}
    rows |= {
        "R0_rect": np.eye(3).tolist(),
        "Tr_velo_to_cam": TO_CAMERA.tolist(),
        "Tr_imu_to_velo": np.eye(3, 4).tolist(),
    }
    lines = (f"{name}: {' '.join(f'{number:.12e}' for number in np.ravel(row))}\n" for name, row in rows.items())
    return "".join(lines).encode()


def check(plan: Plan) -> None:
    """Raise OptionError unless the clouds are whole scans of a level LiDAR, with boxes, as they are."""
    check_as_they_are(plan)
    if BOXES not in plan.config.attributes:
        raise OptionError("kitti must have boxes; got none. Give --with boxes.")
    with importing("PIL", "--format kitti"):
        import PIL  # noqa: F401  # now, not when all is scanned
