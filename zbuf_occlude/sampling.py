"""Random points on a mesh's surface: Algorithms 1 and 2 of the paper (section 3.4)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.arrays import FloatArray, IntArray, as_indices, as_vectors, frozen
from zbuf_occlude.errors import ArgumentError
from zbuf_occlude.mesh import Mesh

MAX_POINTS = int(np.iinfo(np.int32).max)
"""Counts and ids are int32."""

Seed = int | np.random.SeedSequence | np.random.Generator


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points on a surface, each with the face it lies on. Immutable.

    Parameters
    ----------
    positions : (n, 3) float
        World space. Stored as float64.
    face_ids : (n,) int
        Index into ``mesh.faces`` of the point's own face, which never hides it; -1: none (a free point).
    normals : (n, 3) float
        Unit normal of the own face (sign as the face is wound, which carries no meaning); zero for a free point.

    Raises
    ------
    ArgumentError
        Wrong shapes, dtypes, lengths, or values that are not finite.
    """

    positions: FloatArray
    face_ids: IntArray
    normals: FloatArray

    def __post_init__(self) -> None:
        positions = as_vectors(self.positions, "positions")
        face_ids = as_indices(self.face_ids, "face_ids", columns=None, upper=np.iinfo(np.int32).max, lowest=-1)
        normals = as_vectors(self.normals, "normals")
        if not len(positions) == len(face_ids) == len(normals):
            raise ArgumentError(
                "positions, face_ids and normals must have one length; "
                f"got {len(positions)}, {len(face_ids)} and {len(normals)}."
            )
        object.__setattr__(self, "positions", frozen(positions))
        object.__setattr__(self, "face_ids", frozen(face_ids))
        object.__setattr__(self, "normals", frozen(normals))

    def __len__(self) -> int:
        return len(self.positions)

    def __repr__(self) -> str:
        return f"SurfacePoints({len(self)})"

    @classmethod
    def free(cls, positions: ArrayLike) -> "SurfacePoints":
        """Points that lie on no face: any face may hide them."""
        positions = as_vectors(positions, "positions")
        return cls(positions, np.full(len(positions), -1, dtype=np.int32), np.zeros_like(positions))

    def select(self, which: ArrayLike) -> "SurfacePoints":
        """Return the points that a boolean mask or an index array picks, in its order."""
        chosen = np.asarray(which)
        return SurfacePoints(self.positions[chosen], self.face_ids[chosen], self.normals[chosen])

    def transformed(self, scale: float = 1.0, translation: ArrayLike = (0.0, 0.0, 0.0)) -> "SurfacePoints":
        """Return the points moved to ``scale * p + translation``, with a mesh moved alike."""
        moved = self.positions * scale + np.asarray(translation, dtype=np.float64)
        return SurfacePoints(moved, self.face_ids, self.normals)


def sample_surface(
    mesh: Mesh, *, n_points: int | None = None, density: float | None = None, seed: Seed = 0
) -> SurfacePoints:
    """Sample points uniformly over a mesh's surface.

    Parameters
    ----------
    mesh : Mesh
    n_points : int, optional
        Exactly so many points: each falls on a face with probability proportional to its area.
    density : float, optional
        Points per unit of area: the paper's Algorithm 1, whose total is random.
        Give exactly one of `n_points` and `density`.
    seed : int, SeedSequence or Generator
        The same seed gives the same points, byte for byte.

    Returns
    -------
    SurfacePoints
        Ordered by face. World space, float64.

    Raises
    ------
    ArgumentError
        Neither or both of `n_points` and `density`; a value out of range; a mesh without area.

    References
    ----------
    Paper section 3.4, Algorithms 1 and 2. Departures: Algorithm 2's v1 and v2 are the *consecutive* edges b - a and
    c - b (with Eq. 1's v2 = c - a half of the points would fall outside the triangle); the exact count `n_points`
    is ours (a multinomial draw instead of Algorithm 1's stochastic rounding).
    """
    if (n_points is None) == (density is None):
        raise ArgumentError(f"give exactly one of n_points and density; got n_points={n_points}, density={density}.")
    rng = np.random.default_rng(seed)
    if density is not None:
        counts = stochastic_counts(mesh.areas, density, rng)
    else:
        counts = exact_counts(mesh.areas, n_points or 0, rng)
    face_ids = np.repeat(np.arange(len(mesh.faces), dtype=np.int32), counts)
    positions = points_in_triangles(mesh.corners[face_ids], rng)
    lengths = np.linalg.norm(mesh.face_normals, axis=1, keepdims=True)
    unit_normals = np.divide(mesh.face_normals, lengths, out=np.zeros_like(mesh.face_normals), where=lengths > 0)
    return SurfacePoints(positions, face_ids, unit_normals[face_ids])


def stochastic_counts(areas: FloatArray, density: float, rng: np.random.Generator) -> IntArray:
    """Algorithm 1 for all faces: floor(A s), plus one with probability equal to the fraction left. (f,) int32."""
    if not (np.isfinite(density) and density > 0):
        raise ArgumentError(f"density must be positive and finite; got {density}.")
    wanted = areas * density
    if wanted.sum() > MAX_POINTS:
        raise ArgumentError(f"density {density} asks for {wanted.sum():.3g} points; at most 2^31 - 1 can be made.")
    whole = np.floor(wanted)
    return np.asarray(whole + (rng.random(len(areas)) < wanted - whole), dtype=np.int32)


def exact_counts(areas: FloatArray, n_points: int, rng: np.random.Generator) -> IntArray:
    """Draw how many of exactly `n_points` fall on each face, proportionally to area. (f,) int32."""
    if not isinstance(n_points, (int, np.integer)) or n_points < 1:
        raise ArgumentError(f"n_points must be a positive int; got {n_points!r}.")
    if n_points > MAX_POINTS:
        raise ArgumentError(f"n_points must be at most 2^31 - 1; got {n_points}.")
    total = areas.sum()
    if not total > 0:
        raise ArgumentError("a mesh must have area to be sampled; this one has none.")
    edges = np.cumsum(areas)
    # scaling by the last edge, not by the sum, keeps every draw inside the table
    drawn = np.searchsorted(edges, rng.random(n_points) * edges[-1], side="right")
    return np.bincount(np.minimum(drawn, len(areas) - 1), minlength=len(areas)).astype(np.int32)


def points_in_triangles(corners: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Algorithm 2 for all points at once: corners (n, 3, 3) -> one uniform point in each triangle, (n, 3)."""
    r1, r2 = rng.random((2, len(corners)))
    outside = r1 + r2 > 1.0
    r1 = np.where(outside, 1.0 - r1, r1)[:, None]
    r2 = np.where(outside, 1.0 - r2, r2)[:, None]
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    p1 = b - r1 * (b - a)
    return np.asarray(p1 + r2 * (c - b))
