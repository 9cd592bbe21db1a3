"""Why a scan is empty: which limit of the sensor leaves out all that its rays meet."""

from dataclasses import replace

import numpy as np

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.scenes.scene import Scene
from zbuf_occlude.sensors.scanning import limited, measured_ranges, scan
from zbuf_occlude.sensors.sensor import Imperfections, Sensor

EYES = ("baseline", "baseline_incidence_max", "window")
"""The numbers of a second eye."""


def why_empty(scene: Scene, sensor: Sensor, pose: FloatArray, method: str, of_all: bool = False) -> str:
    """Say why a sensor at a pose (4, 4) has no return of a scene's first object, or `of_all`, and what to do."""
    faults = sensor.imperfections
    free = replace(sensor, imperfections=Imperfections(axial=faults.axial))
    found = scan(scene, free, pose, method=method)
    found = found if of_all else found.select(found.instances == 0)
    what = "anything" if of_all else "the object"
    if not len(found):
        return f"no ray of {sensor.name} meets {what}. Turn the sensor towards it, go nearer, or raise its pixels."
    away = measured_ranges(found, faults)
    nearest, farthest = f"{away.min():.3g}", f"{away.max():.3g}"
    if away.max() < faults.range_min:
        return (
            f"all that the rays meet is nearer ({farthest} m at most) than {sensor.name} measures from, "
            f"{faults.range_min:g} m. Raise --range, or give --set-sensor range_min=METRES."
        )
    if away.min() > faults.range_max:
        return (
            f"all that the rays meet is farther ({nearest} m at least) than {sensor.name} measures, "
            f"{faults.range_max:g} m. Lower --range, or give --set-sensor range_max=METRES."
        )
    if not len(limited(found, faults)):
        steep = np.degrees(found.incidences.min())
        return (
            f"all that the rays meet within {faults.range_min:g} to {faults.range_max:g} m is steeper than "
            f"{sensor.name} measures, {faults.incidence_max:g} degrees of incidence (here {steep:.3g} at least). Look "
            "from elsewhere, or give --set-sensor incidence_max=90."
        )
    one_eye = sensor.with_numbers(**{name: getattr(Imperfections, name) for name in EYES})
    if len(faults.second_eyes) and len(scan(scene, one_eye, pose, method=method)):
        return f"the second eye of {sensor.name} sees nothing of it. Go farther away, or give --set-sensor baseline=0."
    return f"all returns of {sensor.name} are lost, as too weak or by chance. Lower --range, or --set-sensor noise=0."
