"""A scene made ready for rays that are cast one after the other, while some of its objects move."""

from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.sampling import SurfacePoints
from zbuf_occlude.scenes.scene import Placed, Scene
from zbuf_occlude.sensors.motion import Motion
from zbuf_occlude.visibility import prepare
from zbuf_occlude.visibility.interface import FirstHits, Occluder


def prepare_scene(scene: Scene, method: str, **options: Any) -> Occluder:
    """Make a scene ready for `scan`: as its mesh is where all stands still, else in parts.

    Raises
    ------
    OptionError, UnavailableError, GlError
        As `zbuf_occlude.prepare`.
    """
    return SceneInParts(scene, method, **options) if scene.moving else prepare(scene.mesh, method, **options)


class _Part(NamedTuple):
    """Faces of a scene that keep their places to each other."""

    occluder: Occluder
    face_ids: NDArray[np.intp]  # of the scene's mesh, ascending
    drive: Placed | None  # how they move


class SceneInParts(Occluder):
    """A scene of which each object that moves is asked by itself, and in its own frame.

    A ray that is cast at some time meets an object that has moved since time 0 where the ray, moved back likewise,
    meets it at time 0. So hits are as exact as the method's.
    """

    def __init__(self, scene: Scene, method: str, **options: Any) -> None:
        super().__init__(scene.mesh)
        self._prepare: Callable[[Mesh], Occluder] = lambda mesh: prepare(mesh, method, **options)
        owners = np.where(np.isin(scene.instances, list(scene.moving)), scene.instances, -1)
        self._parts = [self._part(owners == owner, scene.moving.get(int(owner))) for owner in np.unique(owners)]

    def _part(self, which: BoolArray, drive: Placed | None = None) -> _Part:
        mesh = Mesh(self.mesh.vertices, self.mesh.faces[which], self.mesh.name)
        return _Part(self._prepare(mesh), np.flatnonzero(which), drive)

    @property
    def renderer(self) -> str:
        """As the method's."""
        return self._parts[0].occluder.renderer

    @cached_property
    def _at_start(self) -> Occluder:
        return self._prepare(self.mesh)

    def _visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        """Answer as at time 0."""
        return self._at_start.visible(points, eyes)

    def _first_hits(self, origins: FloatArray, directions: FloatArray) -> FirstHits:
        """Answer as at time 0."""
        return self.hits_at(origins, directions, np.zeros(len(directions)))

    def hits_at(self, origins: FloatArray, directions: FloatArray, times: FloatArray) -> FirstHits:
        """Return what n rays meet first that are cast at some times (n,), seconds; else as `first_hits`."""
        face_ids, distances = np.full(len(directions), -1, np.int32), np.full(len(directions), np.inf)
        for part in self._parts:
            rays = (origins, directions) if part.drive is None else moved_back(part.drive, times, origins, directions)
            ids, away = part.occluder.first_hits(*rays)
            ids = np.where(ids >= 0, part.face_ids[ids], -1)
            nearer = (away < distances) | ((away == distances) & (ids < face_ids))
            face_ids[nearer], distances[nearer] = ids[nearer], away[nearer]
        return FirstHits(face_ids, distances)

    def _release(self) -> None:
        for part in self._parts:
            part.occluder.close()
        if "_at_start" in vars(self):
            self._at_start.close()


def cast(occluder: Occluder, origins: FloatArray, directions: FloatArray, times: FloatArray | None) -> FirstHits:
    """Return what rays meet first of what `prepare_scene` returned; `times` (n,) are seconds, None all at once."""
    if times is None or not isinstance(occluder, SceneInParts):
        return occluder.first_hits(origins, directions)
    return occluder.hits_at(origins, directions, times)


def moved_back(
    drive: Placed, times: FloatArray, origins: FloatArray, directions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return rays (n, 3) of some times (n,) as an object sees them that takes itself for standing where it was at 0."""
    about = drive.pose[:3, 3]
    rotations, places = Motion(drive.velocity, drive.turn).poses(times)
    starts = np.einsum("nji,nj->ni", rotations, origins - about - places) + about
    return starts, np.einsum("nji,nj->ni", rotations, directions)


def turned_with(scene: Scene, instances: IntArray, times: FloatArray, normals: FloatArray) -> FloatArray:
    """Return normals (n, 3) of a scene's faces as they are at some times (n,), each of an object of `instances`."""
    for number, drive in scene.moving.items():
        mine = np.flatnonzero(instances == number)
        rotations, _ = Motion(turn=drive.turn).poses(times[mine])
        normals[mine] = np.einsum("nij,nj->ni", rotations, normals[mine])
    return normals
