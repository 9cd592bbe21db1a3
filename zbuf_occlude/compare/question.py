"""The question that is put to every subject: one mesh, its points, the eyes; and a fingerprint to know it by."""

import hashlib
import json
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.sampling import SurfacePoints, sample_surface
from zbuf_occlude.seeds import seed_of
from zbuf_occlude.views import Views

MOST_VIEWS = 15
"""This many views are asked by default: every 7th of the paper's 100."""


@dataclass(frozen=True, eq=False)
class Question:
    """Points of a mesh in random order, and the eyes that are to see them.

    Parameters
    ----------
    key : str
        The mesh's, unique within a comparison.
    mesh : Mesh
        World space.
    points : SurfacePoints
        n points; the first few are as good a sample as any, so a shorter question takes those.
    views : Views
        k views about the mesh, world units.
    """

    key: str
    mesh: Mesh
    points: SurfacePoints
    views: Views

    @cached_property
    def fingerprint(self) -> str:
        """A hash of all that is asked; equal questions have equal answers."""
        digest = hashlib.sha256()
        for array in (
            self.mesh.vertices,
            self.mesh.faces,
            self.points.positions,
            self.points.face_ids,
            self.views.eyes,
        ):
            digest.update(f"{array.shape}{array.dtype}".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()[:16]

    def describe(self) -> dict[str, Any]:
        """Return what a row says of the question."""
        return {
            "question": self.fingerprint,
            "mesh": {
                "key": self.key,
                "faces": len(self.mesh.faces),
                "vertices": len(self.mesh.vertices),
                "dropped": dict(self.mesh.dropped),
            },
            "n_points": len(self.points),
        }


def ask(key: str, mesh: Mesh, views: Views, *, n_points: int, seed: int, most_views: int = MOST_VIEWS) -> Question:
    """Put the question: sample the mesh, place the views about it.

    Parameters
    ----------
    key : str
        Decides the sampling together with `seed`.
    mesh : Mesh
        Any size.
    views : Views
        Distances in longest sides, about the origin. At most `most_views` of them are asked, evenly spread.
    n_points : int
    seed : int
    most_views : int
    """
    rng = np.random.default_rng(seed_of(seed, key))
    points = sample_surface(mesh, n_points=n_points, seed=rng)
    points = points.select(rng.permutation(len(points)))
    return Question(key, mesh, points, thinned(views, most_views).around(mesh.centre, mesh.longest_side))


def ask_vertices(key: str, mesh: Mesh, views: Views, *, most_views: int = MOST_VIEWS) -> Question:
    """Ask for the mesh's vertices instead of samples, as the paper's Table 1A does; they have no face of their own."""
    points = SurfacePoints.free(mesh.vertices[np.unique(mesh.faces)])
    return Question(key, mesh, points, thinned(views, most_views).around(mesh.centre, mesh.longest_side))


def thinned(views: Views, most: int) -> Views:
    """Return every m-th view, so that at most `most` are left."""
    return views.select(np.arange(0, len(views), -(-len(views) // most)))


def row_key(question: Question, method: str, options: dict[str, Any], suite: str) -> str:
    """Return what a row is known by: the same suite, question, method and options have the same key."""
    text = json.dumps([suite, question.fingerprint, method, options], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]
