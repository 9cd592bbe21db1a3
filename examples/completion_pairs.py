"""Pairs for shape completion, what a camera sees and the whole: python completion_pairs.py [meshes ...]

Writes pairs.npz: partial (n, 1024, 3) and complete (n, 4096, 3), in one frame, the object's longest side 1. For the
layouts of PCN, Completion3D, MVP and others see `zbuf-occlude generate --format`.
"""

import sys

import numpy as np

import zbuf_occlude as zo
from zbuf_occlude.meshes import shapes

N_PARTIAL, N_COMPLETE = 1024, 4096
meshes = [zo.load_mesh(path) for path in sys.argv[1:]] or [shapes.make(label, 0) for label in shapes.CLASSES]
views = zo.views.fibonacci(6, distance=4.0)

partial, complete, names = [], [], []
for mesh in meshes:
    mesh = mesh.normalized()
    points = zo.sample_surface(mesh, n_points=20_000, seed=0)
    rng = np.random.default_rng(0)
    whole = points.positions[rng.choice(len(points), N_COMPLETE, replace=False)]
    with zo.prepare(mesh, "exact") as occluder:
        mask = occluder.visible(points, views.eyes)
    for seen in mask:
        ids = np.flatnonzero(seen)
        if len(ids) == 0:  # an eye inside a closed object, say
            continue
        partial.append(points.positions[rng.choice(ids, N_PARTIAL, replace=len(ids) < N_PARTIAL)])
        complete.append(whole)
        names.append(mesh.name)

np.savez_compressed("pairs.npz", partial=np.float32(partial), complete=np.float32(complete), names=names)
print(f"{len(partial)} pairs of {len(meshes)} meshes: pairs.npz")
