"""First hits of `exact` against Open3D's ``cast_rays`` call alone: a LiDAR's turn in a street, a picture of one object.

    python benchmarks/first_hits.py ../shared/data/furniture [--repeats 9]

The street is the folder's meshes, turned and scattered between 6 and 60 m about the sensor, until it has enough faces.
Both sides answer the same rays, several times in turns; the median of each counts. Open3D's rays are made beforehand.
"""

import argparse
import time
from pathlib import Path

import numpy as np
import open3d as o3d

import zbuf_occlude as zo
from zbuf_occlude.arrays import FloatArray


def street(folder: Path, n_faces: int) -> zo.Mesh:
    """Scatter the meshes of a folder, 4 m long each, over a ground, until there are this many faces."""
    rng, files, parts, n = np.random.default_rng(0), sorted(folder.rglob("*.o[bf][jf]")), [], 0
    while n < n_faces:
        mesh = zo.load_mesh(files[len(parts) % len(files)]).normalized()
        turn, place, away = rng.uniform(0, 2 * np.pi), rng.uniform(0, 2 * np.pi), rng.uniform(6, 60)
        rotation = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
        parts.append(4.0 * mesh.corners @ rotation.T + [away * np.cos(place), away * np.sin(place), 0.0])
        n += len(mesh.faces)
    ground = np.array([[-80.0, -80, -2], [80, -80, -2], [80, 80, -2], [-80, 80, -2]])
    corners = np.concatenate([*parts, ground[[[0, 1, 2], [0, 2, 3]]]])
    return zo.Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def picture(mesh: zo.Mesh) -> tuple[FloatArray, FloatArray]:
    """Cast the rays of a 640 x 480 camera, f 575, at 1.8 longest sides."""
    x, y = np.meshgrid(np.arange(640) - 319.5, np.arange(480) - 239.5)
    directions = np.stack([np.full_like(x, 575.0), -x, -y], axis=-1).reshape(-1, 3)
    return mesh.centre[None] - [[1.8 * mesh.longest_side, 0.0, 0.0]], directions


def race(mesh: zo.Mesh, origins: FloatArray, directions: FloatArray, repeats: int) -> tuple[float, float, float]:
    """Return the median milliseconds of `exact` and of Open3D, and the share of rays with the same face."""
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32))
    starts = np.broadcast_to(origins, directions.shape)
    rays = o3d.core.Tensor(np.concatenate([starts, directions], axis=1).astype(np.float32))
    times: list[list[float]] = [[], []]
    with zo.prepare(mesh, "exact") as occluder:
        for _ in range(repeats + 1):
            began = time.perf_counter()
            found = occluder.first_hits(origins, directions)
            between = time.perf_counter()
            theirs = scene.cast_rays(rays)
            times[0].append(between - began)
            times[1].append(time.perf_counter() - between)
    named = theirs["primitive_ids"].numpy().astype(np.int64)
    named[named == o3d.t.geometry.RaycastingScene.INVALID_ID] = -1
    ours, embree = (1e3 * float(np.median(each[1:])) for each in times)  # the first may compile and build
    return ours, embree, float((named == found.face_ids).mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--repeats", type=int, default=9)
    options = parser.parse_args()
    turn = zo.sensors.make("vls-128", columns=1800).rays().directions
    files = sorted(options.folder.rglob("*.o[bf][jf]"))
    meshes = sorted((zo.load_mesh(path) for path in files), key=lambda mesh: abs(len(mesh.faces) - 5000))
    cases = [(f"VLS-128 turn, street of {n:,} faces", street(options.folder, n), None) for n in (30_000, 1_000_000)]
    cases.append((f"640 x 480, {meshes[0].name}, {len(meshes[0].faces):,} faces", meshes[0], picture(meshes[0])))
    print(f"{'':48s} {'exact ms':>9} {'Open3D ms':>10} {'times as fast':>14} {'same face':>10}")
    for name, mesh, rays in cases:
        origins, directions = rays or (np.zeros((1, 3)), turn)
        ours, embree, same = race(mesh, origins, np.ascontiguousarray(directions).reshape(-1, 3), options.repeats)
        print(f"{name:48s} {ours:9.1f} {embree:10.1f} {embree / ours:14.2f} {same:10.4f}", flush=True)


if __name__ == "__main__":
    main()
