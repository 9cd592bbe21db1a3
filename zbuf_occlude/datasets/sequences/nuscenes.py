"""nuScenes's layout of a scene, which nuscenes-devkit reads: tables, and the clouds of each LiDAR.

v1.0-mini/NAME.json              the tables; a further sequence adds its rows
samples/CHANNEL/*.pcd.bin        key frames, two a second: float32 x, y, z, intensity, ring; x right, y forward, z up
sweeps/CHANNEL/*.pcd.bin         the sweeps between them
maps/*.png                       an empty map: the devkit asks for one

The first sensor of a rig is LIDAR_TOP, others are LIDAR_NAME; each has its own clouds. Objects with a return have a box
in each key frame, at the median time of their returns to the first LiDAR that has any. `num_lidar_pts` counts the
points of all LiDARs in the box, those of the ground too. Intensity is 255 times albedo times the cosine of the
incidence.

References
----------
Caesar and others: nuScenes, a multimodal dataset for autonomous driving, CVPR 2020, and its schema.
"""

import hashlib
import json
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from trimesh.transformations import quaternion_from_matrix

from zbuf_occlude.base import atomic
from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import DatasetError, OptionError
from zbuf_occlude.datasets.real.nuscenes import CHANNEL
from zbuf_occlude.datasets.real.sweeps import LabelledBox
from zbuf_occlude.sensors.boxes import box_of, placed_at_points
from zbuf_occlude.sensors.drives import DriveSweep
from zbuf_occlude.sensors.frames import png
from zbuf_occlude.sensors.returns import Scan
from zbuf_occlude.sensors.rigs import Rig
from zbuf_occlude.sensors.scenes.scene import upright_pose

VERSION = "v1.0-mini"
TABLES = (
    *("attribute", "calibrated_sensor", "category", "ego_pose", "instance", "log", "map", "sample"),
    *("sample_annotation", "sample_data", "sensor", "visibility", "scene"),
)
"""The tables in the order of writing. The scene is the last one: a sequence is there when its scene is."""
KEY_FRAMES = 0.5
"""Seconds from one key frame to the next, as in nuScenes; at least a sweep."""
ROUNDING = 1e-6
"""Metres outside a box at which points count as in it: without noise those of flat sides lie on the box."""
CATEGORIES = MappingProxyType({
    "car": "vehicle.car", "van": "vehicle.car", "truck": "vehicle.truck", "tractor": "vehicle.truck",
    "bus": "vehicle.bus.rigid", "trailer": "vehicle.trailer", "motorcycle": "vehicle.motorcycle",
    "motorbike": "vehicle.motorcycle", "bicycle": "vehicle.bicycle", "cyclist": "vehicle.bicycle",
    "pedestrian": "human.pedestrian.adult", "person": "human.pedestrian.adult",
})  # fmt: skip
"""nuScenes's categories of classes; objects of other classes have no boxes."""
TO_FORWARD = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Rotation from nuScenes's LiDAR frame (x right, y forward) to that of sensors here (x forward, y left)."""

Rows = list[dict[str, Any]]


def scene_name(sequence: int) -> str:
    """Return the name of a sequence."""
    return f"scene-{sequence:04d}"


def check(out: Path, sequence: int, rig: Rig) -> None:
    """Raise DatasetError where a sequence is there already or tables cannot be read; OptionError for equal channels."""
    if any(row["name"] == scene_name(sequence) for row in _tables(out)["scene"]):
        raise DatasetError(f"{out} has {scene_name(sequence)} already. Give another --sequence or --out.")
    channels = channels_of(rig)
    if twice := [channel for channel in channels if channels.count(channel) > 1]:
        raise OptionError(f"sensors of a rig must have channels of their own; two have {twice[0]}. Rename one of them.")


def write(out: Path, sequence: int, rig: Rig, sweeps: Iterable[DriveSweep]) -> Iterator[DriveSweep]:
    """Write a sequence; yield each sweep when its clouds are written. The tables get its rows when all are."""
    for left in out.glob(f"s*/*/{scene_name(sequence)}__*.pcd.bin"):  # by a run that was interrupted
        left.unlink()
    new, channels = _fixed_rows(sequence, rig), channels_of(rig)
    every = max(1, round(KEY_FRAMES / rig.period))
    seen = defaultdict[int, Rows](list)
    for sweep in sweeps:
        if is_key := sweep.number % every == 0:
            sample, time = _token(sequence, "sample", sweep.number), _microseconds(sweep.time)
            new["sample"].append({"token": sample, "timestamp": time, "scene_token": _token(sequence, "scene")})
            for number, row in _annotations(sweep, sequence, sample).items():
                seen[number].append(row)
        for mounted, channel in zip(rig, channels, strict=True):
            name = f"{scene_name(sequence)}__{channel}__{_microseconds(sweep.time)}.pcd.bin"
            file = f"{'samples' if is_key else 'sweeps'}/{channel}/{name}"
            (out / file).parent.mkdir(parents=True, exist_ok=True)
            (out / file).write_bytes(_cloud(sweep.scans[mounted.name], sweep.pose @ mounted.pose).tobytes())
            token = _token(sequence, channel, sweep.number)
            new["ego_pose"].append({"token": token, "timestamp": _microseconds(sweep.time), **_placed(sweep.pose)})
            new["sample_data"].append({
                "token": token, "sample_token": new["sample"][-1]["token"], "ego_pose_token": token,
                "calibrated_sensor_token": _token(sequence, "mount", channel), "filename": file, "fileformat": "pcd",
                "timestamp": _microseconds(sweep.time), "is_key_frame": is_key, "height": 0, "width": 0,
            })  # fmt: skip
        yield sweep
    for channel in channels:
        mine = _token(sequence, "mount", channel)
        _chain([row for row in new["sample_data"] if row["calibrated_sensor_token"] == mine])
    _chain(new["sample"])
    for rows in seen.values():
        _chain(rows)
        new["sample_annotation"] += rows
        new["instance"].append({
            "token": rows[0]["instance_token"], "category_token": rows[0].pop("category"),
            "nbr_annotations": len(rows), "first_annotation_token": rows[0]["token"],
            "last_annotation_token": rows[-1]["token"],
        })  # fmt: skip
        for row in rows[1:]:
            del row["category"]
    new["scene"][0] |= {
        "nbr_samples": len(new["sample"]),
        "first_sample_token": new["sample"][0]["token"],
        "last_sample_token": new["sample"][-1]["token"],
    }
    _add(out, new)


def channels_of(rig: Rig) -> list[str]:
    """Return the channel of each sensor of a rig."""
    return [CHANNEL, *("LIDAR_" + re.sub(r"\W", "_", each.name).upper() for each in rig[1:])]


def _fixed_rows(sequence: int, rig: Rig) -> dict[str, Rows]:
    """Return the tables with the rows that are known before the first sweep."""
    new: dict[str, Rows] = {name: [] for name in TABLES}
    scene, log = _token(sequence, "scene"), _token(sequence, "log")
    new["scene"] = [{"token": scene, "log_token": log, "name": scene_name(sequence), "description": "simulated"}]
    new["log"] = [{"token": log, "logfile": "", "vehicle": "", "date_captured": "", "location": ""}]
    file = f"maps/{scene_name(sequence)}.png"
    new["map"] = [
        {"token": _token(sequence, "map"), "log_tokens": [log], "category": "semantic_prior", "filename": file}
    ]
    for mounted, channel in zip(rig, channels_of(rig), strict=True):
        new["sensor"].append({"token": _token("sensor", channel), "channel": channel, "modality": "lidar"})
        mount = mounted.pose.copy()
        mount[:3, :3] = mount[:3, :3] @ TO_FORWARD
        row = {"token": _token(sequence, "mount", channel), "sensor_token": _token("sensor", channel)}
        new["calibrated_sensor"].append({**row, **_placed(mount), "camera_intrinsic": []})
    for name in dict.fromkeys(CATEGORIES.values()):
        new["category"].append({"token": _token("category", name), "name": name, "description": ""})
    return new


def _annotations(sweep: DriveSweep, sequence: int, sample: str) -> dict[int, dict[str, Any]]:
    """Return the rows of the boxes of a key frame by the numbers of their objects; with the token of the category."""
    scans, found = sweep.scans.values(), {}
    points = np.concatenate([scan.points for scan in scans])
    for number, placed in enumerate(sweep.scene.placed):
        category = CATEGORIES.get(placed.label.strip().lower())
        times = next((mine for scan in scans if len(mine := scan.times[scan.instances == number])), None)
        if category is None or times is None:
            continue
        box = box_of(placed_at_points(placed, times))
        rotation = upright_pose(box.yaw)[:3, :3]
        n_points = LabelledBox(placed.label, box.centre, rotation, box.sides).contains(points, ROUNDING).sum()
        length, width, height = box.sides.tolist()
        found[number] = {
            "token": _token(sequence, "box", number, sweep.number), "sample_token": sample,
            "instance_token": _token(sequence, "object", number), "category": _token("category", category),
            "translation": box.centre.tolist(), "size": [width, length, height],
            "rotation": [float(np.cos(box.yaw / 2)), 0.0, 0.0, float(np.sin(box.yaw / 2))],
            "num_lidar_pts": int(n_points), "num_radar_pts": 0, "attribute_tokens": [], "visibility_token": "",
        }  # fmt: skip
    return found


def _cloud(scan: Scan, pose: FloatArray) -> NDArray[np.float32]:
    """Return x, y, z, intensity and ring (n, 5) in nuScenes's frame of the sensor."""
    local = (scan.points - pose[:3, 3]) @ pose[:3, :3] @ TO_FORWARD
    intensities = 255.0 * np.minimum(scan.intensities * scan.clean_ranges**2, 1.0)
    return np.column_stack([local, intensities, scan.rings]).astype("<f4")


def _placed(pose: FloatArray) -> dict[str, list[float]]:
    """Return the translation and the rotation (w, x, y, z) of a pose."""
    return {"translation": pose[:3, 3].tolist(), "rotation": quaternion_from_matrix(pose).tolist()}


def _token(*words: object) -> str:
    return hashlib.md5("/".join(map(str, words)).encode(), usedforsecurity=False).hexdigest()


def _microseconds(time: float) -> int:
    return round(1e6 * time)


def _chain(rows: Rows) -> None:
    """Set the tokens of the rows before and after each row."""
    tokens = ["", *(row["token"] for row in rows), ""]
    for number, row in enumerate(rows):
        row["prev"], row["next"] = tokens[number], tokens[number + 2]


def _tables(out: Path) -> dict[str, Rows]:
    """Return the tables that are there; empty ones where none is."""
    found: dict[str, Rows] = {}
    for name in TABLES:
        path = out / VERSION / f"{name}.json"
        with atomic.reading(path, "Give another --out."):
            found[name] = json.loads(path.read_bytes()) if path.exists() else []
    return found


def _add(out: Path, new: dict[str, Rows]) -> None:
    """Add rows to the tables, in place of those that have their tokens."""
    for folder in (VERSION, "maps"):
        (out / folder).mkdir(exist_ok=True)
    (out / new["map"][0]["filename"]).write_bytes(png(np.zeros((1, 1), np.uint8)))
    for name, rows in _tables(out).items():
        tokens = {row["token"] for row in new[name]}
        kept = [row for row in rows if row["token"] not in tokens]
        atomic.write_json(out / VERSION / f"{name}.json", kept + new[name])
