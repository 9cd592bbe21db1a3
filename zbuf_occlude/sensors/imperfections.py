"""What sensors get wrong, one small function each: scan in, scan out. All draws come from the generator passed in."""

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.sensors.model import STEEPEST, Imperfections, Sensor
from zbuf_occlude.sensors.record import Scan

EDGE = 0.05
"""Neighbouring pixels whose depths differ by more than this share lie on an edge."""
ROUGHNESS = 0.5
"""Radians that a surface's facets are tilted by (Oren and Nayar 1994): assumed, as of plaster, cloth or asphalt."""
ROUGH_BACK = (0.45 * ROUGHNESS**2 / (ROUGHNESS**2 + 0.09)) / (1.0 - 0.5 * ROUGHNESS**2 / (ROUGHNESS**2 + 0.33))
"""What such a surface sends back when grazed, over what it does at right angles: their B / A."""


def imperfect(scan: Scan, sensor: Sensor, rng: np.random.Generator) -> Scan:
    """Apply everything that a sensor gets wrong along and across its rays; with noise=0 only the limits of range."""
    faults = sensor.imperfections
    scan = limited(scan, faults)
    if not faults.noise:
        return scan
    scan = without_edges(scan, faults, rng)
    scan = dropped(scan, faults, rng)
    scan = detected(scan, faults, rng)
    scan = noisy(scan, faults, rng)
    scan = blurred(scan, sensor, rng)
    return quantised(scan, faults)


def limited(scan: Scan, faults: Imperfections) -> Scan:
    """Leave out what is nearer than `range_min`, farther than `range_max`, or steeper than `incidence_max`."""
    measured = _measured(scan, faults)
    kept = (measured >= faults.range_min) & (measured <= faults.range_max)
    if faults.incidence_max < 90.0 and faults.noise:
        kept &= scan.incidences <= np.radians(faults.incidence_max)
    return scan if kept.all() else scan.select(kept)


def dropped(scan: Scan, faults: Imperfections, rng: np.random.Generator) -> Scan:
    """Lose returns at random: a share of all, and of weak ones the more the weaker the signal."""
    if not (faults.drop or faults.drop_zero):
        return scan
    lost = np.full(len(scan), faults.drop)
    if faults.drop_limit:
        signal = scan.intensities * scan.clean_ranges**2 * np.exp(-faults.attenuation * scan.clean_ranges)
        weak = faults.drop_zero * np.maximum(0.0, 1.0 - signal / faults.drop_limit)
        lost = 1.0 - (1.0 - lost) * (1.0 - weak)
    return scan.select(rng.random(len(scan)) >= lost)


def detected(scan: Scan, faults: Imperfections, rng: np.random.Generator) -> Scan:
    """Lose the returns that fade below what the sensor detects: dark, steep and far ones."""
    if not faults.reach:
        return scan
    cosines = np.cos(scan.incidences)
    # what a Lambertian surface sends back is the record's intensity; its albedo is that without the cosine
    albedos = scan.intensities * scan.clean_ranges**2 / np.maximum(cosines, 1e-9)
    return scan.select(rng.random(len(scan)) < detection(albedos, cosines, scan.clean_ranges, faults.reach))


def detection(albedos: ArrayLike, cosines: ArrayLike, ranges: ArrayLike, reach: float) -> FloatArray:
    """Return the probability that a return is detected: ``exp(-(range / reach)^2 / (albedo B(incidence)))``.

    The power received is on average ``P = albedo B / range^2``, and fades: of coherent light from a rough surface it is
    distributed exponentially (speckle), so that it is above what can be detected, ``P0 = 1 / reach^2``, with
    probability ``exp(-P0 / P)``. ``B`` is what a rough surface sends back whence the light came (Oren and Nayar 1994),
    1 at right angles; by Lambert's cosine alone the ground would end at 30 m.

    Parameters
    ----------
    albedos, cosines, ranges : (n,) float
        Of each return; cosine of its incidence; metres.
    reach : float
        Metres, as `Imperfections.reach`.

    Returns
    -------
    (n,) float
    """
    cosines = np.asarray(cosines, dtype=np.float64)
    back = cosines + ROUGH_BACK * (1.0 - cosines**2)
    signals = np.maximum(np.asarray(albedos) * back, np.finfo(np.float64).tiny)
    with np.errstate(over="ignore"):  # what is black, or far beyond the reach, is never detected
        return np.asarray(np.exp(-((np.asarray(ranges) / reach) ** 2) / signals))


def noisy(scan: Scan, faults: Imperfections, rng: np.random.Generator) -> Scan:
    """Add normal noise to the ranges; of an axial sensor to the depths."""
    sigma = faults.range_sigma(_measured(scan, faults), scan.incidences)
    if not sigma.any():
        return scan
    if faults.axial:
        sigma = sigma / scan.depths_per_range
    return scan.measuring(ranges=np.maximum(scan.ranges + sigma * rng.standard_normal(len(scan)), 1e-6))


def blurred(scan: Scan, sensor: Sensor, rng: np.random.Generator) -> Scan:
    """Turn rays across themselves by the lateral noise, which is in pixels."""
    offset, slope = (float(x) for x in np.broadcast_to(np.append(sensor.imperfections.lateral, 0.0)[:2], 2))
    if not (offset or slope) or not sensor.pixels:
        return scan
    angle = np.minimum(scan.incidences, STEEPEST)
    sigma = (offset + slope * angle / (np.pi / 2 - angle)) * sensor.imperfections.noise / sensor.pixels
    least = np.eye(3)[np.abs(scan.directions).argmin(axis=1)]
    across = np.cross(scan.directions, least)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    upwards = np.cross(scan.directions, across)
    turned = scan.directions + sigma[:, None] * (
        rng.standard_normal((len(scan), 1)) * across + rng.standard_normal((len(scan), 1)) * upwards
    )
    return scan.measuring(directions=turned / np.linalg.norm(turned, axis=1, keepdims=True))


def quantised(scan: Scan, faults: Imperfections) -> Scan:
    """Round ranges to multiples of `step`, inverse ones to multiples of `disparity_step`; depths of an axial sensor."""
    if not (faults.step or faults.disparity_step):
        return scan
    per_range = scan.depths_per_range if faults.axial else np.ones(len(scan))
    measured = scan.ranges * per_range
    if faults.disparity_step:
        disparities = np.maximum(np.round(1.0 / (measured * faults.disparity_step)), 1.0)
        measured = 1.0 / (disparities * faults.disparity_step)
    if faults.step:
        measured = np.round(measured / faults.step) * faults.step
    return scan.measuring(ranges=np.maximum(measured / per_range, 1e-6))


def without_edges(scan: Scan, faults: Imperfections, rng: np.random.Generator) -> Scan:
    """Lose a share of the pixels beside which the depth jumps, or nothing returns."""
    if not faults.edge_loss or not len(scan):
        return scan
    first = scan.columns.min() - 1, scan.rings.min() - 1
    shape = int(scan.rings.max() - first[1] + 2), int(scan.columns.max() - first[0] + 2)
    image = np.full(shape, np.inf)
    rows, columns = scan.rings - first[1], scan.columns - first[0]
    depths = scan.clean_ranges * scan.depths_per_range
    image[rows, columns] = depths
    edge = np.zeros(len(scan), dtype=bool)
    for down, right in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        edge |= np.abs(image[rows + down, columns + right] - depths) > EDGE * depths
    return scan.select(~edge | (rng.random(len(scan)) >= faults.edge_loss))


def _measured(scan: Scan, faults: Imperfections) -> FloatArray:
    """What the sensor measures, without noise: ranges, or of an axial sensor depths."""
    return scan.clean_ranges * scan.depths_per_range if faults.axial else scan.clean_ranges
