"""A scene made ready for rays: objects that move while rays are cast one after the other, faces that let light pass."""

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
from zbuf_occlude.visibility.interface import CONTACT, FirstHits, VisibilityQuery

MOST_PANES = 32
"""Of an object, so many one behind the other let light pass; the next are not met."""


def prepare_scene(scene: Scene, method: str, **options: Any) -> VisibilityQuery:
    """Make a scene ready for `scan`: as its mesh is where all stands still and is opaque, else in parts.

    Raises
    ------
    OptionError, UnavailableError, GlError
        As `zbuf_occlude.prepare`.
    """
    if not scene.is_opaque_and_static:
        return DynamicScene(scene, method, **options)
    return prepare(scene.mesh, method, warn=False, **options)


class _Part(NamedTuple):
    """Faces of a scene that keep their places to each other."""

    occluder: VisibilityQuery
    face_ids: NDArray[np.intp]  # of the scene's mesh, ascending
    drive: Placed | None  # how they move
    is_pane: bool  # whether they let light pass


class DynamicScene(VisibilityQuery):
    """A scene asked in parts: each object that moves by itself, in its own frame; faces that let light pass too.

    A ray that is cast at some time meets an object that has moved since time 0 where the ray, moved back likewise,
    meets it at time 0. Beyond a face that lets light pass a ray is asked again. So hits are as exact as the method's.
    """

    def __init__(self, scene: Scene, method: str, **options: Any) -> None:
        super().__init__(scene.mesh)
        self._prepare: Callable[[Mesh], VisibilityQuery] = lambda mesh: prepare(mesh, method, warn=False, **options)
        owners = np.where(np.isin(scene.instances, list(scene.moving)), scene.instances, -1)
        panes = np.zeros(len(owners), dtype=bool) if scene.transmittance is None else scene.transmittance > 0.0
        self._solid = np.flatnonzero(~panes)
        self._parts = [
            self._part(np.flatnonzero((owners == owner) & (panes == is_pane)), scene.moving.get(owner), is_pane)
            for owner, is_pane in sorted(set(zip(owners.tolist(), panes.tolist(), strict=True)))
        ]
        self.renderer = self._parts[0].occluder.renderer

    def _part(self, which: NDArray[np.intp], drive: Placed | None, is_pane: bool) -> _Part:
        mesh = Mesh(self.mesh.vertices, self.mesh.faces[which], self.mesh.name)
        return _Part(self._prepare(mesh), which, drive, is_pane)

    @cached_property
    def _at_start(self) -> _Part:
        return self._part(self._solid, None, False)

    def _visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        """Answer as at time 0; faces that let light pass hide nothing."""
        if not len(self._solid):
            return np.ones((len(eyes), len(points)), dtype=bool)
        numbers = np.full(len(self.mesh.faces) + 1, -1, np.int32)  # the last is of free points
        numbers[self._solid] = np.arange(len(self._solid))
        mine = SurfacePoints(points.positions, numbers[points.face_ids], points.normals)
        return self._at_start.occluder.visible(mine, eyes)

    def _first_hits(self, origins: FloatArray, directions: FloatArray) -> FirstHits:
        """Answer as at time 0, faces that let light pass included."""
        face_ids, distances = self.layers(origins, directions, np.zeros(len(directions)))
        return FirstHits(face_ids[:, 0], distances[:, 0])

    def layers(self, origins: FloatArray, directions: FloatArray, times: FloatArray) -> FirstHits:
        """Return what n rays that are cast at some times (n,), seconds, meet up to an opaque face: (n, l), in order."""
        face_ids, distances = np.full(len(directions), -1, np.int32), np.full(len(directions), np.inf)
        for part in self._parts:
            if not part.is_pane:
                ids, away = _hits(part, *_seen_by(part.drive, times, origins, directions))
                nearer = (away < distances) | ((away == distances) & (ids < face_ids))
                face_ids[nearer], distances[nearer] = ids[nearer], away[nearer]
        found = [FirstHits(face_ids, distances)]
        for part in self._parts:
            if part.is_pane:
                found += _panes(part, *_seen_by(part.drive, times, origins, directions), distances)
        order = np.argsort(np.stack([each.distances for each in found], axis=1), axis=1, kind="stable")
        return FirstHits._make(
            np.take_along_axis(np.stack(each, axis=1), order, axis=1) for each in zip(*found, strict=True)
        )

    def _release(self) -> None:
        for part in self._parts:
            part.occluder.close()
        if "_at_start" in vars(self):
            self._at_start.occluder.close()


def cast(occluder: VisibilityQuery, origins: FloatArray, directions: FloatArray, times: FloatArray | None) -> FirstHits:
    """Return what n rays meet of what `prepare_scene` returned, (n, l): each face until an opaque one ends the ray.

    `times` (n,) are seconds; None: all are cast at once. Where there are fewer, -1 and infinity follow.
    """
    if isinstance(occluder, DynamicScene):
        return occluder.layers(origins, directions, np.zeros(len(directions)) if times is None else times)
    face_ids, distances = occluder.first_hits(origins, directions)
    return FirstHits(face_ids[:, None], distances[:, None])


def _hits(part: _Part, origins: FloatArray, directions: FloatArray) -> FirstHits:
    """Return the first hits of a part, its faces numbered as in the scene."""
    face_ids, distances = part.occluder.first_hits(origins, directions)
    return FirstHits(np.where(face_ids >= 0, part.face_ids[face_ids], -1).astype(np.int32), distances)


def _panes(part: _Part, origins: FloatArray, directions: FloatArray, ends: FloatArray) -> list[FirstHits]:
    """Return what n rays meet of a part before their ends (n,), one layer (n,) after the other.

    Faces nearer behind each other than the contact tolerance count as one.
    """
    found, at, behind = list[FirstHits](), np.arange(len(directions)), np.zeros(len(directions))
    apart = CONTACT * part.occluder.mesh.diagonal
    units = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    for _ in range(MOST_PANES):
        starts = origins if not found else origins[at if len(origins) > 1 else [0]] + behind[:, None] * units[at]
        face_ids, distances = _hits(part, starts, directions[at])
        distances = distances + behind
        met = distances < ends[at]
        if not met.any():
            break
        at, behind = at[met], distances[met] + apart
        found.append(FirstHits(np.full(len(directions), -1, np.int32), np.full(len(directions), np.inf)))
        found[-1].face_ids[at], found[-1].distances[at] = face_ids[met], distances[met]
    return found


def _seen_by(
    drive: Placed | None, times: FloatArray, origins: FloatArray, directions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return rays (n, 3) of some times (n,) as an object sees them that takes itself for standing where it was at 0."""
    if drive is None:
        return origins, directions
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
