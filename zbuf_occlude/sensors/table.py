"""The table of sensors: one literal row each, every number with its source. A new sensor is one row here."""

from typing import Any, NamedTuple

from zbuf_occlude.sensors.lasers import HDL_32E, HDL_64E, VLP_16, VLP_32C, VLS_128, Lasers
from zbuf_occlude.sensors.model import Imperfections, Sensor
from zbuf_occlude.sensors.rays import numbers_of


class Row(NamedTuple):
    """A sensor as data: its numbers, each with where it is from."""

    name: str
    kind: str
    summary: str
    numbers: dict[str, tuple[Any, str]]

    def sensor(self) -> Sensor:
        """Return the sensor."""
        values = {name: value for name, (value, _) in self.numbers.items()}
        pattern = {name: value for name, value in values.items() if name in numbers_of(self.kind)}
        faults = Imperfections(**{name: value for name, value in values.items() if name not in pattern})
        sources = {name: source for name, (_, source) in self.numbers.items()}
        return Sensor(self.name, self.kind, pattern, faults, self.summary, sources)


_CALIBRATION = "calibration file of ros-drivers/velodyne"
_SHEET = "maker's data sheet"
_MANUAL = "maker's manual"
_HELIOS = "HELIOS++'s table of scanners"
_ONE_ECHO = "VLP-16's manual: two returns are told apart from 1 m on; taken for all"
_ASSUMED = "assumed"
_FITTED = (
    "metres, fitted to the vehicles and pedestrians from 10 to 60 m of one Argoverse 2 log "
    "(benchmarks/against_real_scans.py), two VLP-32C; assumed of others"
)
_OS1_RAYS: Lasers = tuple((-16.6 + 33.2 * i / 63, 0.0) for i in range(64))

_DROPOUT = {"reach": (130.0, _FITTED)}

ROWS: tuple[Row, ...] = (
    Row(
        "vlp-16",
        "spinning",
        "Velodyne Puck, 16 lasers",
        {
            "lasers": (VLP_16, f"{_CALIBRATION} (VLP16db)"),
            "columns": (1800, f"0.2 degrees at 10 turns a second, {_SHEET}"),
            "range_min": (0.9, _ASSUMED + ", as HDL-64E"),
            "range_max": (100.0, _SHEET),
            "sigma": (0.03, f"+-3 cm, {_SHEET}, taken as one standard deviation"),
            "step": (0.002, _MANUAL),
            "divergence": (0.003, f"3 mrad, {_SHEET}; HELIOS++ has 0.7 mrad"),
            "echo_separation": (1.0, _ONE_ECHO),
            **_DROPOUT,
        },
    ),
    Row(
        "hdl-32e",
        "spinning",
        "Velodyne HDL-32E, 32 lasers from -30.67 to 10.67 degrees",
        {
            "lasers": (HDL_32E, f"{_CALIBRATION} (32db)"),
            "columns": (2180, "0.165 degrees: 1.39 million points per second at 20 turns of two returns, " + _SHEET),
            "range_min": (0.9, _ASSUMED + ", as HDL-64E"),
            "range_max": (100.0, _SHEET),
            "sigma": (0.0067, "a published model of a vehicle simulator"),
            "step": (0.002, _MANUAL),
            "divergence": (0.003, _ASSUMED + ", as VLP-16"),
            "echo_separation": (1.0, _ONE_ECHO),
            **_DROPOUT,
        },
    ),
    Row(
        "vlp-32c",
        "spinning",
        "Velodyne Ultra Puck, 32 lasers, denser in the middle",
        {
            "lasers": (
                VLP_32C,
                f"{_CALIBRATION} (VeloView-VLP-32C); manual pages 66-67; a real scan within 0.04 degrees",
            ),
            "columns": (1800, f"0.2 degrees at 10 turns a second, {_MANUAL}"),
            "range_min": (0.9, _ASSUMED + ", as HDL-64E"),
            "range_max": (200.0, _SHEET),
            "sigma": (0.03, f"+-3 cm, {_SHEET}, taken as one standard deviation"),
            "step": (0.004, _MANUAL),
            "divergence": (0.003, _ASSUMED + ", as VLP-16"),
            "echo_separation": (1.0, _ONE_ECHO),
            **_DROPOUT,
        },
    ),
    Row(
        "hdl-64e",
        "spinning",
        "Velodyne HDL-64E S2, 64 lasers, KITTI's",
        {
            "lasers": (HDL_64E, f"{_CALIBRATION} (64e_utexas)"),
            "columns": (2083, f"0.1728 degrees at 10 turns a second, {_MANUAL}"),
            "range_min": (0.9, _HELIOS),
            "range_max": (120.0, _HELIOS),
            "sigma": (0.02, f"{_SHEET}; BlenSor"),
            "step": (0.002, _MANUAL),
            "divergence": (0.002, _HELIOS),
            "echo_separation": (1.0, _ONE_ECHO),
            **_DROPOUT,
        },
    ),
    Row(
        "vls-128",
        "spinning",
        "Velodyne Alpha Prime, 128 lasers",
        {
            "lasers": (VLS_128, f"{_CALIBRATION} (VLS128)"),
            "columns": (1800, f"0.2 degrees at 10 turns a second, {_SHEET}"),
            "range_min": (0.9, _ASSUMED + ", as HDL-64E"),
            "range_max": (245.0, _SHEET),
            "sigma": (0.03, f"+-3 cm, {_SHEET}, taken as one standard deviation"),
            "step": (0.004, _MANUAL),
            "divergence": (0.003, _ASSUMED + ", as VLP-16"),
            "echo_separation": (1.0, _ONE_ECHO),
            **_DROPOUT,
        },
    ),
    Row(
        "os1-64",
        "spinning",
        "Ouster OS1-64, 64 beams between +-16.6 degrees",
        {
            "lasers": (_OS1_RAYS, f"+-16.6 degrees, {_SHEET}; evenly spaced and without azimuth offsets: assumed"),
            "columns": (1024, f"512, 1024 or 2048, {_SHEET}"),
            "range_min": (0.8, _SHEET),
            "range_max": (120.0, _SHEET),
            "sigma": (
                ((26.3, 0.015), (41.6, 0.03), (120.0, 0.10)),
                f"1.5, 3, 10 cm at signal to noise 250, 100, 12, {_SHEET}; 12 taken to be reached at 120 m, the rest "
                "by the square of the range: assumed",
            ),
            "step": (0.012, _SHEET),
            "divergence": (0.00227, f"0.13 degrees, {_SHEET}"),
            "echo_separation": (1.0, _ONE_ECHO),
            **_DROPOUT,
        },
    ),
    Row(
        "mid-40",
        "risley",
        "Livox Mid-40: one beam through two turning prisms, a rosette that never repeats",
        {
            "frequencies": ((-77.733, 121.567), f"turns a second, {_HELIOS}"),
            "wedge": (18.0, f"degrees, {_HELIOS}"),
            "index": (1.5095, _HELIOS),
            "rate": (100_000.0, _SHEET),
            "seconds": (0.1, _ASSUMED + ": ten scans a second"),
            "range_min": (1.0, _SHEET),
            "range_max": (260.0, _SHEET),
            "sigma": (0.02, f"2 cm, {_SHEET}"),
            "divergence": (0.0027, _HELIOS),
            "echo_separation": (1.0, _ONE_ECHO),
            **_DROPOUT,
        },
    ),
    Row(
        "kinect-v1",
        "pinhole",
        "Microsoft Kinect for Xbox 360: structured light",
        {
            "width": (640, "Nguyen, Izadi, Lovell 2012"),
            "height": (480, "Nguyen, Izadi, Lovell 2012"),
            "f": (575.0, "pixels; Nguyen, Izadi, Lovell 2012"),
            "axial": (True, "a camera measures depth"),
            "range_min": (0.8, _SHEET),
            "range_max": (4.0, _SHEET),
            "sigma": (0.0012, "Nguyen, Izadi, Lovell 2012: .0012 + .0019 (z - .4)^2"),
            "sigma_growth": (0.0019, "the same formula"),
            "sigma_from": (0.4, "the same formula"),
            "sigma_grazing": (0.0001, "the same paper, from 60 degrees of incidence on"),
            "lateral": ((0.8, 0.035), "the same paper: .8 + .035 theta / (pi/2 - theta) pixels"),
            "disparity_step": (0.0029, "1/8 pixel of disparity, f 575, baseline 75 mm: assumed"),
            "edge_loss": (0.5, _ASSUMED),
            "incidence_max": (85.0, _ASSUMED),
        },
    ),
    Row(
        "azure-kinect-nfov",
        "pinhole",
        "Microsoft Azure Kinect, narrow field of view, unbinned: time of flight",
        {
            "width": (640, _SHEET),
            "height": (576, _SHEET),
            "fov": (75.0, f"75 x 65 degrees, {_SHEET}"),
            "axial": (True, "a camera measures depth"),
            "range_min": (0.5, _SHEET),
            "range_max": (3.86, _SHEET),
            "sigma": (0.017, f"at most 17 mm, {_SHEET}; PMC7827245. Its bias, below 11 mm, is left out"),
            "step": (0.001, "millimetres in its pictures"),
            "edge_loss": (0.5, _ASSUMED),
            "incidence_max": (85.0, _ASSUMED),
        },
    ),
    Row(
        "realsense-d435",
        "pinhole",
        "Intel RealSense D435: stereo",
        {
            "width": (848, _SHEET),
            "height": (480, _SHEET),
            "fov": (90.0, "degrees, Intel's, as in rotors_gazebo"),
            "axial": (True, "a camera measures depth"),
            "range_min": (0.3, _SHEET),
            "range_max": (10.0, _SHEET),
            "sigma_growth": (
                0.1 / (424.0 * 0.05),
                "z^2 s / (f B): s .1 pixel, f 424 pixels, B 50 mm, as in rotors_gazebo",
            ),
            "step": (0.001, "millimetres in its pictures"),
            "edge_loss": (0.5, _ASSUMED),
            "incidence_max": (85.0, _ASSUMED),
        },
    ),
    Row(
        "pcn",
        "pinhole",
        "the camera of PCN's partial clouds, without noise; 1 from the object's centre there",
        {
            "width": (160, "wentaoyuan/pcn"),
            "height": (120, "wentaoyuan/pcn"),
            "f": (100.0, "wentaoyuan/pcn"),
            "axial": (True, "a camera measures depth"),
        },
    ),
    Row(
        "modelnet40-c",
        "pinhole",
        "the camera of ModelNet40-C's occlusion, without noise; 3 from the centre there",
        {
            "width": (1080, "jiachens/ModelNet40-C"),
            "height": (720, "jiachens/ModelNet40-C"),
            "f": (365.0, "jiachens/ModelNet40-C"),
            "axial": (True, "a camera measures depth"),
        },
    ),
    Row(
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
    Row(
        "pinhole",
        "pinhole",
        "a camera without fault: pinhole:width=640,height=480,fov=60",
        {
            "width": (640, _ASSUMED),
            "height": (480, _ASSUMED),
            "fov": (60.0, _ASSUMED),
            "axial": (True, "a camera measures depth"),
        },
    ),
)
