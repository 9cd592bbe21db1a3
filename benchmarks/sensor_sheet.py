"""README's picture of one car: uniform cloud, a LiDAR's scans at 10, 20 and 40 m, in a street, and by a depth camera.

python benchmarks/sensor_sheet.py --out docs/sensors.png
"""

import argparse
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib import colormaps

import zbuf_occlude as zo
from zbuf_occlude import shapes
from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.drawing.pictures import draw_cloud, new_figure
from zbuf_occlude.scenes.contents import Pool
from zbuf_occlude.sensors import Scan, make
from zbuf_occlude.sensors.capture import captures, in_metres, sensor_places
from zbuf_occlude.sensors.scanning import default_caster
from zbuf_occlude.sensors.setup import Setup

AZIMUTH = np.radians(-140.0)
FIXED = 9.0 * np.array([np.cos(AZIMUTH + 0.5), np.sin(AZIMUTH + 0.5), 0.35])
"""From where the cloud is drawn, metres."""


def seeds(what: str, view: int, *, seed: int) -> np.random.SeedSequence:
    """Seed the draws of a scan."""
    return np.random.SeedSequence([seed, *what.encode(), view])


def scanned(mesh: zo.Mesh, sensor: str, distance: float, scene: str, seed: int = 0, **given: object) -> Scan:
    """Scan a car that stands as `stand` puts it."""
    setup = Setup(make(sensor).document, range=(distance,) * 2, scene=scene, method=default_caster(), **given)  # type: ignore[arg-type]
    drawn, floor = partial(seeds, seed=seed), float(mesh.bounds[0, 2])
    views = zo.Views(np.array([AZIMUTH]), np.array([0.15]), np.array([2.0]))
    pool = Pool(shapes.collection(n_members=3), {}, scene, np.random.SeedSequence(1))
    places = sensor_places(views, mesh.longest_side, floor, setup, drawn)
    (capture,) = captures(mesh, setup, places, floor, drawn, pool)
    return capture.scan


def main() -> None:
    """Draw the sheet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("docs/sensors.png"))
    given = parser.parse_args()
    plain = Setup(make("hdl-64e").document)
    mesh, _ = in_metres(shapes.make("car", 1), "car", plain)
    eye = 10.0 * np.array([np.cos(AZIMUTH), np.sin(AZIMUTH), 0.1])
    points = zo.sample_surface(mesh, n_points=12_000, seed=0)
    with zo.prepare(mesh, "exact") as occluder:
        uniform = points.positions[occluder.visible(points, eye[None])[0]]
    shown: list[tuple[str, FloatArray, FloatArray | None]] = [("uniform over the visible surface", uniform, None)]
    for distance in (10.0, 20.0, 40.0):
        scan = scanned(mesh, "hdl-64e", distance, "ground")
        shown.append((f"HDL-64E at {distance:.0f} m", scan.positions, None))
    street = scanned(mesh, "hdl-64e", 10.0, "street", seed=2, hidden=(0.35, 0.45), keep="all")
    near = street.select(np.linalg.norm(street.positions, axis=1) < 4.0)
    colours = np.where(near.instances[:, None] == 0, [[0.24, 0.44, 0.71]], colormaps["Set2"](near.instances % 8)[:, :3])
    shown.append(("HDL-64E at 10 m in a street, 40 % hidden", near.positions, colours))
    camera = scanned(mesh, "azure-kinect-nfov", 3.4, "ground")
    shown.append(("Azure Kinect at 3.4 m", camera.positions, None))
    figure, axes = new_figure(2, 3, panel=3.2)
    for panel, (title, positions, values) in zip(axes.flat, shown, strict=True):
        draw_cloud(panel, positions, eye=FIXED, target=(0.0, 0.0, 0.0), values=values, radius=1.75, size=3.0)
        panel.set_title(f"{title}: {len(positions):,} points", fontsize=9)
    figure.savefig(given.out, format="png", dpi=110)


if __name__ == "__main__":
    main()
