"""Catalogue of sensors, every number with its source; and sensors from files.

A new sensor is a row of `ROWS`, a YAML file of numbers, or a CSV file of directions.
"""

from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from zbuf_occlude.base.documents import Number, parse_document, parse_line, read_limited
from zbuf_occlude.base.errors import ArgumentError, OccludeError, OptionError, check_choice, escape_control
from zbuf_occlude.sensors.rays import PATTERNS, numbers_of
from zbuf_occlude.sensors.sensor import NoiseModel, Sensor

SUFFIXES = (".yaml", ".yml", ".csv")
ANGLES, VECTORS = ("azimuth", "elevation"), ("x", "y", "z")
_COLUMNS = {
    "azimuth": Number(-3600.0, 3600.0, "degrees", ((-1,),)),
    "elevation": Number(-90.0, 90.0, "degrees", ((-1,),)),
    **dict.fromkeys(VECTORS, Number(shapes=((-1,),))),
}


class SensorRow(NamedTuple):
    """A sensor as data: its numbers, each with its source."""

    name: str
    kind: str
    summary: str
    numbers: dict[str, tuple[Any, str]]

    def sensor(self) -> Sensor:
        """Return the sensor."""
        values = {name: value for name, (value, _) in self.numbers.items()}
        pattern = {name: value for name, value in values.items() if name in numbers_of(self.kind)}
        noise_model = NoiseModel(**{name: value for name, value in values.items() if name not in pattern})
        sources = {name: source for name, (_, source) in self.numbers.items()}
        return Sensor(self.name, self.kind, pattern, noise_model, self.summary, sources)


def make(name: str | Path | Sensor, /, **numbers: Any) -> Sensor:
    """Return a sensor.

    Parameters
    ----------
    name : str, Path or Sensor
        A name of the table, a YAML or CSV file, or a name with numbers: ``pinhole:width=320,height=240,fov=60``. A
        sensor is returned with the changed numbers.
    **numbers
        Numbers to change, such as ``columns=900`` or ``noise=0`` (no losses and no noise).

    Raises
    ------
    ArgumentError
        `name` is no name, path or sensor.
    OptionError
        An unknown sensor or number, or a value out of range.

    Examples
    --------
    >>> zo.sensors.make("hdl-64e", columns=900).name
    'hdl-64e'
    """
    if not isinstance(name, str | Path | Sensor):
        raise ArgumentError(f"sensor must be a Sensor, a name or a file; got {type(name).__name__}.")
    if isinstance(name, Sensor):
        return name.with_numbers(**numbers) if numbers else name
    name = str(name)
    if Path(name).suffix.lower() in SUFFIXES:
        sensor = read_sensor(Path(name)).sensor()
    else:
        name, _, typed = name.partition(":")
        check_choice("sensor", name, [*SENSORS, "a .yaml or .csv file"])
        sensor = SENSORS[name]
        for setting in filter(None, typed.split(",")):
            key, equals, value = setting.partition("=")
            if not equals:
                raise OptionError(f"a sensor's numbers must be given as name=value; got {setting!r}.")
            numbers = {key.strip(): value.strip(), **numbers}
    return sensor.with_numbers(**numbers) if numbers else sensor


def read_sensor(path: Path) -> SensorRow:
    """Read a sensor's row from a file.

    Parameters
    ----------
    path : Path
        A YAML file with ``kind`` and the numbers of a row, optionally ``name``, ``summary`` and ``source`` (one for
        all numbers); or a CSV file with the columns azimuth and elevation (degrees) or x, y and z, optionally ring.

    Raises
    ------
    OptionError
        The file cannot be read, or is no sensor; the message says what is wrong.
    """
    row = (_row_from_csv if path.suffix.lower() == ".csv" else _row_from_yaml)(path, read_limited(path))
    try:
        row.sensor().rays()
    except OccludeError as error:
        raise OptionError(f"{escape_control(str(path))}: {error}") from None
    return row


def _row_from_yaml(path: Path, data: bytes) -> SensorRow:
    given, where = parse_document("YAML", data, path), escape_control(str(path))
    if not isinstance(given, dict) or "kind" not in given:
        raise OptionError(f"{where} must have a line `kind:` and a sensor's numbers; see docs/sensors.md.")
    words = {"kind": "", "name": path.stem, "summary": f"from {path.name}", "source": path.name}
    words = {name: parse_line(f"{name} in {where}", given.pop(name, default)) for name, default in words.items()}
    check_choice(f"kind in {where}", words["kind"], PATTERNS)
    known = [*numbers_of(words["kind"]), *(each.name for each in fields(NoiseModel))]
    for name in given:
        check_choice(f"a number in {where}", name, known)
    return SensorRow(words["name"], words["kind"], words["summary"], _from(words["source"], **given))


def _row_from_csv(path: Path, data: bytes) -> SensorRow:
    columns, where = parse_document("CSV", data, path), escape_control(str(path))
    wanted = next((names for names in (ANGLES, VECTORS) if set(names) <= set(columns)), None)
    if wanted is None:
        found = ", ".join(columns)
        raise OptionError(f"{where} must have the columns azimuth,elevation or x,y,z[,ring]; found: {found:.200}.")
    table = np.array([_COLUMNS[name].read(f"{name} in {where}", columns[name]) for name in wanted])
    if wanted is ANGLES:
        azimuth, elevation = np.radians(table)
        flat = np.cos(elevation)
        table = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
    rings = [word or 0 for word in columns.get("ring", [0] * table.shape[1])]
    return SensorRow(path.stem, "list", f"from {path.name}", _from(path.name, directions=table.T, rings=rings))


def _from(source: str, **numbers: Any) -> dict[str, tuple[Any, str]]:
    """Return numbers that share one source."""
    return {name: (value, source) for name, value in numbers.items()}


Lasers = tuple[tuple[float, float], ...]
"""Elevation and azimuth offset of each laser, degrees, the lowest first.

Velodyne's are from the calibration files of ros-drivers/velodyne, the HDL-64E's from KITTI. A real scan confirms those
of the VLP-32C within 0.04 degrees."""

VLP_16: Lasers = tuple((float(elevation), 0.0) for elevation in range(-15, 16, 2))
HDL_32E: Lasers = tuple((round((4 * i - 92) / 3, 2), 0.0) for i in range(32))
VLP_32C: Lasers = (
    (-25, -1.4), (-15.639, 1.4), (-11.31, -1.4), (-8.843, 1.4), (-7.254, -1.4), (-6.148, 1.4), (-5.333, -4.2),
    (-4.667, -1.4), (-4, 1.4), (-3.667, 4.2), (-3.333, -4.2), (-3, -1.4), (-2.667, 1.4), (-2.333, 4.2), (-2, -4.2),
    (-1.667, -1.4), (-1.333, 1.4), (-1, 4.2), (-0.667, -4.2), (-0.333, -1.4), (0, 1.4), (0.333, 4.2), (0.667, -4.2),
    (1, -1.4), (1.333, 1.4), (1.667, 4.2), (2.333, -1.4), (3.333, 1.4), (4.667, -1.4), (7, 1.4), (10.333, -1.4),
    (15, 1.4),
)  # fmt: skip

HDL_64E: Lasers = (
    (-24.999, -2.372), (-24.507, 1.152), (-23.971, 4.56), (-23.322, 8.141), (-22.857, -7.997), (-22.438, -4.552),
    (-21.936, -1.14), (-21.318, 2.409), (-20.788, 5.779), (-20.223, 9.196), (-19.736, -9.164), (-19.32, -5.681),
    (-18.797, -2.378), (-18.323, 1.109), (-17.73, 4.367), (-17.187, 7.862), (-16.554, -7.857), (-16.177, -4.422),
    (-15.657, -1.144), (-15.189, 2.272), (-14.598, 5.549), (-14.048, 8.938), (-13.485, -8.992), (-13.041, -5.56),
    (-12.562, -2.359), (-12.115, 1.028), (-11.599, 4.355), (-10.957, 7.605), (-10.471, -7.704), (-10.062, -4.347),
    (-9.574, -1.089), (-9.026, 2.149), (-8.711, -1.579), (-8.31, 0.681), (-8.058, 2.708), (-7.679, 4.955),
    (-7.287, -5.07), (-6.999, -2.961), (-6.676, -0.797), (-6.329, 1.459), (-5.958, 3.466), (-5.611, 5.711),
    (-5.251, -5.848), (-4.914, -3.596), (-4.588, -1.596), (-4.216, 0.665), (-3.936, 2.658), (-3.539, 4.9),
    (-3.236, -5.082), (-2.874, -2.841), (-2.547, -0.851), (-2.208, 1.455), (-1.833, 3.417), (-1.494, 5.66),
    (-1.201, -5.86), (-0.803, -3.605), (-0.452, -1.629), (-0.089, 0.623), (0.181, 2.712), (0.579, 4.963),
    (0.872, -5.08), (1.305, -2.852), (1.574, -0.872), (1.937, 1.406),
)  # fmt: skip

_HDL_64E_BLOCKS = ((0.13415, 0.06214),) * 32 + ((0.20657, 0.0719),) * 32
"""Height of each laser at elevation 0, metres, and its growth per tangent of the elevation; one pair per block."""
HDL_64E_OFFSETS = tuple(
    (float(round(up + growth * np.tan(np.radians(elevation)), 5)), -0.026 if i % 2 else 0.026)
    for i, ((up, growth), (elevation, _)) in enumerate(zip(_HDL_64E_BLOCKS, HDL_64E, strict=True))
)

_VLS_128_ELEVATIONS = (
    *(-25, -19.582, -16.042, -13.565, -11.742, -10.346, -9.244, -8.352, -7.65, -7.15, -6.85, -6.65),
    *(round(-6.5 + 0.11 * i, 2) for i in range(104)),
    *(4.98, 5.18, 5.43, 5.73, 6.08, 6.48, 6.98, 7.58, 8.43, 9.7, 11.75, 15),
)
_VLS_128_AZIMUTHS = (0.911, 2.732, 4.548, 6.354, -6.354, -4.548, -2.732, -0.911)
VLS_128: Lasers = tuple(zip(_VLS_128_ELEVATIONS, _VLS_128_AZIMUTHS * 16, strict=True))

_CALIBRATION = "calibration file of ros-drivers/velodyne"
_KITTI = "KITTI's calibration file of its unit (velodynecalib_S2_factory)"
_SHEET = "maker's data sheet"
_MANUAL = "maker's manual"
_SHEETS_3_CM = f"+-3 cm, {_SHEET}, taken as one standard deviation"
_NGUYEN = "Nguyen, Izadi, Lovell 2012"
_HELIOS = "HELIOS++'s table of scanners"
_ONE_ECHO = "VLP-16's manual: two returns are told apart from 1 m on; taken for all"
_ASSUMED = "assumed"
_FITTED = (
    "metres, fitted once to the cars and pedestrians from 10 to 60 m of one Argoverse 2 log, two VLP-32C; assumed of "
    "others (benchmarks/real_lidar.py holds it to other logs)"
)
_ON_FIVE = "chosen on five of these scans (benchmarks/line_laser.py)"
_OS1_RAYS: Lasers = tuple((-16.6 + 33.2 * i / 63, 0.0) for i in range(64))

_LIDAR = {"echo_separation": (1.0, _ONE_ECHO), "detection_range": (130.0, _FITTED)}
_VELODYNE = {
    "range_min": (0.9, _ASSUMED + ", as HDL-64E"),
    "step": (0.002, _MANUAL),
    "divergence": (0.003, _ASSUMED + ", as VLP-16"),
    **_LIDAR,
}
_CAMERA = {"axial": (True, "a camera measures depth")}
_DEPTH_CAMERA = {**_CAMERA, **_from(_ASSUMED, edge_loss=0.5, incidence_max=85.0)}

ROWS: tuple[SensorRow, ...] = (
    SensorRow(
        "vlp-16",
        "spinning",
        "Velodyne Puck, 16 lasers",
        {
            **_VELODYNE,
            "lasers": (VLP_16, f"{_CALIBRATION} (VLP16db)"),
            "columns": (1800, f"0.2 degrees at 10 turns a second, {_SHEET}"),
            "range_max": (100.0, _SHEET),
            "sigma": (0.03, _SHEETS_3_CM),
            "divergence": (0.003, f"3 mrad, {_SHEET}; HELIOS++ has 0.7 mrad"),
        },
    ),
    SensorRow(
        "hdl-32e",
        "spinning",
        "Velodyne HDL-32E, 32 lasers from -30.67 to 10.67 degrees",
        {
            **_VELODYNE,
            "lasers": (HDL_32E, f"{_CALIBRATION} (32db)"),
            "columns": (2180, "0.165 degrees: 1.39 million points per second at 20 turns of two returns, " + _SHEET),
            "range_max": (100.0, _SHEET),
            "sigma": (0.0067, "a published model of a vehicle simulator"),
        },
    ),
    SensorRow(
        "vlp-32c",
        "spinning",
        "Velodyne Ultra Puck, 32 lasers, denser in the middle",
        {
            **_VELODYNE,
            "lasers": (
                VLP_32C,
                f"{_CALIBRATION} (VeloView-VLP-32C); manual pages 66-67; a real scan within 0.04 degrees",
            ),
            "columns": (1800, f"0.2 degrees at 10 turns a second, {_MANUAL}"),
            "range_max": (200.0, _SHEET),
            "sigma": (0.03, _SHEETS_3_CM),
            "step": (0.004, _MANUAL),
        },
    ),
    SensorRow(
        "hdl-64e",
        "spinning",
        "Velodyne HDL-64E S2, 64 lasers, KITTI's",
        {
            **_VELODYNE,
            "lasers": (HDL_64E, f"{_KITTI}; real returns lie on their rays within 0.01 degrees (median)"),
            "offsets": (HDL_64E_OFFSETS, f"metres up and left, {_KITTI}"),
            "columns": (2083, f"0.1728 degrees at 10 turns a second, {_MANUAL}"),
            **_from(_HELIOS, range_min=0.9, range_max=120.0),
            "sigma": (0.02, f"{_SHEET}; BlenSor"),
            "divergence": (0.002, _HELIOS),
            "detection_range": (130.0, "metres, as VLP-32C; cars of four KITTI sweeps are fitted best by 120 to 130"),
        },
    ),
    SensorRow(
        "vls-128",
        "spinning",
        "Velodyne Alpha Prime, 128 lasers",
        {
            **_VELODYNE,
            "lasers": (VLS_128, f"{_CALIBRATION} (VLS128)"),
            "columns": (1800, f"0.2 degrees at 10 turns a second, {_SHEET}"),
            "range_max": (245.0, _SHEET),
            "sigma": (0.03, _SHEETS_3_CM),
            "step": (0.004, _MANUAL),
        },
    ),
    SensorRow(
        "os1-64",
        "spinning",
        "Ouster OS1-64, 64 beams between +-16.6 degrees",
        {
            "lasers": (_OS1_RAYS, f"+-16.6 degrees, {_SHEET}; evenly spaced and without azimuth offsets: assumed"),
            "columns": (1024, f"512, 1024 or 2048, {_SHEET}"),
            **_from(_SHEET, range_min=0.8, range_max=120.0),
            "sigma": (
                ((26.3, 0.015), (41.6, 0.03), (120.0, 0.10)),
                f"1.5, 3, 10 cm at signal to noise 250, 100, 12, {_SHEET}; 12 taken to be reached at 120 m, the rest "
                "by the square of the range: assumed",
            ),
            "step": (0.012, _SHEET),
            "divergence": (0.00227, f"0.13 degrees, {_SHEET}"),
            **_LIDAR,
        },
    ),
    SensorRow(
        "mid-40",
        "risley",
        "Livox Mid-40: one beam through two turning prisms, a rosette that never repeats",
        {
            "frequencies": ((-77.733, 121.567), f"turns a second, {_HELIOS}"),
            "wedge": (18.0, f"degrees, {_HELIOS}"),
            "index": (1.5095, _HELIOS),
            "rate": (100_000.0, _SHEET),
            "seconds": (0.1, _ASSUMED + ": ten scans a second"),
            **_from(_SHEET, range_min=1.0, range_max=260.0),
            "sigma": (0.02, f"2 cm, {_SHEET}"),
            "divergence": (0.0027, _HELIOS),
            **_LIDAR,
        },
    ),
    SensorRow(
        "kinect-v1",
        "pinhole",
        "Microsoft Kinect for Xbox 360: structured light",
        {
            **_from(_NGUYEN, width=640, height=480),
            "f": (575.0, f"pixels; {_NGUYEN}"),
            **_from(_SHEET, range_min=0.8, range_max=4.0),
            "sigma": (0.0012, f"{_NGUYEN}: .0012 + .0019 (z - .4)^2"),
            **_from("the same formula", sigma_growth=0.0019, sigma_from=0.4),
            "sigma_grazing": (0.0001, "the same paper, from 60 degrees of incidence on"),
            "lateral": ((0.8, 0.035), "the same paper: .8 + .035 theta / (pi/2 - theta) pixels"),
            "disparity_step": (0.0029, "1/8 pixel of disparity, f 575, baseline 75 mm: assumed"),
            "baseline": ((0.0, -0.075, 0.0), "its projector, 75 mm to the right; its picture as large: assumed"),
            **_DEPTH_CAMERA,
        },
    ),
    SensorRow(
        "azure-kinect-nfov",
        "pinhole",
        "Microsoft Azure Kinect, narrow field of view, unbinned: time of flight",
        {
            **_from(_SHEET, width=640, height=576),
            "fov": (75.0, f"75 x 65 degrees, {_SHEET}"),
            **_from(_SHEET, range_min=0.5, range_max=3.86),
            "sigma": (0.017, f"at most 17 mm, {_SHEET}; PMC7827245. Its bias, below 11 mm, is left out"),
            "step": (0.001, "millimetres in its pictures"),
            **_DEPTH_CAMERA,
        },
    ),
    SensorRow(
        "realsense-d435",
        "pinhole",
        "Intel RealSense D435: stereo",
        {
            **_from(_SHEET, width=848, height=480),
            "fov": (90.0, "degrees, Intel's, as in rotors_gazebo"),
            "range_min": (
                round(424.0 * 0.05 / 126, 3),
                "f B / 126 (0.17 m at 848 x 480), the pixels that its matcher searches: Grunnet-Jepsen, Sweetser, "
                "Woodfill (Intel), Tuning depth cameras for best performance",
            ),
            "range_max": (10.0, _SHEET),
            "sigma_growth": (
                0.1 / (424.0 * 0.05),
                "z^2 s / (f B): s .1 pixel, f 424 pixels, B 50 mm, as in rotors_gazebo",
            ),
            "step": (0.001, "millimetres in its pictures"),
            "baseline": ((0.0, -0.05, 0.0), f"its right camera; depths are the left one's, {_SHEET}"),
            "match_window": (9, "census of 9 x 9 pixels, the maker's presets (librealsense, d400_presets)"),
            **_DEPTH_CAMERA,
        },
    ),
    SensorRow(
        "cyberware-3030",
        "linear",
        "Cyberware 3030MS: a laser line on a linear stage, its camera behind two mirrors",
        {
            "columns": (512, "num_cols of ten scans of the Stanford bunny"),
            "spacing": (0.0005, "echo_lgincr of the same files"),
            "rows": (400, "num_rows of the same files"),
            "slopes": ((-0.1283, 0.0967), "measured from the points of these scans, row by row, within 0.0007"),
            "baseline": (
                ((0.0, 0.722, 0.22), (0.0, -0.722, 0.22)),
                f"30 degrees to either side and 10 above, 1.25 m away: {_ON_FIVE}",
            ),
            **_from(f"degrees, {_ON_FIVE}", incidence_max=82.0, baseline_incidence_max=80.0),
            "sigma": (0.00012, "spread of these scans about the mesh that was merged from them"),
        },
    ),
    SensorRow(
        "pcn",
        "pinhole",
        "the camera of PCN's partial clouds, without noise; 1 from the object's centre there",
        {**_from("wentaoyuan/pcn", width=160, height=120, f=100.0), **_CAMERA},
    ),
    SensorRow(
        "modelnet40-c",
        "pinhole",
        "the camera of ModelNet40-C's occlusion, without noise; 3 from the centre there",
        {**_from("jiachens/ModelNet40-C", width=1080, height=720, f=365.0), **_CAMERA},
    ),
    SensorRow(
        "modelnet40-c-lidar",
        "spinning",
        "ModelNet40-C's lidar as a sensor: bands 1 degree apart, without noise; 5 from the centre there",
        {
            "lasers": (
                tuple((float(e), 0.0) for e in range(-45, 46)),
                "1 degree bands, jiachens/ModelNet40-C; their extent assumed",
            ),
            "columns": (2000, _ASSUMED + "; 768 points are drawn of each cloud there"),
        },
    ),
    SensorRow(
        "pinhole",
        "pinhole",
        "a camera without fault: pinhole:width=640,height=480,fov=60",
        {**_from(_ASSUMED, width=640, height=480, fov=60.0), **_CAMERA},
    ),
)

SENSORS: dict[str, Sensor] = {row.name: row.sensor() for row in ROWS}
"""The sensors of the table, by name."""
