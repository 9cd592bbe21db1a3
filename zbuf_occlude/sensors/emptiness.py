"""Explanation of an empty scan: the limit of the sensor that removes all returns."""

from typing import NamedTuple

import numpy as np

from zbuf_occlude.sensors.capture import Capture
from zbuf_occlude.sensors.casting import prepare_scene
from zbuf_occlude.sensors.noise import clip_range, measured_ranges
from zbuf_occlude.sensors.returns import Scan
from zbuf_occlude.sensors.scanning import noiseless_scan
from zbuf_occlude.sensors.sensor import NoiseModel, Sensor

SECOND_CAMERA = ("baseline", "baseline_incidence_max", "match_window")
"""The numbers of a second camera."""


class Emptiness(NamedTuple):
    """The cause of an empty scan, a clause, and its remedy, a sentence."""

    reason: str
    cure: str


def why_empty(capture: Capture, sensor: Sensor, method: str, of_all: bool = False) -> Emptiness:
    """Return why a sensor keeps no return of a capture's target, or `of_all` of its scene; `method` casts the rays."""
    model, scene = sensor.noise_model, capture.scene
    returns = _of_target(capture.returns, of_all)
    without_second = not len(returns) and len(model.baselines) > 0
    if without_second:
        single = sensor.with_numbers(**{name: getattr(NoiseModel, name) for name in SECOND_CAMERA})
        rotation, origin = capture.pose[:3, :3], capture.pose[:3, 3]
        with prepare_scene(scene, method) as occluder:
            returns = _of_target(noiseless_scan(scene, single, rotation, origin, occluder=occluder), of_all)
    if not len(returns):
        if scene.transmittance is not None and (scene.transmittance[scene.instances == 0] == 1.0).all():
            return Emptiness("the object lets all light pass", "Give --transparent a share below 1.")
        if capture.hidden == 1.0:
            return Emptiness("other objects hide it", "Look from elsewhere, or lower --hidden.")
        cure = "Turn the sensor towards it, go nearer, or raise its pixels."
        return Emptiness(f"no ray of {sensor.name} meets it", cure)
    away, limits = measured_ranges(returns, model), f"{model.range_min:g} to {model.range_max:g} m"
    near, far = away < model.range_min, away > model.range_max
    if (near | far).all():
        sides = [side for side, some in (("near", near), ("far", far)) if some.any()]
        cures = {
            "near": f"raise --range (the farthest is at {away.max():.3g} m), or give --set-sensor range_min=METRES.",
            "far": f"lower --range (the nearest is at {away.min():.3g} m), or give --set-sensor range_max=METRES.",
        }
        cure = " Or ".join(cures[side] for side in sides)
        too = " or ".join(f"too {side}" for side in sides)
        reason = f"all of it that rays meet is {too} for {sensor.name}, which measures at {limits}"
        return Emptiness(reason, cure[0].upper() + cure[1:])
    if not len(clip_range(returns, model)):
        least = float(np.degrees(returns.incidences[~(near | far)].min()))
        return Emptiness(
            f"all of it that rays meet within {limits} is steeper than {sensor.name} measures, "
            f"{model.incidence_max:g} degrees of incidence (here {least:.3g} at least)",
            "Look from elsewhere, or give --set-sensor incidence_max=90.",
        )
    if without_second:
        cure = "Go farther away, or give --set-sensor baseline=0."
        return Emptiness(f"the second camera of {sensor.name} sees nothing of it", cure)
    lost = f"all returns of {sensor.name} are lost, as too weak or by chance"
    return Emptiness(lost, "Lower --range, or give --set-sensor noise=0.")


def _of_target(scan: Scan, of_all: bool) -> Scan:
    return scan if of_all else scan.select(scan.instances == 0)
