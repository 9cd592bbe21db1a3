"""Catalogue of sensors, every number with its source; and sensors from files.

A new sensor is a row of `ROWS`, a YAML file of numbers, or a CSV file of directions.
"""

import reprlib
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from zbuf_occlude.base.documents import Number, parse_document, parse_line, read_limited
from zbuf_occlude.base.errors import ArgumentError, OccludeError, OptionError, check_choice, escape_control
from zbuf_occlude.sensors import lasers
from zbuf_occlude.sensors.rays import MAX_RAYS, PATTERNS, numbers_of
from zbuf_occlude.sensors.sensor import NoiseModel, Sensor

SUFFIXES = (".yaml", ".yml", ".csv")
ANGLES, VECTORS = ("azimuth", "elevation"), ("x", "y", "z")
ELEVATION = Number(-90.0, 90.0, "degrees")
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
        all numbers); ``elevations: {from: -25, to: 15, n: 128}`` are evenly spaced lasers. Or a CSV file with the
        columns azimuth and elevation (degrees) or x, y and z, optionally ring.

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
    if words["kind"] == "spinning" and "elevations" in given:
        if "lasers" in given:
            raise OptionError(f"{where} must have lasers or elevations, not both.")
        given["lasers"] = _evenly_spaced(given.pop("elevations"), f"elevations in {where}")
    for name in given:
        check_choice(f"a number in {where}", name, known)
    return SensorRow(words["name"], words["kind"], words["summary"], _from(words["source"], **given))


def _evenly_spaced(given: Any, name: str) -> lasers.Lasers:
    """Return the lasers of a mapping ``{from: -25, to: 15, n: 128}``."""
    if not isinstance(given, dict) or set(given) != {"from", "to", "n"}:
        raise OptionError(f"{name} must be {{from: DEGREES, to: DEGREES, n: LASERS}}; got {reprlib.repr(given)}.")
    low, high = sorted(ELEVATION.read(f"{key} of {name}", given[key]) for key in ("from", "to"))
    return lasers.evenly_spaced(low, high, Number(1, MAX_RAYS, whole=True).read(f"n of {name}", given["n"]))


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
    "others (`zbuf-occlude compare-drives` holds it to other logs)"
)
_ON_FIVE = "chosen on five of these scans (benchmarks/line_laser.py)"

_EVENLY_SPACED = "evenly spaced and without azimuth offsets: assumed"
_NEBULA = "calibration file of tier4/nebula"
_SHOTS = "fitted to the table of shots of Livox's own simulator"
_EVEN_SHOTS = "its paths approximated by shots spread evenly over the field of view"
_UNCHECKED = "not checked against the document"
_RANGES_80 = f"metres, of 80 % reflectivity, {_SHEET}"

_LIDAR = {"echo_separation": (1.0, _ONE_ECHO), "detection_range": (130.0, _FITTED)}
_VELODYNE = {
    "range_min": (0.9, _ASSUMED + ", as HDL-64E"),
    "step": (0.002, _MANUAL),
    "divergence": (0.003, _ASSUMED + ", as VLP-16"),
    **_LIDAR,
}
_HESAI = {"step": (0.004, f"distances are multiples of 4 mm, {_MANUAL}"), "divergence": (0.003, _ASSUMED), **_LIDAR}
_OUSTER = {"columns": (1024, f"512, 1024 or 2048, {_SHEET}"), **_LIDAR}
_OS1_SIGMA = {
    "sigma": (
        ((26.3, 0.015), (41.6, 0.03), (120.0, 0.10)),
        f"1.5, 3, 10 cm at signal to noise 250, 100, 12, {_SHEET}; 12 taken to be reached at 120 m, the rest by the "
        "square of the range: assumed",
    )
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
            "lasers": (lasers.VLP_16, f"{_CALIBRATION} (VLP16db)"),
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
            "lasers": (lasers.HDL_32E, f"{_CALIBRATION} (32db)"),
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
                lasers.VLP_32C,
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
            "lasers": (lasers.HDL_64E, f"{_KITTI}; real returns lie on their rays within 0.01 degrees (median)"),
            "offsets": (lasers.HDL_64E_OFFSETS, f"metres up and left, {_KITTI}"),
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
            "lasers": (lasers.VLS_128, f"{_CALIBRATION} (VLS128)"),
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
            "lasers": (lasers.evenly_spaced(-16.6, 16.6, 64), f"+-16.6 degrees, {_SHEET}; {_EVENLY_SPACED}"),
            **_OUSTER,
            **_from(_SHEET, range_min=0.8, range_max=120.0),
            **_OS1_SIGMA,
            "step": (0.012, _SHEET),
            "divergence": (0.00227, f"0.13 degrees, {_SHEET}"),
        },
    ),
    SensorRow(
        "os0-128",
        "spinning",
        "Ouster OS0-128, 128 beams between +-45 degrees",
        {
            **_OUSTER,
            "lasers": (lasers.evenly_spaced(-45.0, 45.0, 128), f"+-45 degrees, {_SHEET}; {_EVENLY_SPACED}"),
            "range_min": (0.3, f"{_SHEET}, {_UNCHECKED}"),
            "range_max": (50.0, f"{_RANGES_80}, {_UNCHECKED}"),
            "sigma": (
                ((10.0, 0.015), (50.0, 0.05)),
                f"1.5 to 5 cm, {_SHEET}, {_UNCHECKED}; the ranges of both: assumed",
            ),
            "step": (0.003, f"{_SHEET}, {_UNCHECKED}"),
            "divergence": (0.0061, f"0.35 degrees, {_SHEET}"),
        },
    ),
    SensorRow(
        "os1-128",
        "spinning",
        "Ouster OS1-128, 128 beams between +-22.5 degrees",
        {
            **_OUSTER,
            "lasers": (lasers.evenly_spaced(-22.5, 22.5, 128), f"+-22.5 degrees, {_SHEET}; {_EVENLY_SPACED}"),
            "range_min": (0.8, _SHEET),
            "range_max": (120.0, _RANGES_80),
            **_OS1_SIGMA,
            "step": (0.012, _SHEET),
            "divergence": (0.0031, f"0.18 degrees, {_SHEET}"),
        },
    ),
    SensorRow(
        "os2-128",
        "spinning",
        "Ouster OS2-128, 128 beams between +-11.25 degrees",
        {
            **_OUSTER,
            "lasers": (lasers.evenly_spaced(-11.25, 11.25, 128), f"+-11.25 degrees, {_SHEET}; {_EVENLY_SPACED}"),
            "range_min": (1.0, f"{_SHEET}, {_UNCHECKED}"),
            "range_max": (240.0, _RANGES_80),
            "sigma": (
                ((50.0, 0.025), (240.0, 0.08)),
                f"2.5 to 8 cm, {_SHEET}, {_UNCHECKED}; the ranges of both: assumed",
            ),
            "step": (0.003, f"{_SHEET}, {_UNCHECKED}"),
            "divergence": (0.0016, f"0.09 degrees, {_SHEET}, {_UNCHECKED}"),
        },
    ),
    SensorRow(
        "xt32",
        "spinning",
        "Hesai PandarXT-32, 32 lasers from -16 to 15 degrees",
        {
            **_HESAI,
            "lasers": (lasers.evenly_spaced(-16.0, 15.0, 32), f"{_MANUAL}; a unit's {_NEBULA} is within 0.09 degrees"),
            "columns": (2000, f"0.18 degrees at 10 turns a second, {_MANUAL}"),
            **_from(f"{_MANUAL}, {_UNCHECKED}", range_min=0.05, range_max=120.0),
            "sigma": (0.005, f"precision, {_MANUAL}, {_UNCHECKED}"),
        },
    ),
    SensorRow(
        "pandar128",
        "spinning",
        "Hesai Pandar128, 128 lasers from -25 to 15 degrees, densest near the horizon",
        {
            **_HESAI,
            "lasers": (lasers.PANDAR_128, f"{_NEBULA} (Pandar128E4X)"),
            "columns": (1800, f"0.2 degrees at 10 turns a second, {_MANUAL}"),
            **_from(f"{_MANUAL}, {_UNCHECKED}", range_min=0.3, range_max=200.0),
            "sigma": (0.02, f"+-2 cm, {_MANUAL}, {_UNCHECKED}; taken as one standard deviation"),
        },
    ),
    SensorRow(
        "at128",
        "spinning",
        "Hesai AT128, 128 lasers, 120 x 25.4 degrees, forward",
        {
            **_HESAI,
            "lasers": (lasers.AT_128, f"{_NEBULA} (PandarAT128); 25.4 degrees, {_SHEET}"),
            "columns": (1200, f"0.1 degrees, {_SHEET}: 1.536 million points a second"),
            "azimuths": ((-60.0, 60.0), f"120 degrees, {_SHEET}"),
            "range_min": (0.5, _ASSUMED),
            "range_max": (200.0, f"of 10 % reflectivity, {_SHEET}"),
            "sigma": (0.05, f"+-5 cm, {_SHEET}, {_UNCHECKED}; taken as one standard deviation"),
        },
    ),
    SensorRow(
        "m1",
        "spinning",
        "RoboSense RS-LiDAR-M1, 120 x 25 degrees, forward: rows of a MEMS mirror taken as lasers",
        {
            "lasers": (lasers.evenly_spaced(-12.4, 12.4, 125), f"+-12.5 degrees, 0.2 on average, {_MANUAL}"),
            "columns": (600, f"0.2 degrees on average, 750,000 points a second at 10 frames, {_MANUAL}"),
            "azimuths": (
                (-60.0, 60.0),
                f"120 degrees, {_MANUAL}; the mirror's path is not published: assumed straight",
            ),
            **_from(_MANUAL, range_min=0.5, range_max=200.0),
            "sigma": (0.05, f"5 cm at one sigma, {_MANUAL}"),
            "step": (0.005, f"5 mm, {_MANUAL}"),
            "divergence": (0.003, _ASSUMED),
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
        "mid-360",
        "non_repetitive",
        "Livox Mid-360: all around, from -7 to 52 degrees; its pattern approximated",
        {
            "azimuths": ((-180.0, 180.0), f"360 degrees, {_SHEET}; {_EVEN_SHOTS}"),
            "elevations": ((-7.0, 52.0), f"-7 to 52 degrees, {_SHEET}"),
            "rate": (200_000.0, _SHEET),
            "seconds": (0.1, f"ten frames a second, {_SHEET}"),
            "range_min": (0.1, _SHEET),
            "range_max": (70.0, _RANGES_80),
            "sigma": (0.02, f"at most 2 cm at 10 m, {_SHEET}"),
            "divergence": (0.0027, _ASSUMED + ", as Mid-40"),
            **_LIDAR,
        },
    ),
    SensorRow(
        "avia",
        "risley",
        "Livox Avia: six beams through two turning prisms, 70.4 x 77.2 degrees, forward; a rosette that never repeats",
        {
            "frequencies": ((-40.8, 131.55), f"turns a second, {_SHOTS}"),
            "wedge": (29.65, f"degrees: the field of view of 70.4 degrees, {_SHEET}"),
            "index": (1.5095, _ASSUMED + ", as Mid-40"),
            "fan": ((-2.2, -1.32, -0.44, 0.44, 1.32, 2.2), f"degrees, {_SHOTS}"),
            "rate": (240_000.0, _SHEET),
            "seconds": (0.1, _ASSUMED + ": ten scans a second"),
            "range_min": (1.0, _SHEET),
            "range_max": (450.0, f"{_RANGES_80} without sunlight"),
            "sigma": (0.02, f"2 cm at 20 m, {_SHEET}"),
            "divergence": (0.0027, _ASSUMED + ", as Mid-40"),
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
        "realsense-d455",
        "pinhole",
        "Intel RealSense D455: stereo",
        {
            **_from(_SHEET, width=848, height=480),
            "fov": (87.0, f"87 x 58 degrees, {_SHEET}"),
            "range_min": (round(446.8 * 0.095 / 126, 3), "f B / 126, as of the D435; 0.35 m at 848 x 480, " + _SHEET),
            "range_max": (6.0, f"0.6 to 6 m are recommended, {_SHEET}"),
            "sigma_growth": (
                0.1 / (446.8 * 0.095),
                "z^2 s / (f B), as of the D435: s .1 pixel, f 446.8 pixels, B 95 mm",
            ),
            "step": (0.001, "millimetres in its pictures"),
            "baseline": ((0.0, -0.095, 0.0), f"its right camera, 95 mm away, {_SHEET}"),
            "match_window": (9, "as of the D435"),
            **_DEPTH_CAMERA,
        },
    ),
    SensorRow(
        "realsense-l515",
        "pinhole",
        "Intel RealSense L515: a laser and a MEMS mirror, time of flight; indoors",
        {
            **_from(_SHEET, width=1024, height=768),
            "fov": (70.0, f"70 x 55 degrees, {_SHEET}, {_UNCHECKED}"),
            **_from(_SHEET, range_min=0.25, range_max=9.0),
            "sigma": (((1.0, 0.0025), (9.0, 0.0155)), f"2.5 mm at 1 m, 15.5 mm at 9 m, {_SHEET}, {_UNCHECKED}"),
            "step": (0.00025, "depth unit of its pictures, librealsense"),
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
