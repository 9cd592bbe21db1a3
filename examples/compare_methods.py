"""Every method of hidden-surface removal that runs here, against the exact reference: python compare_methods.py [mesh]

`zbuf-occlude compare` does this thoroughly, with a report; here is the whole idea in a loop over a table.
"""

import sys
import time

import zbuf_occlude as zo
from zbuf_occlude.meshes import shapes

mesh = zo.load_mesh(sys.argv[1]) if len(sys.argv) > 1 else shapes.make("table", 3)
points = zo.sample_surface(mesh, n_points=2_000, seed=0)
eyes = zo.views.ring(4, elevation=23, distance=4.0).around(mesh.centre, mesh.longest_side).eyes

with zo.prepare(mesh, "oracle") as reference:
    truth = reference.visible(points, eyes)
    decided = reference.decided(points, eyes)  # False in the boundary band, where rounding decides

print(
    f"{mesh.name}, {len(mesh.faces)} faces: {truth.mean():.1%} visible, {1 - decided.mean():.2%} in the boundary band"
)
print(f"{'method':24}{'wrong outside the band':>24}{'ms per view':>14}")
for method in zo.METHODS:
    try:
        with zo.prepare(mesh, method.name) as occluder:
            occluder.visible(points, eyes)  # what is made at the first call
            began = time.perf_counter()
            answer = occluder.visible(points, eyes)
            milliseconds = 1000 * (time.perf_counter() - began) / len(eyes)
    except (zo.UnavailableError, zo.GlError) as error:
        print(f"{method.name:24}cannot run here: {error}")
        continue
    wrong = (answer != truth)[decided].mean()
    print(f"{method.name:24}{wrong:>24.2%}{milliseconds:>14.2f}")
