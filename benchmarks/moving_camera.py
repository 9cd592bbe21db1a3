"""Time of an answer of `zbuf-occlude view` while the camera moves: python benchmarks/moving_camera.py MESH ...

The camera stands at 40 places of a ring about each mesh, 20 degrees high and 2 longest sides away. An answer is the
visible and the hidden points with their normals, or the scan of a sensor, which sees the mesh as 1 m long. The last
mesh is a built-in airplane with a million faces.
"""

import re
import time
from pathlib import Path

import numpy as np
from common import heads, row, run

from zbuf_occlude.drawing.seen_cloud import MovingCamera
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes import shapes
from zbuf_occlude.meshes.load import load_mesh
from zbuf_occlude.sensors import SENSORS, look_at
from zbuf_occlude.views import ring

SENSOR, FEW, MANY = SENSORS["realsense-d435"], 20_000, 200_000


def milliseconds(mesh: Mesh, places: int) -> list[float]:
    """Return the medians of few points, many points, and a sensor."""
    eyes = ring(places, elevation=20.0, distance=2.0).around(mesh.centre, mesh.longest_side).eyes
    poses, medians = [look_at(eye, mesh.centre) for eye in eyes], []
    with MovingCamera(mesh) as camera:
        for n_points, sensor in ((FEW, None), (MANY, None), (FEW, SENSOR)):
            camera.see(poses[0], n_points, sensor)  # samples
            times = []
            for pose in poses:
                began = time.perf_counter()
                camera.see(pose, n_points, sensor)
                times.append(time.perf_counter() - began)
            medians.append(1e3 * float(np.median(times)))
    return medians


def main(*paths: Path, places: int = 40, faces: int = 1_000_000) -> None:
    heads("mesh", "faces", f"{FEW:,} points, ms", f"{MANY:,} points, ms", f"{SENSOR.name}, ms")
    for mesh in [*map(load_mesh, paths), shapes.benchmark_mesh(faces)]:
        normalized = mesh.normalized()
        medians = milliseconds(normalized, places)
        row(re.split("_+", mesh.name)[0], f"{len(mesh.faces):,}", *(f"{median:.1f}" for median in medians))


if __name__ == "__main__":
    run(main, __doc__)
