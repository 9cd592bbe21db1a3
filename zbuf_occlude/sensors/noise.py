"""Limits, losses and noise of a sensor, applied to the returns of a noiseless scan."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.base.arrays import FloatArray, unit_vectors
from zbuf_occlude.sensors.echoes import perpendiculars
from zbuf_occlude.sensors.returns import Scan
from zbuf_occlude.sensors.sensor import STEEPEST, NoiseModel, Sensor

EDGE = 0.05
"""Relative difference of the depths of neighbouring pixels that makes an edge."""
ROUGHNESS = 0.5
"""Standard deviation of the slope of a surface's facets, radians (Oren and Nayar 1994): assumed, as of plaster, cloth
or asphalt."""
ROUGH_BACKSCATTER = (0.45 * ROUGHNESS**2 / (ROUGHNESS**2 + 0.09)) / (1.0 - 0.5 * ROUGHNESS**2 / (ROUGHNESS**2 + 0.33))
"""Backscatter of such a surface at grazing incidence over that at right angles: B / A of Oren and Nayar."""


def apply_noise(scan: Scan, sensor: Sensor, rng: np.random.Generator) -> Scan:
    """Return a scan with the sensor's limits, losses and noise; with ``noise=0`` only the limits of range."""
    model = sensor.noise_model
    scan = clip_range(scan, model)
    if not model.noise:
        return scan
    scan = drop_edges(scan, model, rng)
    scan = apply_dropout(scan, model, rng)
    scan = apply_detection(scan, model, rng)
    scan = add_range_noise(scan, model, rng)
    scan = add_lateral_noise(scan, sensor, rng)
    return quantise(scan, model)


def measured_ranges(scan: Scan, model: NoiseModel) -> FloatArray:
    """Return the noiseless value that the sensor measures (n,): the range, or for an axial sensor the depth."""
    return scan.clean_ranges * scan.depths_per_range if model.axial else scan.clean_ranges


def clip_range(scan: Scan, model: NoiseModel) -> Scan:
    """Remove the returns outside `range_min` to `range_max`, and those steeper than `incidence_max`."""
    measured = measured_ranges(scan, model)
    kept = (measured >= model.range_min) & (measured <= model.range_max)
    if model.incidence_max < 90.0 and model.noise:
        kept &= scan.incidences <= np.radians(model.incidence_max)
    return scan if kept.all() else scan.select(kept)


def drop_edges(scan: Scan, model: NoiseModel, rng: np.random.Generator) -> Scan:
    """Remove the share `edge_loss` of the pixels at edges: beside a jump of the nearest depth, or beside no return."""
    if not model.edge_loss or not len(scan):
        return scan
    first = scan.columns.min() - 1, scan.rings.min() - 1
    shape = int(scan.rings.max() - first[1] + 2), int(scan.columns.max() - first[0] + 2)
    image = np.full(shape, np.inf)
    rows, columns = scan.rings - first[1], scan.columns - first[0]
    depths = scan.clean_ranges * scan.depths_per_range
    np.minimum.at(image, (rows, columns), depths)
    depths = image[rows, columns]
    edge = np.zeros(len(scan), dtype=bool)
    for down, right in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        edge |= np.abs(image[rows + down, columns + right] - depths) > EDGE * depths
    return scan.select(~edge | (rng.random(len(scan)) >= model.edge_loss))


def apply_dropout(scan: Scan, model: NoiseModel, rng: np.random.Generator) -> Scan:
    """Remove returns at random: the share `drop` of all, and weak signals as `drop_limit` and `drop_zero` say."""
    if not (model.drop or model.drop_zero):
        return scan
    lost = np.full(len(scan), model.drop)
    if model.drop_limit:
        signal = scan.intensities * scan.clean_ranges**2 * np.exp(-model.attenuation * scan.clean_ranges)
        weak = model.drop_zero * np.maximum(0.0, 1.0 - signal / model.drop_limit)
        lost = 1.0 - (1.0 - lost) * (1.0 - weak)
    return scan.select(rng.random(len(scan)) >= lost)


def apply_detection(scan: Scan, model: NoiseModel, rng: np.random.Generator) -> Scan:
    """Remove the returns that fade below what the sensor detects; see `detection_probability`."""
    if not model.detection_range:
        return scan
    cosines = np.cos(scan.incidences)
    # intensities are those of a Lambertian surface: albedo times cosine over the squared range
    albedos = scan.intensities * scan.clean_ranges**2 / np.maximum(cosines, 1e-9)
    detected = detection_probability(albedos, cosines, scan.clean_ranges, model.detection_range)
    return scan.select(rng.random(len(scan)) < detected)


def detection_probability(
    albedos: ArrayLike, cosines: ArrayLike, ranges: ArrayLike, detection_range: float
) -> FloatArray:
    """Return the probability that a return is detected: ``exp(-(range / detection_range)^2 / (albedo B(incidence)))``.

    The mean received power is ``P = albedo B / range^2``. It fades: the power of coherent light from a rough surface is
    distributed exponentially (speckle). The power exceeds the detection limit ``P0 = 1 / detection_range^2`` with
    probability ``exp(-P0 / P)``. ``B`` is the backscatter of a rough surface (Oren and Nayar 1994), 1 at right angles.
    With Lambert's cosine instead of ``B`` the ground would end at 30 m. Ranges are metres.
    """
    cosines = np.asarray(cosines, dtype=np.float64)
    backscatter = cosines + ROUGH_BACKSCATTER * (1.0 - cosines**2)
    signals = np.maximum(np.asarray(albedos) * backscatter, np.finfo(np.float64).tiny)
    with np.errstate(over="ignore"):  # black or very far surfaces have probability 0
        return np.asarray(np.exp(-((np.asarray(ranges) / detection_range) ** 2) / signals))


def add_range_noise(scan: Scan, model: NoiseModel, rng: np.random.Generator) -> Scan:
    """Add normal noise to the ranges, or for an axial sensor to the depths."""
    sigma = model.range_sigma(measured_ranges(scan, model), scan.incidences)
    if not sigma.any():
        return scan
    if model.axial:
        sigma = sigma / scan.depths_per_range
    return replace(scan, ranges=np.maximum(scan.ranges + sigma * rng.standard_normal(len(scan)), 1e-6))


def add_lateral_noise(scan: Scan, sensor: Sensor, rng: np.random.Generator) -> Scan:
    """Turn the rays by normal noise across them, `lateral` pixels."""
    model = sensor.noise_model
    offset, slope = (float(x) for x in np.broadcast_to(np.append(model.lateral, 0.0)[:2], 2))
    if not (offset or slope) or not sensor.pixels:
        return scan
    angle = np.minimum(scan.incidences, STEEPEST)
    sigma = (offset + slope * angle / (np.pi / 2 - angle)) * model.noise / sensor.pixels
    across, upwards = perpendiculars(scan.directions)
    shift = rng.standard_normal((len(scan), 1)) * across + rng.standard_normal((len(scan), 1)) * upwards
    return replace(scan, directions=unit_vectors(scan.directions + sigma[:, None] * shift))


def quantise(scan: Scan, model: NoiseModel) -> Scan:
    """Round ranges (depths of an axial sensor) to multiples of `step`, inverse ones to those of `disparity_step`."""
    if not (model.step or model.disparity_step):
        return scan
    per_range = scan.depths_per_range if model.axial else np.ones(len(scan))
    measured = scan.ranges * per_range
    if model.disparity_step:
        disparities = np.maximum(np.round(1.0 / (measured * model.disparity_step)), 1.0)
        measured = 1.0 / (disparities * model.disparity_step)
    if model.step:
        measured = np.round(measured / model.step) * model.step
    return replace(scan, ranges=np.maximum(measured / per_range, 1e-6))
