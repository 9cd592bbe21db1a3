"""Intrinsics of one camera as files: BOP's camera.json, ROS's camera_info.yaml, COLMAP's cameras.txt, Open3D's JSON.

Files differ in the coordinates of the first pixel's centre: (0.5, 0.5) in COLMAP and in this package, (0, 0) in OpenCV,
and so in ROS, BOP and Open3D. Here cx and cy are converted.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from zbuf_occlude.base.documents import Number, as_path, parse_document, read_limited
from zbuf_occlude.base.errors import OccludeError, OptionError, escape_control
from zbuf_occlude.views.cameras import INTRINSICS, colmap_rows, intrinsics_of_matrix, intrinsics_of_row

OPENCV_ORIGIN = 0.5
"""Offset of cx and cy from those of a file whose origin is the centre of the first pixel."""
_FORMS = "BOP's camera.json, ROS's camera_info.yaml, COLMAP's cameras.txt or .bin, or Open3D's intrinsics as JSON"
_DISTORTION = Number(shapes=((-1,),))
_BINNING = Number(0, 2**32 - 1, whole=True)
_COLUMNS = Number(shapes=((3, 3),))
_CALIBRATION = ("camera_matrix", "distortion_coefficients", "image_width", "image_height")
_CAMERA_INFO = ("k", "d", "width", "height")
_DOCUMENTS = {".json": "JSON", ".yaml": "YAML", ".yml": "YAML"}


def read_intrinsics(path: str | Path) -> dict[str, float]:
    """Return the numbers of a pinhole sensor from a file of one camera: width, height, f, fy, cx, cy.

    Parameters
    ----------
    path : path-like
        BOP's camera.json, ROS's camera_info.yaml (of camera_calibration, or ``ros2 topic echo``), Open3D's intrinsics
        as JSON: the centre of the first pixel is at (0, 0). COLMAP's cameras.txt or .bin: it is at (0.5, 0.5), as in
        the result.

    Returns
    -------
    dict of str to float
        Pixels; `f` is fx.

    Raises
    ------
    OptionError
        The file cannot be read, is of another kind, has several cameras, or a camera with distortion, skew or binning.

    Examples
    --------
    >>> from pathlib import Path
    >>> text = '{"fx": 600.0, "fy": 602.0, "cx": 319.5, "cy": 239.5, "width": 640, "height": 480, "depth_scale": 1.0}'
    >>> n_written = Path("camera.json").write_text(text)
    >>> zo.sensors.make("realsense-d435", **zo.sensors.read_intrinsics("camera.json")).intrinsics[0].tolist()
    [600.0, 0.0, 320.0]
    """
    path = as_path(path, "path")
    where = escape_control(str(path))
    try:
        given, shift = _read(path)
        numbers = {name: kind.read(name, value) for (name, kind), value in zip(INTRINSICS.items(), given, strict=True)}
    except OccludeError as error:
        raise error if where in str(error) else OptionError(f"{where}: {error}") from None
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        cause = f"it has no {error}" if isinstance(error, KeyError) else " ".join(str(error).split())
        raise OptionError(f"{where} must have the intrinsics of one camera, as {_FORMS}; {cause:.200}.") from None
    centre = {"cx": numbers["cx"] + shift, "cy": numbers["cy"] + shift}
    return {"width": numbers["width"], "height": numbers["height"], "f": numbers["fx"], "fy": numbers["fy"], **centre}


def _read(path: Path) -> tuple[Sequence[Any], float]:
    """Return fx, fy, cx, cy, width and height of a file, and what is added to its cx and cy."""
    suffix = path.suffix.lower()
    if suffix in (".txt", ".bin"):
        rows = colmap_rows(path)
        if len(rows) != 1:
            raise ValueError(f"it has {len(rows)} cameras; keep the line of one")
        return intrinsics_of_row(rows[0]), 0.0
    if suffix not in _DOCUMENTS:
        raise ValueError(f"its name ends in {suffix!r}")
    document = parse_document(_DOCUMENTS[suffix], read_limited(path), path)
    if not isinstance(document, Mapping):
        raise ValueError("it has no names with values")
    if suffix != ".json":
        return _from_ros(document), OPENCV_ORIGIN
    if "intrinsic_matrix" in document:
        columns = _COLUMNS.read("intrinsic_matrix", document["intrinsic_matrix"])
        found = intrinsics_of_matrix("intrinsic_matrix, read column by column,", list(zip(*columns, strict=True)))
        return [*found, document["width"], document["height"]], OPENCV_ORIGIN
    return [document[name] for name in INTRINSICS], OPENCV_ORIGIN


def _from_ros(document: Mapping[str, Any]) -> Sequence[Any]:
    """Return fx, fy, cx, cy, width and height of a file of ROS's camera_calibration, or of a CameraInfo as text."""
    for name in ("binning_x", "binning_y"):  # 0 means 1
        if (binning := _BINNING.read(name, document.get(name, 0))) > 1:
            raise ValueError(
                f"its {name} is {binning}; divide fx, cx and width by binning_x, fy, cy and height by binning_y, and "
                "set both to 1"
            )
    names = _CAMERA_INFO if "k" in document else _CALIBRATION
    matrix, distortion, width, height = (document[name] for name in names)
    matrix, distortion = (each["data"] if isinstance(each, Mapping) else each for each in (matrix, distortion))
    if any(_DISTORTION.read(names[1], distortion)):
        model = escape_control(str(document.get("distortion_model", "")))
        raise ValueError(
            f"its distortion ({model:.30}) is not 0; rectify the images, and give the numbers of the rectified camera"
        )
    return [*intrinsics_of_matrix(names[0], matrix), width, height]
