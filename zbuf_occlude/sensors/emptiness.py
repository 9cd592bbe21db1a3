"""Why a scan is empty: which limit of the sensor leaves out all that its rays meet."""

from typing import NamedTuple

import numpy as np

from zbuf_occlude.sensors.capture import Capture
from zbuf_occlude.sensors.casting import prepare_scene
from zbuf_occlude.sensors.scanning import Scan, clip_range, faultless, measured_ranges
from zbuf_occlude.sensors.sensor import NoiseModel, Sensor

EYES = ("baseline", "baseline_incidence_max", "window")
"""The numbers of a second eye."""


class Emptiness(NamedTuple):
    """A clause that says why a scan is empty, and a sentence that says what to do."""

    reason: str
    cure: str


def why_empty(capture: Capture, sensor: Sensor, method: str, of_all: bool = False) -> Emptiness:
    """Return why a sensor keeps no return of a capture's target, or `of_all` of its scene; `method` casts the rays."""
    faults, scene = sensor.imperfections, capture.scene
    returns = _of(capture.returns, of_all)
    is_of_one_eye = not len(returns) and len(faults.second_eyes) > 0
    if is_of_one_eye:
        one_eye = sensor.with_numbers(**{name: getattr(NoiseModel, name) for name in EYES})
        rotation, origin = capture.pose[:3, :3], capture.pose[:3, 3]
        with prepare_scene(scene, method) as occluder:
            returns = _of(faultless(scene, one_eye, rotation, origin, occluder=occluder), of_all)
    if not len(returns):
        if scene.transmittance is not None and (scene.transmittance[scene.instances == 0] == 1.0).all():
            return Emptiness("the object lets all light pass", "Give --transparent a share below 1.")
        if capture.hidden == 1.0:
            return Emptiness("other objects hide it", "Look from elsewhere, or lower --hidden.")
        cure = "Turn the sensor towards it, go nearer, or raise its pixels."
        return Emptiness(f"no ray of {sensor.name} meets it", cure)
    away, reach = measured_ranges(returns, faults), f"{faults.range_min:g} to {faults.range_max:g} m"
    near, far = away < faults.range_min, away > faults.range_max
    if (near | far).all():
        sides = [side for side, some in (("near", near), ("far", far)) if some.any()]
        cures = {
            "near": f"raise --range (the farthest is at {away.max():.3g} m), or give --set-sensor range_min=METRES.",
            "far": f"lower --range (the nearest is at {away.min():.3g} m), or give --set-sensor range_max=METRES.",
        }
        cure = " Or ".join(cures[side] for side in sides)
        too = " or ".join(f"too {side}" for side in sides)
        reason = f"all of it that rays meet is {too} for {sensor.name}, which measures at {reach}"
        return Emptiness(reason, cure[0].upper() + cure[1:])
    if not len(clip_range(returns, faults)):
        least = float(np.degrees(returns.incidences[~(near | far)].min()))
        return Emptiness(
            f"all of it that rays meet within {reach} is steeper than {sensor.name} measures, "
            f"{faults.incidence_max:g} degrees of incidence (here {least:.3g} at least)",
            "Look from elsewhere, or give --set-sensor incidence_max=90.",
        )
    if is_of_one_eye:
        cure = "Go farther away, or give --set-sensor baseline=0."
        return Emptiness(f"the second eye of {sensor.name} sees nothing of it", cure)
    lost = f"all returns of {sensor.name} are lost, as too weak or by chance"
    return Emptiness(lost, "Lower --range, or give --set-sensor noise=0.")


def _of(scan: Scan, of_all: bool) -> Scan:
    return scan if of_all else scan.select(scan.instances == 0)
