"""MuJoCo-LiDAR, unmodified, beside the sensors of Livox: the same shots into the same mesh, and where shots go.

    python benchmarks/livox_shots.py [--scans 20]

Runs where mujoco-lidar is installed beside this package.

rays        the shots of its tables, from one place into a closed mesh in a room: shots of which only one of MuJoCo and
            `exact` has a return, the largest difference of the two ranges, microseconds a shot
patterns    shares of shots by azimuth and by elevation, twelve bands each: the largest difference between its table and
            our sensor over as many scans, in percentage points

Exit status 1 where the returns of a shot differ by 0.1 mm, or a band by 3.5 points.
"""

import tempfile
import time
from pathlib import Path

import mujoco
import numpy as np
from common import row, run
from mujoco_lidar import MjLidarWrapper
from mujoco_lidar.scan_gen import LivoxGenerator

import zbuf_occlude as zo
from zbuf_occlude.meshes.shapes.built_in import find_shape
from zbuf_occlude.sensors import make

SENSORS = {"mid-40": "mid40", "mid-360": "mid360", "avia": "avia"}
PLACE = np.array([-1.5, 0.375, 0.75])
FARTHEST, NEAR, BANDS, CLOSE = 100.0, 1e-4, 12, 3.5
MODEL = """<mujoco><asset><mesh name="room" file="{}" inertia="shell"/></asset><worldbody>
<geom type="mesh" mesh="room"/><site name="lidar" pos="{} {} {}"/></worldbody></mujoco>"""


def scene() -> zo.Mesh:
    """Return a car in a room without a roof, metres."""
    family, label = find_shape("classes/car")
    car = family.make(label, 0, 0)
    walls = zo.Mesh(
        [[x, y, z] for x in (-4.0, 6.0) for y in (-5.0, 5.0) for z in (0.0, 3.0)],
        [[0, 4, 2], [2, 4, 6], [0, 1, 4], [1, 5, 4], [2, 6, 3], [3, 6, 7], [0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6]],
    )
    return zo.Mesh(
        np.concatenate([car.vertices, walls.vertices]), np.concatenate([car.faces, walls.faces + len(car.vertices)])
    )


def main(*, scans: int = 20) -> int:
    """Cast the tables' shots by both, compare the patterns, and print a row for each sensor."""
    mesh = scene()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "room.obj"
        mesh.to_trimesh().export(path, digits=17)
        model = mujoco.MjModel.from_xml_string(MODEL.format(path, *PLACE))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    lidar = MjLidarWrapper(model, "lidar", backend="cpu", cutoff_dist=FARTHEST)
    row("sensor", "shots", "one of both", "largest difference, m", "MuJoCo, us a shot", "exact", "azimuth", "elevation")
    row(*["---"] * 8)
    is_close = True
    with zo.prepare(mesh, "exact") as query:
        for name, table in SENSORS.items():
            theta, phi = np.asarray(LivoxGenerator(table).ray_angles, float).T
            sensor = make(name)
            n = len(sensor.rays())
            theirs, mine, seconds = cast(lidar, data, query, theta[:n], phi[:n])
            met = theirs > 0.0
            both = met & np.isfinite(mine)
            apart = float(np.abs(theirs[both] - mine[both]).max())
            some = slice(0, min(scans * n, len(theta)))
            rays = make(name, seconds=sensor.duration * scans).rays().directions
            shares = [
                largest_share(theta[some], np.arctan2(rays[:, 1], rays[:, 0])),
                largest_share(phi[some], np.arcsin(rays[:, 2])),
            ]
            cells = [f"{1e6 * each / n:.2f}" for each in seconds] + [f"{each:.1f}" for each in shares]
            row(name, f"{n:,}", int((met != np.isfinite(mine)).sum()), f"{apart:.1e}", *cells)
            is_close &= apart < NEAR and max(shares) < CLOSE
    return 0 if is_close else 1


def cast(lidar, data, query, theta, phi):
    """Return the ranges (n,) of shots by MuJoCo, negative without a return, and by `exact`, and the seconds of both."""
    directions = np.stack([np.cos(phi) * np.cos(theta), np.cos(phi) * np.sin(theta), np.sin(phi)], axis=1)
    times = []
    for _ in range(2):  # the second one counts
        began = time.perf_counter()
        lidar.trace_rays(data, theta, phi)
        theirs = lidar.get_distances()
        between = time.perf_counter()
        mine = query.first_hits(PLACE[None], directions).distances
        times = [between - began, time.perf_counter() - between]
    return np.asarray(theirs, float), mine, times


def largest_share(theirs, ours) -> float:
    """Return the largest difference of the shares of angles (n,) and (m,), radians, in bands; percentage points."""
    theirs, ours = ((angles + np.pi) % (2.0 * np.pi) - np.pi for angles in (theirs, ours))
    edges = np.linspace(theirs.min(), theirs.max() + 1e-9, BANDS + 1)
    shares = [100.0 * np.histogram(np.clip(each, *edges[[0, -1]]), edges)[0] / len(each) for each in (theirs, ours)]
    return float(np.abs(shares[0] - shares[1]).max())


if __name__ == "__main__":
    run(main, __doc__)
