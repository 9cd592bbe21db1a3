"""Logs of drives with LiDARs and labelled boxes, as their makers publish them, read without a choice by the user.

=================  ================================================================================================
a folder with      annotations*.feather of Argoverse 2, with calibration/egovehicle_SE3_sensor.feather if it is there
                   velodyne/*.bin, label_2/*.txt, calib/*.txt of KITTI's objects; label_02 of its tracking
                   velodyne_points/data/*.bin and tracklet_labels.xml of KITTI's raw data
                   sample_annotation.json and the other tables of nuScenes
                   *.pkl of MMDetection3D, with the .bin that they name
a table            .tsv or .csv with category, length, width, height, x, y, z, yaw_deg, n_points
=================  ================================================================================================

The sensor is the one of the table of sensors whose lasers' elevations explain the points best; firings per turn are as
the points' azimuths are spaced. Without points it is the one that the maker of the log names. Returns in boxes are
counted where there are points, else they are as the makers counted them. A sweep that cannot be read is skipped and
named. A file of the whole log that cannot be read ends in one line.
"""

import csv
import io
import json
import pickle
import zlib
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from zbuf_occlude.base.errors import OccludeError
from zbuf_occlude.sensors import SENSORS, make
from zbuf_occlude.sensors.sensor import Sensor
from zbuf_occlude.studies.compare.scan_comparison import DEPTH_UNIT
from zbuf_occlude.studies.compare.scan_files import read_scan_file

ARGOVERSE_MOUNTS = ((1.35, 0.0, 1.64, (1.0, 0.0, 0.0, 0.0)), (1.35, 0.0, 1.53, (0.0, 1.0, 0.0, 0.0)))
"""x, y, z and quaternion (w first) of its two VLP-32C, one upside down; where a log has no calibration of its own."""
COLUMNS = ("category", "length", "width", "height", "x", "y", "z", "yaw_deg", "n_points")
KITTI_CATEGORIES = ("Pedestrian", "Cyclist", "Car")
CLOUDS = 4
"""Sweeps from which the sensor is found."""
SHARPNESS = 0.1
"""Degrees that returns lie off a laser's elevation: cars pitch while the sensor turns."""
LEAST_POINTS = 1000
"""Beyond 4 m, of fewer of which a sensor is not told from others."""
SLACK = 0.05
"""Metres. Where returns are counted here, real or simulated, a box is so much wider to each side and higher: labels are
rounded, and ranges have noise (sigma 0.02 m of the HDL-64E). It begins so much above its foot: there the ground is."""


@dataclass(frozen=True, eq=False)
class Box:
    """A labelled box; lengths in metres, the log's frame."""

    category: str
    sides: np.ndarray
    centre: np.ndarray
    yaw: float
    n_points: int | None
    """Real returns in it; None where they were not counted."""
    identity: int
    """The same of the same object in all sweeps."""

    def __post_init__(self) -> None:
        numbers = [*self.sides, *self.centre, self.yaw]
        if len(numbers) != 7 or not np.isfinite(numbers).all() or not min(self.sides) > 0.0:
            said = ", ".join(f"{number:g}" for number in numbers)
            raise ValueError(f"a box must have 7 finite numbers and sides above 0; one of {self.category} has {said}")


class DriveSweep(NamedTuple):
    """The boxes of one turn, poses of the LiDARs in their frame, and the file of the turn's points, if there is one."""

    boxes: list[Box]
    mounts: list[np.ndarray]
    cloud: Path | None = None


class Log(NamedTuple):
    """A drive: its form, its turns, its sensor, how that was found, and of each turn that could not be read why."""

    form: str
    sweeps: list[DriveSweep]
    sensor: Sensor
    found: str
    skipped: list[str]


def read_log(path: Path, sensor: str | None = None) -> Log:
    """Read a log of any form; `sensor` is told instead of found."""
    skipped: list[str] = []
    read = ((form, usual, counted(reader(path, skipped), skipped)) for form, usual, reader in FORMS)
    form, usual, sweeps = next((each for each in read if each[2]), ("", "", []))
    if not sweeps and skipped:
        raise SystemExit(f"error: {skipped[0]}")
    if not sweeps:
        raise SystemExit(f"error: {path} must be a log of drives, a folder or a table; see {Path(__file__).name}.")
    if sensor is not None:
        return Log(form, sweeps, make(sensor), "told", skipped)
    clouds = [sweep.cloud for sweep in sweeps if sweep.cloud is not None and len(sweep.mounts) == 1]
    if not clouds and form == FORMS[0][0] and len(sweeps[0].mounts) == 1:
        raise SystemExit(f"error: {path} has boxes in the LiDAR's own frame and no points. Name it: --sensor NAME.")
    if not clouds:
        return Log(form, sweeps, make(usual), f"named by {form}", skipped)
    found, poor = list[tuple[Sensor, str]](), list[str]()
    for cloud in clouds[:: -(-len(clouds) // CLOUDS)]:
        with skipping(poor), reading(cloud):
            found.append(found_sensor(points_of(cloud)))
    if not found:
        raise SystemExit(f"error: {poor[0]}")
    names = {made.name for made, _ in found}
    if len(names) > 1:
        raise SystemExit(f"error: {path} must be of one sensor; it has {', '.join(sorted(names))}. Give each alone.")
    columns = round(np.median([made.pattern["columns"] for made, _ in found]))
    return Log(form, sweeps, make(names.pop(), columns=columns), found[0][1], skipped)


@contextmanager
def reading(file: Path | str) -> Iterator[None]:
    """End the program with one line where a file cannot be read, whatever is the matter with it."""
    try:
        yield
    except Exception as error:
        words = f"{error}".partition("\n")[0].removeprefix(f"{file}: ")
        known = isinstance(error, OccludeError | ValueError | OSError) and words
        raise SystemExit(f"error: {file}: {words if known else f'{type(error).__name__} {words}'}") from None


@contextmanager
def skipping(skipped: list[str]) -> Iterator[None]:
    """Go on where a sweep cannot be read, for which the program would end, and keep the reason."""
    try:
        yield
    except SystemExit as error:
        skipped.append(f"{error}".removeprefix("error: "))


@lru_cache(2)
def points_of(cloud: Path) -> np.ndarray:
    """Return a sweep's points (n, 3) in its sensor's frame."""
    return read_scan_file(cloud, SENSORS["hdl-64e"], DEPTH_UNIT)


def found_sensor(points: np.ndarray) -> tuple[Sensor, str]:
    """Return the spinning sensor whose lasers explain the elevations of a turn's points best, and words about that."""
    far = points[np.hypot(*points[:, :2].T) > 4.0]
    if len(far) < LEAST_POINTS:
        raise ValueError(f"a sensor is found from {LEAST_POINTS} points; it has {len(far)}. Name it: --sensor NAME.")
    some, scores = far[:: -(-len(far) // 20_000)], {}
    for name in (name for name, sensor in SENSORS.items() if sensor.kind == "spinning"):
        near = [np.exp(-0.5 * (above / SHARPNESS) ** 2) for above in SENSORS[name].angles_above_lasers(some)]
        scores[name] = float(np.log(np.mean(near, axis=0) / SHARPNESS + 1e-3).mean())
    first, second = sorted(scores, key=lambda name: -scores[name])[:2]
    rings = np.argmin([np.abs(above) for above in SENSORS[first].angles_above_lasers(far)], axis=0)
    azimuths = np.degrees(np.arctan2(far[:, 1], far[:, 0]))
    steps = np.concatenate([np.diff(np.sort(azimuths[rings == ring])) for ring in np.unique(rings)])
    steps = steps[steps > 0.02]  # nearer ones are of the same firing, at two ranges
    if not len(steps):
        raise ValueError("a sensor is found from a turn; this is none. Name it: --sensor NAME.")
    columns = round(360.0 / steps[steps < 1.5 * np.median(steps)].mean())
    words = f"by elevations, e^{scores[first] - scores[second]:.1f} times as likely per point as {second}"
    return make(first, columns=columns), words


def within(box: Box, points: np.ndarray, slack: float = 0.0) -> np.ndarray:
    """Return which points (n, 3) are in a box, with a slack to its sides and upwards as `SLACK` has it."""
    local = (points - box.centre) @ turned(box.yaw) - [0.0, 0.0, slack]
    return (np.abs(local) <= box.sides / 2 + [slack, slack, 0.0]).all(axis=1)


def count_in(box: Box, points: np.ndarray) -> Box:
    """Return a box with the points counted that are its own."""
    return replace(box, n_points=int(within(box, points, SLACK).sum()))


def counted(sweeps: Iterable[DriveSweep], skipped: list[str]) -> list[DriveSweep]:
    """Return sweeps with the points counted that are in their boxes, where they have points."""
    found = []
    for sweep in sweeps:
        if sweep.cloud is None:
            found.append(sweep)
            continue
        with skipping(skipped), reading(sweep.cloud):
            points = points_of(sweep.cloud) @ sweep.mounts[0][:3, :3].T + sweep.mounts[0][:3, 3]
            found.append(sweep._replace(boxes=[count_in(box, points) for box in sweep.boxes]))
    return found


def turned(yaw: float) -> np.ndarray:
    """Return the rotation (3, 3) about z."""
    return Rotation.from_euler("z", yaw).as_matrix()


def pose_from(rotation: np.ndarray, position: Any) -> np.ndarray:
    """Return a pose (4, 4)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    return pose


def rotation_from(w: float, x: float, y: float, z: float) -> np.ndarray:
    """Return its rotation (3, 3)."""
    return Rotation.from_quat([x, y, z, w]).as_matrix()


def heading(rotation: np.ndarray) -> float:
    """Return where a rotation turns the x axis to, seen from above."""
    return float(np.arctan2(rotation[1, 0], rotation[0, 0]))


def number_of(name: object) -> int:
    """Return a number that tells objects apart by their names."""
    return zlib.crc32(f"{name}".encode())


def of_argoverse(path: Path, skipped: list[str]) -> Iterator[DriveSweep]:
    """Argoverse 2: boxes in the car's frame, their returns counted by the makers."""
    files = [path] if path.suffix == ".feather" else sorted(path.rglob("annotations*.feather"))
    for file in files:
        with reading(file):
            import pandas

            rows, calibration = pandas.read_feather(file), file.parent / "calibration" / "egovehicle_SE3_sensor.feather"
            mounts = [pose_from(rotation_from(*q), at) for *at, q in ARGOVERSE_MOUNTS]
            if calibration.exists():
                table = pandas.read_feather(calibration)
                mounts = [
                    pose_from(rotation_from(row.qw, row.qx, row.qy, row.qz), (row.tx_m, row.ty_m, row.tz_m))
                    for row in table[table.sensor_name.isin(["up_lidar", "down_lidar"])].itertuples()
                ]
            if "num_interior_pts" not in rows:
                raise SystemExit(f"error: {file} must have num_interior_pts; it has {', '.join(rows.columns)}.")
            for stamp, sweep in rows.groupby("timestamp_ns"):
                with skipping(skipped), reading(f"{file}, {stamp}"):
                    boxes = [
                        Box(
                            row.category,
                            np.array([row.length_m, row.width_m, row.height_m]),
                            np.array([row.tx_m, row.ty_m, row.tz_m]),
                            heading(rotation_from(row.qw, row.qx, row.qy, row.qz)),
                            int(row.num_interior_pts),
                            number_of(row.track_uuid),
                        )
                        for row in sweep.itertuples()
                    ]
                    yield DriveSweep(boxes, mounts)


def of_table(path: Path, skipped: list[str]) -> Iterator[DriveSweep]:
    """A table of boxes in a frame on the ground, Argoverse 2's car's, or in the LiDAR's own, which is above 1 m.

    Sweeps begin where the categories begin anew, in their order.
    """
    if path.suffix not in (".tsv", ".csv"):
        return
    with reading(path):
        rows = csv.DictReader(path.read_text().splitlines(), delimiter="\t" if path.suffix == ".tsv" else ",")
        if missing := [name for name in COLUMNS if name not in (rows.fieldnames or ())]:
            raise ValueError(f"it must have the columns {', '.join(COLUMNS)}; it has no {missing[0]}")
        sweeps, feet = [list[Box]()], []
        for row in rows:
            length, width, height, x, y, z, yaw, n_points = (float(row[name]) for name in COLUMNS[1:])
            if sweeps[-1] and row["category"] < sweeps[-1][-1].category:
                sweeps.append([])
            sides = [length, width, height]
            place = np.array(sides), np.array([x, y, z]), np.radians(yaw)
            sweeps[-1].append(Box(row["category"], *place, int(n_points), number_of(sides)))
            feet.append(z - height / 2)
        if not feet:
            raise ValueError("it must have boxes; it has none")
    mounts = [pose_from(rotation_from(*q), at) for *at, q in ARGOVERSE_MOUNTS]
    yield from (DriveSweep(boxes, mounts if np.median(feet) > -1.0 else [np.eye(4)]) for boxes in completed(sweeps))


MOST_STEP = 2.5
"""Metres per sweep, in the car's frame, beyond which two boxes of the same sides are two objects."""
LONGEST_GAP = 15
"""Sweeps for which an object may be missing."""


def completed(sweeps: list[list[Box]]) -> list[list[Box]]:
    """Add the boxes that a table leaves out where they must have stood: between two sightings of the same object.

    Tables may be samples of a drive's boxes; what is left out hides others all the same.
    """
    full = [list(boxes) for boxes in sweeps]
    last_seen: dict[tuple[str, int], list[tuple[int, Box]]] = {}
    for number, boxes in enumerate(sweeps):
        for seen in boxes:
            same = last_seen.setdefault((seen.category, seen.identity), [])
            # one of the same sides in the same sweep is another object: it is infinitely fast
            away = np.array([np.linalg.norm(seen.centre - box.centre) for _, box in same])
            steps = away / np.array([max(number - before, 1e-9) for before, _ in same])
            if len(steps) and steps.min() <= MOST_STEP:
                before, box = same.pop(int(steps.argmin()))
                if number - before <= LONGEST_GAP:
                    for missing in range(before + 1, number):
                        share = (missing - before) / (number - before)
                        turn = (seen.yaw - box.yaw + np.pi) % (2.0 * np.pi) - np.pi
                        centre = box.centre + share * (seen.centre - box.centre)
                        between = replace(box, centre=centre, yaw=box.yaw + share * turn, n_points=None)
                        full[missing].append(between)
            same.append((number, seen))
    return full


def of_kitti(path: Path, skipped: list[str]) -> Iterator[DriveSweep]:
    """KITTI's objects and tracking: boxes in the camera's frame, turned into the LiDAR's."""
    for cloud in sorted(path.rglob("velodyne/**/*.bin")):
        folder = next(above for above in cloud.parents if above.name == "velodyne")
        stem = cloud.parent.name if cloud.parent != folder else cloud.stem  # tracking has a file per sequence
        labels = next(folder.parent.glob(f"label_*/{stem}.txt"), None)
        calibration = folder.parent / "calib" / f"{stem}.txt"
        if labels is None or not calibration.exists():
            continue
        is_track, boxes = cloud.parent != folder, []
        with skipping(skipped):
            with reading(calibration):
                to_lidar = of_calibration(calibration.read_text())
            with reading(labels):
                rows = [line.split() for line in labels.read_text().splitlines() if line.strip()]
                if wrong := [row for row in rows if len(row) - 2 * is_track not in (15, 16)]:
                    raise ValueError(f"a row must have {15 + 2 * is_track} fields; one has {len(wrong[0])}")
                if is_track:
                    rows = [[*row[2:17], row[1]] for row in rows if int(row[0]) == int(cloud.stem)]
                for number, row in enumerate(rows):
                    height, width, length, *at, turn = map(float, row[8:15])
                    identity = number_of((stem, row[15] if is_track else number))
                    if row[0] != "DontCare":
                        sides = np.array([length, width, height])
                        boxes.append(of_camera(row[0], sides, at, turn, to_lidar, identity))
            yield DriveSweep(boxes, [np.eye(4)], cloud)


def of_calibration(text: str) -> np.ndarray:
    """Return the pose (4, 4) of KITTI's camera in the LiDAR's frame."""
    matrices = {}
    for name, *values in (line.replace(":", " ").split() for line in text.splitlines() if line.strip()):
        for pattern, shape in (("Tr_velo", (3, 4)), ("R0_rect", (3, 3)), ("R_rect", (3, 3))):
            if name.startswith(pattern):
                matrices[shape] = np.array(values, dtype=float).reshape(shape)
    if len(matrices) < 2:
        raise ValueError("a calibration must have the rows Tr_velo_to_cam and R0_rect")
    to_camera = np.eye(4)
    to_camera[:3] = matrices[3, 4]
    return np.linalg.inv(pose_from(matrices[3, 3], 0.0) @ to_camera)


def of_camera(
    category: str, sides: np.ndarray, foot: Any, turn: float, to_lidar: np.ndarray, identity: int, n: int | None = None
) -> Box:
    """Return a box whose foot and turn about the camera's y axis are given."""
    centre = to_lidar[:3, :3] @ (np.array(foot) - [0.0, sides[2] / 2, 0.0]) + to_lidar[:3, 3]
    ahead = to_lidar[:3, :3] @ [np.cos(turn), 0.0, -np.sin(turn)]
    return Box(category, sides, centre, float(np.arctan2(ahead[1], ahead[0])), n, identity)


def of_tracklets(path: Path, skipped: list[str]) -> Iterator[DriveSweep]:
    """KITTI's raw data: tracklets in the LiDAR's frame."""
    for file in sorted(path.rglob("tracklet_labels.xml")):
        with reading(file):
            boxes = defaultdict(list)
            for number, track in enumerate(ElementTree.parse(file).getroot().findall("./tracklets/item")):
                sides = np.array([float(track.findtext(side, "")) for side in "lwh"])
                first = int(track.findtext("first_frame", ""))
                for frame, pose in enumerate(track.findall("./poses/item"), first):
                    x, y, z, yaw = (float(pose.findtext(name, "")) for name in ("tx", "ty", "tz", "rz"))
                    category, centre = track.findtext("objectType", ""), np.array([x, y, z + sides[2] / 2])
                    boxes[frame].append(Box(category, sides, centre, yaw, None, number_of(number)))
            for cloud in sorted(file.parent.glob("velodyne_points/data/*.bin")):
                yield DriveSweep(boxes[int(cloud.stem)], [np.eye(4)], cloud)


def of_nuscenes(path: Path, skipped: list[str]) -> Iterator[DriveSweep]:
    """nuScenes' tables: boxes in the world, turned into the car's frame at each key frame."""
    for file in sorted(path.rglob("sample_annotation.json")):

        def table(name: str, folder: Path = file.parent) -> dict[str, dict[str, Any]]:
            return {row["token"]: row for row in json.loads((folder / f"{name}.json").read_text())}

        with reading(file):
            sensors, calibrated, poses = table("sensor"), table("calibrated_sensor"), table("ego_pose")
            instances, categories, annotations = table("instance"), table("category"), defaultdict(list)
            for row in table("sample_annotation").values():
                annotations[row["sample_token"]].append(row)
            for frame in table("sample_data").values():
                with skipping(skipped), reading(f"{file}, {frame['token']}"):
                    mount = calibrated[frame["calibrated_sensor_token"]]
                    if not frame["is_key_frame"] or "LIDAR_TOP" not in sensors[mount["sensor_token"]]["channel"]:
                        continue
                    car = poses[frame["ego_pose_token"]]
                    back = rotation_from(*car["rotation"]).T
                    boxes = []
                    for row in annotations[frame["sample_token"]]:
                        width, length, height = row["size"]
                        category = categories[instances[row["instance_token"]]["category_token"]]["name"]
                        centre = back @ (np.array(row["translation"]) - car["translation"])
                        yaw, seen = heading(back @ rotation_from(*row["rotation"])), row["num_lidar_pts"]
                        sides, identity = np.array([length, width, height]), number_of(row["instance_token"])
                        boxes.append(Box(category, sides, centre, yaw, seen if seen >= 0 else None, identity))
                    clouds = (root / frame["filename"] for root in file.parents)
                    cloud = next((each for each in clouds if each.exists()), None)
                    yield DriveSweep(boxes, [pose_from(rotation_from(*mount["rotation"]), mount["translation"])], cloud)


class _Plain(pickle.Unpickler):
    """Reads NumPy's numbers and arrays, and what Python has built in; nothing else."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) == ("_codecs", "encode") or (
            module.split(".")[0] == "numpy" and name in ("scalar", "_reconstruct", "dtype", "ndarray", "_frombuffer")
        ):
            return super().find_class(module, name)
        raise pickle.UnpicklingError(f"{module}.{name} is not read")


def of_pickles(path: Path, skipped: list[str]) -> Iterator[DriveSweep]:
    """MMDetection3D's: boxes in the camera's frame of KITTI, in the LiDAR's of nuScenes."""
    for file in sorted(path.rglob("*.pkl")):
        with reading(file):
            document = _Plain(io.BytesIO(file.read_bytes())).load()
            names = list(document["metainfo"].get("categories", KITTI_CATEGORIES))
            for place, frame in enumerate(document["data_list"]):
                with skipping(skipped), reading(f"{file}, frame {place}"):
                    lidar, boxes = frame["lidar_points"], []
                    for number, row in enumerate(frame["instances"]):
                        label, seen = row["bbox_label_3d"], int(row["num_lidar_pts"])
                        category = names[label] if label >= 0 else "other"
                        identity = number_of((lidar["lidar_path"], number))
                        x, y, z, *sides, turn = row["bbox_3d"]
                        if min(sides) == max(sides) == -1.0:  # KITTI's DontCare
                            continue
                        if "Tr_velo_to_cam" in lidar:
                            to_camera = np.array(frame["images"]["R0_rect"]) @ np.array(lidar["Tr_velo_to_cam"])
                            sizes, back = np.array(sides)[[0, 2, 1]], np.linalg.inv(to_camera)
                            boxes.append(of_camera(category, sizes, (x, y, z), turn, back, identity, seen))
                        else:
                            boxes.append(Box(category, np.array(sides), np.array([x, y, z]), turn, seen, identity))
                    cloud = next(file.parent.rglob(Path(lidar["lidar_path"]).name), None)
                    yield DriveSweep(boxes, [np.eye(4)], cloud)


FORMS: tuple[tuple[str, str, Callable[[Path, list[str]], Iterator[DriveSweep]]], ...] = (
    ("a table of Argoverse 2", "vlp-32c", of_table),
    ("Argoverse 2", "vlp-32c", of_argoverse),
    ("nuScenes", "hdl-32e:columns=1084,turns=20", of_nuscenes),
    ("KITTI's raw data", "hdl-64e", of_tracklets),
    ("KITTI", "hdl-64e", of_kitti),
    ("MMDetection3D", "hdl-64e", of_pickles),
)
"""A form, the sensor of its makers, and who reads it: nothing where it is not of this form."""
