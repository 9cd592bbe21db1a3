"""Views and cameras from files: CSV, JSON (K, R, t per camera; NeRF's transforms.json), COLMAP's text.

Cameras have positions in the mesh's own coordinates (after `up` has turned it) and need not look at it. K is in pixels
with y down and the corner of the upper left pixel at (0, 0); R and t take world space to OpenCV's eye space (x right,
y down, z forward), as usual; transforms.json holds OpenGL's, from eye to world space.
"""

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.errors import ArgumentError, OptionError, in_words
from zbuf_occlude.views.model import Views
from zbuf_occlude.views.positions import PAPER_DISTANCE

_TO_GL = np.diag([1.0, -1.0, -1.0])
"""OpenCV's eye space to OpenGL's."""
_ROTATION = [f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)]
_TRANSLATION = ("t1", "t2", "t3")
_INTRINSICS = ("fx", "fy", "cx", "cy", "width", "height")
_DISTORTION = ("k1", "k2", "k3", "k4", "p1", "p2")
"""What transforms.json may say of its cameras, and pinholes do not have."""
_NOT_A_ROTATION = 1e-3


class _Camera(NamedTuple):
    """OpenCV's, of a file: x_eye = rotation @ x + translation; fx, fy, cx, cy, width, height, or None."""

    rotation: FloatArray
    translation: FloatArray
    intrinsics: Sequence[float] | None


def from_csv(path: str | Path, distance: float = PAPER_DISTANCE) -> Views:
    """Read views or cameras from a CSV with a header.

    Views have the columns azimuth, elevation (degrees) and, optionally, distance, in longest sides of the object, and
    roll, in degrees. Cameras have r11, r12, ... r33, t1, t2, t3 and, optionally, fx, fy, cx, cy, width, height.

    Raises
    ------
    OptionError
        The file is missing, lacks a column, has no rows, or holds something that is not a number or out of range.
    """
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file, skipinitialspace=True))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise OptionError(f"views must be a readable CSV; {path}: {in_words(error)}.") from None
    columns = set(rows[0]) if rows else set()
    if {*_ROTATION, *_TRANSLATION} <= columns:
        return _views(Path(path), rows, _camera_of_row)
    if not {"azimuth", "elevation"} <= columns:
        found = ", ".join(map(str, rows[0])) if rows else "no rows"
        raise OptionError(
            f"{path} must have the columns azimuth,elevation[,distance] and a row; found: {found}. "
            f"(Cameras: {_ROTATION[0]},...,{_ROTATION[-1]},{','.join(_TRANSLATION)}[,{','.join(_INTRINSICS)}].)"
        )
    try:
        table = np.array([[float(r[c]) for c in ("azimuth", "elevation")] for r in rows])
        distances = np.array([float(r.get("distance") or distance) for r in rows])
        roll = np.array([float(r.get("roll") or 0.0) for r in rows])
    except (TypeError, ValueError) as error:
        raise OptionError(f"{path} must hold numbers, angles in degrees; {error}.") from None
    if (np.abs(table[:, 1]) > 90).any():
        worst = table[np.abs(table[:, 1]).argmax(), 1]
        raise OptionError(f"{path} must hold elevations in [-90, 90] degrees from the xy plane; got {worst:g}.")
    try:
        return Views(np.radians(table[:, 0]), np.radians(table[:, 1]), distances, roll=np.radians(roll))
    except ArgumentError as error:
        raise OptionError(f"{path}, a table of views in degrees: {error}") from None


def from_json(path: Path) -> Views:
    """Read cameras: NeRF's transforms.json; or objects with R, t and optionally K, width, height, in a list or lines.

    Raises
    ------
    OptionError
        The file is missing or holds no cameras of these forms.
    """
    text = _text(path)
    try:
        try:
            document = json.loads(text)
        except ValueError:
            document = [json.loads(line) for line in text.splitlines() if line.strip()]
    except (ValueError, RecursionError) as error:
        raise OptionError(f"{path} must be JSON; it cannot be read: {error}.") from None
    if isinstance(document, dict) and "frames" in document:
        shared = {key: value for key, value in document.items() if key != "frames"}
        return _views(path, document["frames"], lambda frame: _camera_of_frame({**shared, **frame}))
    if isinstance(document, dict):
        document = document.get("cameras", [document])
    return _views(path, document, _camera_of_object)


def from_colmap(path: Path) -> Views:
    """Read COLMAP's images.txt, and cameras.txt next to it, if there: pinhole models without distortion.

    Raises
    ------
    OptionError
        A file is missing, damaged, or has a camera with distortion.
    """
    beside = path.with_name("cameras.txt")
    models = {row[0]: row for row in _rows(beside)} if beside.exists() else {}
    return _views(path, _rows(path, 2), lambda row: _camera_of_image(row, models))


def _views(path: Path, items: Any, read: Any) -> Views:
    """Turn what a file holds into views; whatever it lacks is said with the file's name."""
    try:
        cameras = [read(item) for item in items]
        if not cameras:
            raise ValueError("it holds none")
        rotations = np.array([camera.rotation for camera in cameras], dtype=np.float64).reshape(-1, 3, 3)
        translations = np.array([camera.translation for camera in cameras], dtype=np.float64).reshape(-1, 3)
        worst = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max()
        if not worst < _NOT_A_ROTATION or not (np.linalg.det(rotations) > 0).all():
            raise ValueError("R must be a rotation, and one is not")
        eyes = -np.einsum("kji,kj->ki", rotations, translations)
        windows = None
        if all(camera.intrinsics is not None for camera in cameras):
            windows = np.array([_window(camera.intrinsics) for camera in cameras])
        return Views.of_cameras(eyes, _TO_GL @ rotations, windows)
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        said = f"no {error}" if isinstance(error, KeyError) else " ".join(str(error).split())[:120]
        raise OptionError(f"{path} must hold cameras, each with R and t; it cannot be read ({said}).") from None


def _window(intrinsics: Sequence[float]) -> list[float]:
    """Return the tangents left, right, bottom, top of a picture."""
    fx, fy, cx, cy, width, height = map(float, intrinsics)
    if not (fx > 0 and fy > 0 and width > 0 and height > 0):
        raise ValueError("focal lengths and sizes must be positive")
    return [-cx / fx, (width - cx) / fx, -(height - cy) / fy, cy / fy]


def _camera_of_row(row: Mapping[str, str]) -> _Camera:
    rotation = np.array([float(row[name]) for name in _ROTATION]).reshape(3, 3)
    intrinsics = [float(row[name]) for name in _INTRINSICS] if row.get("fx") else None
    return _Camera(rotation, np.array([float(row[name]) for name in _TRANSLATION]), intrinsics)


def _camera_of_object(item: Mapping[str, Any]) -> _Camera:
    intrinsics = None
    if "K" in item:
        (fx, _, cx), (_, fy, cy), _ = np.asarray(item["K"], dtype=np.float64).reshape(3, 3).tolist()
        intrinsics = [fx, fy, cx, cy, item.get("width", 2 * cx), item.get("height", 2 * cy)]
    return _Camera(np.asarray(item["R"], dtype=np.float64).reshape(3, 3), np.asarray(item["t"]).reshape(3), intrinsics)


def _camera_of_frame(frame: Mapping[str, Any]) -> _Camera:
    to_world = np.asarray(frame["transform_matrix"], dtype=np.float64).reshape(-1, 4)[:3]
    rotation = _TO_GL @ to_world[:, :3].T
    if bent := [name for name in _DISTORTION if frame.get(name)]:
        raise ValueError(f"{bent[0]} is {frame[bent[0]]}, a distortion; undistort the images first")
    width, height = frame.get("w"), frame.get("h")
    focal = frame.get("fl_x")
    intrinsics = None
    if focal is None and "camera_angle_x" in frame:
        width, height = width or 1.0, height or width or 1.0
        focal = 0.5 * width / np.tan(0.5 * float(frame["camera_angle_x"]))
    if focal is not None and width and height:
        centre = frame.get("cx", width / 2), frame.get("cy", height / 2)
        intrinsics = [focal, frame.get("fl_y", focal), *centre, width, height]
    return _Camera(rotation, -rotation @ to_world[:, 3], intrinsics)


def _camera_of_image(row: Sequence[str], models: Mapping[str, Sequence[str]]) -> _Camera:
    w, x, y, z, *translation = map(float, row[1:8])
    w, x, y, z = np.array([w, x, y, z]) / np.linalg.norm([w, x, y, z])
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    intrinsics = None
    if models:
        _, model, width, height, *parameters = models[row[8]]
        numbers = [float(parameter) for parameter in parameters]
        n_linear = 4 if model in ("PINHOLE", "OPENCV", "FULL_OPENCV", "OPENCV_FISHEYE") else 3
        if any(numbers[n_linear:]) or "FISHEYE" in model:
            raise ValueError(f"camera {row[8]} is a {model} with distortion; undistort the images first")
        fx, fy, cx, cy = numbers[:4] if n_linear == 4 else (numbers[0], *numbers[:3])
        intrinsics = [fx, fy, cx, cy, float(width), float(height)]
    return _Camera(rotation, np.array(translation), intrinsics)


def _rows(path: Path, step: int = 1) -> list[list[str]]:
    """Return the words of every `step`-th line that is no comment."""
    lines = [line for line in _text(path).splitlines() if not line.startswith("#")]
    return [line.split() for line in (lines[::step] if step > 1 else lines) if line.strip()]


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise OptionError(f"cameras must be a readable text file; {path}: {in_words(error)}.") from None
