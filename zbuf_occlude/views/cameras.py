"""Views and cameras from files: CSV, JSON (K, R, t per camera; NeRF's transforms.json), COLMAP's text and binary files.

Camera positions are in the mesh's own coordinates (after `up` has turned it); cameras need not look at the mesh. K is
in pixels with y down and the upper left corner of the image at (0, 0). R and t map world space to OpenCV's eye space (x
right, y down, z forward). transforms.json has OpenGL's matrices, from eye to world space.
"""

import mmap
import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.documents import Number, as_path, parse_document, read_limited
from zbuf_occlude.base.errors import OptionError, describe, escape_control
from zbuf_occlude.geometry.camera import rotations_of, unit_quaternions
from zbuf_occlude.views.model import MAX_PIXELS, PAPER_DISTANCE, ROTATION_TOLERANCE, Views, as_distance

_TO_GL = np.diag([1.0, -1.0, -1.0])
"""Matrix from OpenCV's eye space to OpenGL's."""

_SIZE, _COORDINATE = Number(1e-6, 1e9, "pixels"), Number(-1e9, 1e9, "pixels")
_VIEWS = {
    **dict.fromkeys(("azimuth", "roll"), Number(-3600.0, 3600.0, "degrees", ((-1,),))),
    "elevation": Number(-90.0, 90.0, "degrees", ((-1,),)),
    "distance": Number(1e-9, 1e9, "longest sides", ((-1,),)),
}
_ROTATION, _TRANSLATION, _K = Number(-2.0, 2.0, shapes=((3, 3),)), Number(shapes=((3,),)), Number(shapes=((3, 3),))
_QUATERNION = Number(-np.finfo(float).max, np.finfo(float).max, shapes=((4,),))
_TO_WORLD = Number(shapes=((3, 4), (4, 4)))
_R_COLUMNS, _T_COLUMNS = [f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)], ["t1", "t2", "t3"]
INTRINSICS = {"fx": _SIZE, "fy": _SIZE, "cx": _COORDINATE, "cy": _COORDINATE, "width": _SIZE, "height": _SIZE}
"""Accepted values of each number of a pinhole camera."""
_DISTORTION = dict.fromkeys(("k1", "k2", "k3", "k4", "p1", "p2"), Number())
"""Distortion parameters of transforms.json; a pinhole's are 0."""
_FRAME_NUMBERS = {
    **dict.fromkeys(("w", "h", "fl_x", "fl_y"), _SIZE),
    **dict.fromkeys(("cx", "cy"), _COORDINATE),
    "camera_angle_x": Number(1e-3, 3.14, "radians"),
    **_DISTORTION,
}
_COLMAP_MODELS = (
    ("SIMPLE_PINHOLE", 3), ("PINHOLE", 4), ("SIMPLE_RADIAL", 4), ("RADIAL", 5), ("OPENCV", 8), ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12), ("FOV", 5), ("SIMPLE_RADIAL_FISHEYE", 4), ("RADIAL_FISHEYE", 5), ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
)  # fmt: skip
"""COLMAP's camera models, in the order of their ids in binary files: name, and number of parameters."""
_FOCALS = {"SIMPLE_PINHOLE": 1, "SIMPLE_RADIAL": 1, "RADIAL": 1, "PINHOLE": 2, "OPENCV": 2, "FULL_OPENCV": 2}
"""Number of focal lengths of the models that are pinholes where all distortion parameters are 0."""


class _Camera(NamedTuple):
    """A camera of a file."""

    eye: FloatArray  # world space
    rotation: FloatArray  # world to OpenCV's eye space
    fov_bounds: Sequence[float] | None  # tangents left, right, bottom, top
    size: tuple[int, int] | None  # pixels, where the file has them


def from_csv(path: str | Path, distance: float = PAPER_DISTANCE) -> Views:
    """Read views or cameras from a CSV file with a header.

    Views have the columns azimuth, elevation (degrees) and optionally distance (in longest sides of the object) and
    roll (degrees). Cameras have r11, r12, ... r33, t1, t2, t3 and optionally fx, fy, cx, cy, width, height.

    Raises
    ------
    OptionError
        The file is missing; a column or all rows are missing; a value is no number or out of range.

    Examples
    --------
    >>> np.savetxt("views.csv", [[30, 20, 3]], delimiter=",", header="azimuth,elevation,distance", comments="")
    >>> zo.views.from_csv("views.csv").distance.tolist()
    [3.0]
    """
    columns, where = parse_document("CSV", read_limited(path), path), escape_control(str(path))
    if {*_R_COLUMNS, *_T_COLUMNS} <= set(columns):
        rows = (dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True))
        return _views(Path(path), rows, _camera_from_row)
    if not {"azimuth", "elevation"} <= set(columns):
        found = ", ".join(columns)
        raise OptionError(
            f"{where} must have the columns azimuth,elevation[,distance]; found: {found:.200}. "
            f"(Cameras: r11,...,r33,t1,t2,t3[,{','.join(INTRINSICS)}].)"
        )
    defaults = {"azimuth": "", "elevation": "", "roll": 0.0, "distance": as_distance(distance)}
    given = {name: columns.get(name, [""] * len(columns["azimuth"])) for name in defaults}
    azimuth, elevation, roll, distances = (
        np.array(_VIEWS[name].read(f"{name} in {where}", [word or default for word in given[name]]))
        for name, default in defaults.items()
    )
    return Views(np.radians(azimuth), np.radians(elevation), distances, roll=np.radians(roll))


def from_json(path: str | Path) -> Views:
    """Read cameras: NeRF's transforms.json; or objects with R, t and optionally K, width, height, in a list or lines.

    Raises
    ------
    OptionError
        The file is missing, or contains no such cameras.

    Examples
    --------
    >>> from pathlib import Path
    >>> n_written = Path("camera.json").write_text('{"R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "t": [0, 0, 5]}')
    >>> zo.views.from_json("camera.json").eyes.tolist()
    [[0.0, 0.0, -5.0]]
    """
    path = as_path(path, "path")
    data = read_limited(path)
    if path.suffix.lower() == ".jsonl":
        data = b"[" + b",".join(line for line in data.removeprefix(b"\xef\xbb\xbf").splitlines() if line.strip()) + b"]"
    document = parse_document("JSON", data, path)
    if isinstance(document, dict) and "frames" in document:
        shared = {key: value for key, value in document.items() if key != "frames"}
        return _views(path, document["frames"], lambda frame: _camera_from_frame({**shared, **frame}))
    if isinstance(document, dict):
        document = document.get("cameras", [document])
    return _views(path, document, _camera_from_object)


def from_colmap(path: str | Path) -> Views:
    """Read COLMAP's images.txt or .bin and the cameras file beside it: pinhole models without distortion.

    Raises
    ------
    OptionError
        A file is missing, damaged, or has a camera with distortion.

    Examples
    --------
    >>> from pathlib import Path
    >>> n_written = Path("images.txt").write_text("1 1 0 0 0 0 0 5 1 a.png\\n\\n")
    >>> zo.views.from_colmap("images.txt").distance.tolist()
    [5.0]
    """
    path = as_path(path, "path")
    beside = path.parent / f"cameras{path.suffix}"
    models = {f"camera {row[0]}": row for row in colmap_rows(beside)} if beside.exists() else {}
    if beside.exists() and not models:
        raise OptionError(f"{escape_control(str(beside))} contains no cameras. Copy it again.")
    return _views(path, colmap_rows(path), lambda row: _camera_from_image(row, models))


def _views(path: Path, items: Iterable[Any], read: Callable[[Any], _Camera]) -> Views:
    """Return the views of a file's items; errors name the file."""
    cameras: list[_Camera] = []
    try:
        for item in items:
            cameras.append(read(item))
        if not cameras:
            raise ValueError("it has none")
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        cause = f"no {error}" if isinstance(error, KeyError) else " ".join(str(error).split())
        raise OptionError(
            f"{escape_control(str(path))} must contain cameras, each with R and t; number {len(cameras)} cannot be "
            f"read ({cause:.200})."
        ) from None
    eyes, rotations, fov_bounds, sizes = (list(each) for each in zip(*cameras, strict=True))
    return Views.from_cameras(
        np.array(eyes),
        _TO_GL @ rotations,
        None if None in fov_bounds else np.array(fov_bounds),
        sizes=None if None in sizes else np.array(sizes, np.int32),
    )


def _camera(rotation: Any, translation: Any, intrinsics: Iterable[Any] | None, has_size: bool = True) -> _Camera:
    """Return the camera of R, t and fx, fy, cx, cy, width, height; `has_size` is True where the size is the file's."""
    turn, moved = np.array(_ROTATION.read("R", rotation)), np.array(_TRANSLATION.read("t", translation))
    if not np.abs(turn @ turn.T - np.eye(3)).max() < ROTATION_TOLERANCE or np.linalg.det(turn) < 0:
        raise ValueError("R must be a rotation, and is none")
    fov_bounds = size = None
    if intrinsics is not None:
        fx, fy, cx, cy, width, height = (
            kind.read(name, value) for (name, kind), value in zip(INTRINSICS.items(), intrinsics, strict=True)
        )
        fov_bounds = [-cx / fx, (width - cx) / fx, -(height - cy) / fy, cy / fy]
        if has_size and width == int(width) and height == int(height) and width * height <= MAX_PIXELS:
            size = int(width), int(height)
    return _Camera(-turn.T @ moved, turn, fov_bounds, size)


def _camera_from_row(row: Mapping[str, str]) -> _Camera:
    intrinsics = [row[name] for name in INTRINSICS] if row.get("fx") else None
    return _camera([row[name] for name in _R_COLUMNS], [row[name] for name in _T_COLUMNS], intrinsics)


def _camera_from_object(item: Mapping[str, Any]) -> _Camera:
    intrinsics = None
    if "K" in item:
        fx, fy, cx, cy = intrinsics_of_matrix("K", item["K"])
        intrinsics = [fx, fy, cx, cy, item.get("width", 2 * cx), item.get("height", 2 * cy)]
    return _camera(item["R"], item["t"], intrinsics, {"width", "height"} <= item.keys())


def intrinsics_of_matrix(name: str, matrix: Any) -> list[float]:
    """Return fx, fy, cx and cy of a camera matrix (3, 3); raise ValueError where it has skew."""
    (fx, skew, cx), (zero, fy, cy), last = _K.read(name, matrix)
    if skew or zero or last != [0.0, 0.0, 1.0]:
        raise ValueError(f"{name} must be fx 0 cx, 0 fy cy, 0 0 1, a pinhole without skew, and is not")
    return [fx, fy, cx, cy]


def _camera_from_frame(frame: Mapping[str, Any]) -> _Camera:
    to_world = np.array(_TO_WORLD.read("transform_matrix", frame["transform_matrix"]))
    if to_world[3:].tolist() not in ([], [[0.0, 0.0, 0.0, 1.0]]):
        raise ValueError("the last row of transform_matrix must be 0 0 0 1, and is not")
    if (model := frame.get("camera_model", "PINHOLE")) not in (*_FOCALS, "PERSPECTIVE") or frame.get("is_fisheye"):
        raise ValueError(f"its camera_model {escape_control(str(model))} is no pinhole; undistort the images first")
    given = {name: kind.read(name, frame[name]) for name, kind in _FRAME_NUMBERS.items() if frame.get(name) is not None}
    if bent := [name for name in _DISTORTION if given.get(name)]:
        raise ValueError(f"{bent[0]} is {given[bent[0]]}, a distortion; undistort the images first")
    width, height, focal = (given.get(name) for name in ("w", "h", "fl_x"))
    intrinsics = None
    if focal is None and "camera_angle_x" in given:
        width, height = width or 1.0, height or width or 1.0
        focal = 0.5 * width / np.tan(0.5 * given["camera_angle_x"])
    if focal is not None and width and height:
        centre = given.get("cx", width / 2), given.get("cy", height / 2)
        intrinsics = [focal, given.get("fl_y", focal), *centre, width, height]
    rotation = np.array(_ROTATION.read("transform_matrix", to_world[:3, :3])) @ _TO_GL
    return _camera(rotation.T, -rotation.T @ to_world[:3, 3], intrinsics, {"w", "h"} <= given.keys())


def _camera_from_image(row: Sequence[Any], models: Mapping[Any, Sequence[Any]]) -> _Camera:
    w, x, y, z = unit_quaternions(_QUATERNION.read("the quaternion", row[1:5]))
    rotation, intrinsics = rotations_of([x, y, z, w]), None
    if models:
        intrinsics = intrinsics_of_row(models[f"camera {row[8]}"])
    return _camera(rotation, row[5:8], intrinsics)


def intrinsics_of_row(row: Sequence[Any]) -> list[Any]:
    """Return fx, fy, cx, cy, width and height of a camera of COLMAP; raise ValueError where it has distortion."""
    camera, model, width, height, *words = row
    parameters = [float(word) for word in words]
    if len(parameters) != dict(_COLMAP_MODELS).get(model, len(parameters)):
        wanted = dict(_COLMAP_MODELS)[model]
        raise ValueError(f"camera {camera} must have the {wanted} parameters of a {model}; it has {len(words)}")
    n_focals = _FOCALS.get(model, 0)
    if not n_focals or any(parameters[n_focals + 2 :]):
        raise ValueError(f"camera {camera} is a {model} with distortion; undistort the images first")
    *focals, cx, cy = parameters[: n_focals + 2]
    return [focals[0], focals[-1], cx, cy, width, height]


def colmap_rows(path: Path) -> list[list[Any]]:
    """Return the rows of a cameras or images file, text or binary; in images.txt every second row, without the points.

    Raises
    ------
    OptionError
        The file cannot be read, or ends too early.
    """
    images = path.stem.endswith("images")
    try:
        if path.suffix == ".bin":
            with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
                return (_binary_images if images else _binary_cameras)(data)
        with path.open(encoding="utf-8-sig", errors="replace") as text:
            lines = [line.split(None, 20) for line in text if not line.startswith("#")]
        return list(filter(None, lines[:: 1 + images]))
    except (OSError, ValueError, OverflowError, struct.error) as error:
        cause = "it ends too early" if isinstance(error, struct.error) else describe(error)
        raise OptionError(f"{escape_control(str(path))}: cannot read the COLMAP file: {cause}.") from None


def _binary_cameras(data: mmap.mmap) -> list[list[Any]]:
    rows, (n,), offset = [], struct.unpack_from("<Q", data), 8
    for _ in range(n):
        camera, model, width, height = struct.unpack_from("<iiQQ", data, offset)
        if not 0 <= model < len(_COLMAP_MODELS):
            raise ValueError(f"camera {camera} has the unknown model {model}")
        name, n_parameters = _COLMAP_MODELS[model]
        rows.append([camera, name, width, height, *struct.unpack_from(f"<{n_parameters}d", data, offset + 24)])
        offset += 24 + 8 * n_parameters
    return rows


def _binary_images(data: mmap.mmap) -> list[list[Any]]:
    rows, (n,), offset = [], struct.unpack_from("<Q", data), 8
    for _ in range(n):
        rows.append(list(struct.unpack_from("<I7dI", data, offset)))
        end = data.find(b"\0", offset + 64)  # of the image's name, before the points
        offset = end + 9 + 24 * struct.unpack_from("<Q", data, end + 1)[0] if end >= 0 else len(data) + 1
    if offset > len(data):
        raise struct.error
    return rows
