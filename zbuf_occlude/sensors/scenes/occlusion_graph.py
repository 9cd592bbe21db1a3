"""Mutual occlusion of the objects of a scene."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.base.arrays import FloatArray, as_numbers
from zbuf_occlude.base.errors import ArgumentError, check_int
from zbuf_occlude.base.provenance import generator
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import Seed, error_of_share, sample_surface
from zbuf_occlude.sensors.scenes.scene import Scene
from zbuf_occlude.visibility import prepare
from zbuf_occlude.visibility.interface import CONTACT


@dataclass(frozen=True, eq=False)
class OcclusionGraph:
    """Mutual occlusion of the objects of a scene for one eye.

    Parameters
    ----------
    labels : tuple of str
        Labels of the objects.
    shares : (o, o) float
        ``shares[a, b]`` is the share that b hides of the surface of a that would be visible if a were alone; b is the
        first object in the line of sight. 0 on the diagonal; NaN for an object with no visible sample if alone.
    standard_error : (o, o) float
        Standard error of the shares; above 0 even if none or all of the points are hidden.
    """

    labels: tuple[str, ...]
    shares: FloatArray
    standard_error: FloatArray

    def __repr__(self) -> str:
        return f"OcclusionGraph({len(self.labels)} objects, {int((self.shares > 0).sum())} occluding pairs)"

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for scene_occlusion.json: the objects, and indices and share of each occluding pair."""
        pairs = [
            {"object": a, "hidden_by": b, "share": float(self.shares[a, b])}
            for a, b in np.argwhere(self.shares > 0).tolist()
        ]
        return {"objects": list(self.labels), "hides": pairs}


def occlusion_graph(
    scene: Scene, eye: ArrayLike, *, n_points: int = 10_000, seed: Seed = 0, method: str = "exact", **options: Any
) -> OcclusionGraph:
    """Estimate which objects of a scene hide each other, and how much.

    Parameters
    ----------
    scene : Scene
    eye : (3,) float
        World space.
    n_points : int
        Number of points on each object's surface.
    seed : int
    method : str
        Name of a method that casts rays. With an exact method the only error is that of sampling.
    **options
        Options of the method.

    Raises
    ------
    ArgumentError, OptionError, UnavailableError, GlError
        As `prepare`, `VisibilityQuery.visible` and `VisibilityQuery.first_hits`.

    Examples
    --------
    >>> car = zo.load_mesh("car.obj")
    >>> other = zo.scenes.Placed(car, "car", zo.scenes.moved(to=(9, 0, 0)))
    >>> scene = zo.Scene.joined([zo.scenes.Placed(car, "car"), other])
    >>> zo.occlusion_graph(scene, [30.0, 1.0, 1.0]).to_dict()["hides"][0]["hidden_by"]
    1
    """
    if not isinstance(scene, Scene):
        raise ArgumentError(f"scene must be a Scene; got {type(scene).__name__}. Make one: Scene.joined(placed).")
    check_int("n_points", n_points, 1)
    at, rng, n_objects = as_numbers(eye, "eye", (3,)), generator(seed), len(scene.labels)
    shares, error = np.full((2, n_objects, n_objects), np.nan)
    with prepare(scene.mesh, method, **options) as whole:
        for number in np.unique(scene.instances).tolist():
            alone = Mesh(scene.mesh.vertices, scene.mesh.faces[scene.instances == number], scene.labels[number])
            points = sample_surface(alone, n_points=n_points, seed=rng)
            with prepare(alone, method, **options) as query:
                seen = points.positions[query.visible(points, at)]
            hits = whole.first_hits(at[None], seen - at)
            before = hits.distances < np.linalg.norm(seen - at, axis=1) - CONTACT * scene.mesh.diagonal
            others = np.bincount(scene.instances[hits.face_ids[before]], minlength=n_objects)
            if len(seen):
                shares[number], error[number] = others / len(seen), error_of_share(others, len(seen))
    np.fill_diagonal(shares, 0.0)
    np.fill_diagonal(error, 0.0)
    return OcclusionGraph(scene.labels, shares, error)
