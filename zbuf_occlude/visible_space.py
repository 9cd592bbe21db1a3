"""Visible space and occlusion: voxel grids, the faces that hide points, the objects of a scene that hide each other."""

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
from zbuf_occlude.visibility.interface import CONTACT, MAX_DIAGONALS, as_eyes

MAX_VOXELS = 2**27
"""Maximum voxels of a grid for all eyes together: with the centres 3.7 GB."""
MARGIN = 0.05
"""Margin of a grid around the mesh on each side, in longest sides."""
HIDDEN, FREE, SURFACE = 0, 1, 2
"""States of a voxel in `VisibilityGrid.states`."""


@dataclass(frozen=True, eq=False)
class VisibilityGrid:
    """Visibility of a cube of n x n x n voxels around a mesh, decided at the voxels' centres.

    Parameters
    ----------
    low : (3,) float
        Lowest corner of the cube, world space.
    step : float
        Side of a voxel.
    distances : (k, n, n, n) float32
        Distance from the voxel's centre to the first surface along each eye's line of sight, world units. Positive in
        front of the surface, negative behind it, infinite if the line meets nothing. Clipped to a few voxels it is the
        projective TSDF of a depth image of unlimited resolution.
    """

    low: FloatArray
    step: float
    distances: NDArray[np.float32]

    def __repr__(self) -> str:
        return f"VisibilityGrid({len(self.free)}^3 voxels of {self.step:.4g}, {self.free.mean():.1%} free)"

    @property
    def centres(self) -> FloatArray:
        """Centres of the voxels, world space, (n, n, n, 3)."""
        offsets = (np.arange(self.distances.shape[1]) + 0.5) * self.step
        return np.stack(np.meshgrid(*(self.low + offsets[:, None]).T, indexing="ij"), axis=-1)

    @property
    def free(self) -> BoolArray:
        """True for voxels whose centre at least one eye sees, (n, n, n)."""
        return np.asarray((self.distances > 0.0).any(axis=0))

    @property
    def states(self) -> NDArray[np.uint8]:
        """`SURFACE` within half a voxel's diagonal of a visible surface, else `FREE` or `HIDDEN`, (n, n, n)."""
        near = (np.abs(self.distances) <= self.step * np.sqrt(3.0) / 2.0).any(axis=0)
        return np.where(near, SURFACE, np.where(self.free, FREE, HIDDEN)).astype(np.uint8)

    def tsdf(self, truncation: float) -> NDArray[np.float32]:
        """Fuse the eyes' distances, truncated at `truncation` world units, (n, n, n).

        The value is the mean over the eyes for which the centre is not farther than `truncation` behind the surface,
        or -`truncation` if there is none.
        """
        want = "a length above 0, in the mesh's unit"
        truncation = as_number(truncation, "truncation", want, lambda length: 0.0 < length < MAX_DIAGONALS)
        known = self.distances > -truncation
        total = np.where(known, np.minimum(self.distances, truncation), 0.0).sum(axis=0)
        return np.where(known.any(axis=0), total / np.maximum(known.sum(axis=0), 1), -truncation).astype(np.float32)


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


def visibility_grid(
    mesh: MeshLike, eyes: ArrayLike, n: int = 64, *, method: str = "exact", **options: Any
) -> VisibilityGrid:
    """Compute which voxels around a mesh eyes see, and their distances before or behind the surface.

    Parameters
    ----------
    mesh : Mesh
        Or any other mesh (`as_mesh`).
    eyes : (3,) or (k, 3) float
        World space.
    n : int
        Voxels along a side of the cube, which is a tenth larger than the mesh's longest side.
    method : str
        Name of a method that casts rays; `exact` decides each centre without error.
    **options
        Options of the method.

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
    eyes = as_eyes(eyes)
    if (n_voxels := int(n) ** 3 * max(len(eyes), 1)) > MAX_VOXELS:
        raise OptionError(
            f"a grid must have at most {MAX_VOXELS:,} voxels for all eyes together; {len(eyes)} of {n} along a side "
            f"have {n_voxels:,}. Lower n."
        )
    side = mesh.longest_side * (1.0 + 2.0 * MARGIN)
    if side == 0.0:
        raise ArgumentError(f"All vertices of {mesh.name} coincide, so there is no grid around it.")
    grid = VisibilityGrid(mesh.centre - side / 2.0, side / n, np.empty((len(eyes), n, n, n), np.float32))
    centres = grid.centres.reshape(-1, 3)
    with prepare(mesh, method, **options) as query:
        for eye, distances in zip(eyes, grid.distances, strict=True):
            away = np.linalg.norm(centres - eye, axis=1)
            if not away.all():
                raise ArgumentError("An eye lies at the centre of a voxel. Move it a little.")
            distances[:] = (query.first_hits(eye[None], centres - eye).distances - away).reshape(n, n, n)
    return grid


def blockers(
    mesh: MeshLike, points: SurfacePoints, eye: ArrayLike, *, method: str = "exact", **options: Any
) -> IntArray:
    """Return for each point the face nearest to the eye that hides it, (n,) int32; -1 for visible points.

    For a `Scene` pass its mesh; ``scene.instances[faces]`` are the objects.

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
    with prepare(mesh, method, **options) as query:
        hidden = np.flatnonzero(~query.visible(points, at))
        found = np.full(len(points), -1, np.int32)
        found[hidden] = query.first_hits(at[None], points.positions[hidden] - at).face_ids
    return found


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
