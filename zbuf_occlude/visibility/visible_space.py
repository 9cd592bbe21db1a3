"""Visible space: voxel grids, and the faces that hide points."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.base.arrays import BoolArray, FloatArray, IntArray, as_number, as_numbers
from zbuf_occlude.base.errors import ArgumentError, OptionError, check_int
from zbuf_occlude.meshes.conversion import MeshLike, as_mesh
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.visibility import prepare
from zbuf_occlude.visibility.interface import MAX_DIAGONALS, as_eyes

MAX_VOXELS = 2**27
"""Maximum voxels of a grid for all eyes together: with the centres 3.7 GB."""
SHORTEST_SIDE, LONGEST_SIDE = 1e-30, 1e30
"""Bounds of a grid's side, within which distances of float32 neither underflow nor overflow."""
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
        truncation = as_number(truncation, "truncation", want, lambda length: 0.0 < length / self.step < MAX_DIAGONALS)
        known = self.distances > -truncation
        total = np.where(known, np.minimum(self.distances, truncation), 0.0).sum(axis=0)
        return np.where(known.any(axis=0), total / np.maximum(known.sum(axis=0), 1), -truncation).astype(np.float32)


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
    if not SHORTEST_SIDE < side < LONGEST_SIDE:
        raise ArgumentError(
            f"the grid's side must be between {SHORTEST_SIDE:g} and {LONGEST_SIDE:g}, as its distances are float32; "
            f"it is {side:g}. Scale the mesh."
        )
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
