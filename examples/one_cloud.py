"""One mesh, one camera, one occluded cloud: python one_cloud.py [chair.off]

Writes cloud.ply, what the camera sees, and picture.png: the cloud from its camera and from the side.
"""

import sys

import numpy as np

import zbuf_occlude as zo
from zbuf_occlude.drawing.pictures import draw_cloud, new_figure
from zbuf_occlude.meshes import shapes

mesh = zo.load_mesh(sys.argv[1]) if len(sys.argv) > 1 else shapes.make("chair", 0)
mesh = mesh.normalized()  # longest side 1, centred
points = zo.sample_surface(mesh, n_points=20_000, seed=0)

azimuth, elevation = np.radians(40), np.radians(20)
camera = zo.Views(np.array([azimuth]), np.array([elevation]), np.array([4.0])).eyes[0]
with zo.prepare(mesh, "exact") as occluder:
    visible = occluder.visible(points, [camera])[0]
cloud = points.select(visible)
print(f"{len(cloud)} of {len(points)} points of {mesh.name} are visible")

header = f"ply\nformat ascii 1.0\nelement vertex {len(cloud)}\n"
header += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header"
np.savetxt("cloud.ply", cloud.positions, fmt="%.6f", header=header, comments="")

figure, axes = new_figure(1, 2)
side = zo.Views(np.array([azimuth + np.pi / 2]), np.array([elevation]), np.array([4.0])).eyes[0]
for panel, eye in zip(axes[0], (camera, side), strict=True):
    draw_cloud(panel, cloud.positions, normals=cloud.normals, eye=eye, target=np.zeros(3))
figure.savefig("picture.png", dpi=100)
