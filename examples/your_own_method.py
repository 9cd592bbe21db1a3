"""A method of hidden-surface removal of your own, compared with the reference: python your_own_method.py

A method answers one question, which points does each eye see; `_visible` is all it needs. This one is back-face
culling: a point is visible when its face looks towards the eye. It is wrong wherever one part hides another, and
wherever winding is inconsistent; the last lines say how often. To make it a row of `zo.METHODS`, see CONTRIBUTING.md.
"""

import numpy as np

import zbuf_occlude as zo
from zbuf_occlude.meshes import shapes
from zbuf_occlude.visibility.interface import VisibilityQuery


class BackFaceCulling(VisibilityQuery):
    """Visible is what faces the eye."""

    def _visible(self, points: zo.SurfacePoints, eyes: np.ndarray) -> np.ndarray:
        towards = eyes[:, None] - points.positions[None]
        return np.einsum("knx,nx->kn", towards, points.normals) > 0.0


for mesh in (shapes.solids.icosphere(3), shapes.make("chair", 0), shapes.make("airplane", 0)):
    points = zo.sample_surface(mesh, n_points=2_000, seed=0)
    eyes = zo.views.ring(6, elevation=17, distance=4.0).around(mesh.centre, mesh.longest_side).eyes
    with zo.prepare(mesh, "oracle") as reference, BackFaceCulling(mesh) as mine:
        truth, answer = reference.visible(points, eyes), mine.visible(points, eyes)
    shown, lost = (answer & ~truth).mean(), (~answer & truth).mean()
    print(f"{mesh.name:16} shown though hidden {shown:6.1%}, hidden though visible {lost:6.1%}")
