"""What a user writes without this package: trimesh loads and samples, Open3D casts rays, h5py writes.

    python benchmarks/ray_casting_script.py OUT EYES.npy N_POINTS SAMPLE_SIZE MESH...

EYES.npy: (k, 3) positions of cameras about the origin, in longest sides of a mesh. `whole_job.py` runs this.
"""

import sys

import h5py
import numpy as np
import open3d as o3d
import trimesh

out, eyes, n_points, size = sys.argv[1], np.load(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
rng = np.random.default_rng(0)
clouds, labels = [], []
for label, path in enumerate(sys.argv[5:]):
    mesh = trimesh.load(path, force="mesh")
    points, _ = trimesh.sample.sample_surface(mesh, n_points, seed=0)
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.core.Tensor(mesh.vertices.astype("f4")), o3d.core.Tensor(mesh.faces.astype("u4")))
    for eye in mesh.bounds.mean(axis=0) + mesh.extents.max() * eyes:
        rays = np.concatenate([np.broadcast_to(eye, points.shape), points - eye], axis=1).astype("f4")
        hidden = scene.test_occlusions(o3d.core.Tensor(rays), 0.0, 1.0 - 1e-4).numpy()
        visible = np.flatnonzero(~hidden)
        if len(visible):
            cloud = points[rng.choice(visible, size, replace=len(visible) < size)]
            low, high = cloud.min(axis=0), cloud.max(axis=0)
            clouds.append(((cloud - (low + high) / 2) / (high - low).max()).astype("f4"))
            labels.append(label)
order = rng.permutation(len(clouds))
for number, start in enumerate(range(0, len(order), 2048)):
    chosen = order[start : start + 2048]
    with h5py.File(f"{out}/ply_data_train{number}.h5", "w") as file:
        file["data"] = np.stack([clouds[i] for i in chosen])
        file["label"] = np.array([labels[i] for i in chosen])[:, None]
