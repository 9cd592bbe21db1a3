"""What eyes see of space and what hides what: a grid of voxels, the faces before points, the objects of a scene."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray, as_number, as_numbers
from zbuf_occlude.errors import ArgumentError, OptionError, check_int
from zbuf_occlude.geometry.mesh import Mesh, MeshLike, as_mesh
from zbuf_occlude.geometry.sampling import Seed, SurfacePoints, error_of_share, sample_surface
from zbuf_occlude.provenance import generator
from zbuf_occlude.scenes.scene import Scene
from zbuf_occlude.visibility import prepare
from zbuf_occlude.visibility.interface import CONTACT, FARTHEST, as_eyes

MOST_VOXELS = 2**27
"""Of a grid, for all eyes together: with the centres 3.7 GB."""
MARGIN = 0.05
"""Of a grid around the mesh, in longest sides, on each side."""
HIDDEN, FREE, SURFACE = 0, 1, 2
"""What `VisibilityGrid.states` says of a voxel."""


@dataclass(frozen=True, eq=False)
class VisibilityGrid:
    """What eyes see of a cube of n x n x n voxels around a mesh, decided at the voxels' centres.

    Parameters
    ----------
    low : (3,) float
        Lowest corner of the cube, world space.
    step : float
        Side of a voxel.
    distances : (k, n, n, n) float32
        Of each eye, along its line of sight: from the voxel's centre to the first surface, world units. Positive in
        front of it, negative behind it, infinite where the line meets nothing. Clipped to a few voxels it is the
        projective TSDF of a depth image of any resolution.
    """

    low: FloatArray
    step: float
    distances: NDArray[np.float32]

    def __repr__(self) -> str:
        return f"VisibilityGrid({len(self.free)}^3 voxels of {self.step:.4g}, {self.free.mean():.1%} free)"

    @property
    def centres(self) -> FloatArray:
        """World space, (n, n, n, 3)."""
        places = (np.arange(self.distances.shape[1]) + 0.5) * self.step
        return np.stack(np.meshgrid(*(self.low + places[:, None]).T, indexing="ij"), axis=-1)

    @property
    def free(self) -> BoolArray:
        """Centres that an eye sees, (n, n, n)."""
        return np.asarray((self.distances > 0.0).any(axis=0))

    @property
    def states(self) -> NDArray[np.uint8]:
        """`SURFACE` within half a voxel's diagonal of what an eye sees, else `FREE` or `HIDDEN`, (n, n, n)."""
        near = (np.abs(self.distances) <= self.step * np.sqrt(3.0) / 2.0).any(axis=0)
        return np.where(near, SURFACE, np.where(self.free, FREE, HIDDEN)).astype(np.uint8)

    def tsdf(self, truncation: float) -> NDArray[np.float32]:
        """Fuse the eyes' distances, cut off at `truncation` world units, (n, n, n).

        The mean of the eyes for which the centre is not farther behind the surface; where it is for all, minus
        `truncation`.
        """
        want = "a length above 0, in the mesh's unit"
        truncation = as_number(truncation, "truncation", want, lambda length: 0.0 < length < FARTHEST)
        known = self.distances > -truncation
        total = np.where(known, np.minimum(self.distances, truncation), 0.0).sum(axis=0)
        return np.where(known.any(axis=0), total / np.maximum(known.sum(axis=0), 1), -truncation).astype(np.float32)


@dataclass(frozen=True, eq=False)
class OcclusionGraph:
    """Who hides whom in a scene, as one eye sees it.

    Parameters
    ----------
    labels : tuple of str
        Of the objects.
    shares : (o, o) float
        ``shares[a, b]``: of the surface of a that the eye would see if a were alone, the share that b hides, being the
        first in the line of sight. 0 on the diagonal; NaN of an object of which, alone, no sampled point is seen.
    standard_error : (o, o) float
        Of the shares; above 0 where none or all of the points are hidden too.
    """

    labels: tuple[str, ...]
    shares: FloatArray
    standard_error: FloatArray

    def __repr__(self) -> str:
        return f"OcclusionGraph({len(self.labels)} objects, {int((self.shares > 0).sum())} of them pairs that hide)"

    def to_dict(self) -> dict[str, Any]:
        """Plain data, for scene_occlusion.json: the objects, and for each pair that hides its numbers and its share."""
        pairs = [
            {"object": a, "hidden_by": b, "share": float(self.shares[a, b])}
            for a, b in np.argwhere(self.shares > 0).tolist()
        ]
        return {"objects": list(self.labels), "hides": pairs}


def visibility_grid(
    mesh: MeshLike, eyes: ArrayLike, n: int = 64, *, method: str = "exact", **options: Any
) -> VisibilityGrid:
    """Answer which voxels around a mesh eyes see, and how far before or behind the surface they lie.

    Parameters
    ----------
    mesh : Mesh
        Or anything that is one (`occlude`).
    eyes : (3,) or (k, 3) float
        World space.
    n : int
        Voxels along a side of the cube, which is a tenth larger than the mesh's longest side.
    method : str
        A name of the table of methods that casts rays; `exact` decides each centre without error.
    **options
        The method's own.

    Raises
    ------
    ArgumentError, OptionError, UnavailableError, GlError
        As `prepare` and `VisibilityQuery.first_hits`.

    Examples
    --------
    >>> grid = zo.visibility_grid("chair.off", [3.0, 2.0, 1.5], n=16)
    >>> grid.states.shape, grid.distances.shape
    ((16, 16, 16), (1, 16, 16, 16))
    """
    mesh = as_mesh(mesh)
    check_int("n", n, 1)
    places = as_eyes(eyes)
    if (n_voxels := int(n) ** 3 * max(len(places), 1)) > MOST_VOXELS:
        raise OptionError(
            f"a grid must have at most {MOST_VOXELS:,} voxels for all eyes together; {len(places)} of {n} along a side "
            f"have {n_voxels:,}. Lower n."
        )
    side = mesh.longest_side * (1.0 + 2.0 * MARGIN)
    if side == 0.0:
        raise ArgumentError(f"a mesh must have an extent; all vertices of {mesh.name} coincide.")
    grid = VisibilityGrid(mesh.centre - side / 2.0, side / n, np.empty((len(places), n, n, n), np.float32))
    centres = grid.centres.reshape(-1, 3)
    with prepare(mesh, method, **options) as occluder:
        for eye, distances in zip(places, grid.distances, strict=True):
            away = np.linalg.norm(centres - eye, axis=1)
            if not away.all():
                raise ArgumentError("an eye must not be at the centre of a voxel; one is. Move it a little.")
            distances[:] = (occluder.first_hits(eye[None], centres - eye).distances - away).reshape(n, n, n)
    return grid


def blockers(
    mesh: MeshLike, points: SurfacePoints, eye: ArrayLike, *, method: str = "exact", **options: Any
) -> IntArray:
    """Return for each point the face nearest to the eye that hides it, (n,) int32; -1 of points that the eye sees.

    Of a `Scene` give its mesh; ``scene.instances[faces]`` are the objects.

    Raises
    ------
    ArgumentError, OptionError, UnavailableError, GlError
        As `prepare`, `VisibilityQuery.visible` and `VisibilityQuery.first_hits`.

    Examples
    --------
    >>> mesh = zo.load_mesh("chair.off")
    >>> faces = zo.blockers(mesh, zo.sample_surface(mesh, n_points=100, seed=0), [3.0, 2.0, 1.5])
    >>> bool((faces >= 0).any() and (faces < len(mesh.faces)).all())
    True
    """
    mesh, at = as_mesh(mesh), as_numbers(eye, "eye", (3,))
    with prepare(mesh, method, **options) as occluder:
        hidden = np.flatnonzero(~occluder.visible(points, at))
        found = np.full(len(points), -1, np.int32)
        found[hidden] = occluder.first_hits(at[None], points.positions[hidden] - at).face_ids
    return found


def occlusion_graph(
    scene: Scene, eye: ArrayLike, *, n_points: int = 10_000, seed: Seed = 0, method: str = "exact", **options: Any
) -> OcclusionGraph:
    """Estimate which object of a scene hides which, and how much of it.

    Parameters
    ----------
    scene : Scene
    eye : (3,) float
        World space.
    n_points : int
        Points on each object's surface.
    seed : int
    method : str
        A name of the table of methods that casts rays. Of an exact one the shares have the sampling's error alone.
    **options
        The method's own.

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
            with prepare(alone, method, **options) as occluder:
                seen = points.positions[occluder.visible(points, at)]
            hits = whole.first_hits(at[None], seen - at)
            before = hits.distances < np.linalg.norm(seen - at, axis=1) - CONTACT * scene.mesh.diagonal
            others = np.bincount(scene.instances[hits.face_ids[before]], minlength=n_objects)
            if len(seen):
                shares[number], error[number] = others / len(seen), error_of_share(others, len(seen))
    np.fill_diagonal(shares, 0.0)
    np.fill_diagonal(error, 0.0)
    return OcclusionGraph(scene.labels, shares, error)
