"""Ray casting in scenes with objects that move during a scan and faces that let light pass."""

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.sensors.motion import Motion
from zbuf_occlude.sensors.scenes.scene import Placed, Scene
from zbuf_occlude.visibility import prepare
from zbuf_occlude.visibility.interface import CONTACT, FirstHits, VisibilityQuery

MAX_PANES = 32
"""Maximum transparent faces of one object along a ray; those behind are not met."""


def prepare_scene(scene: Scene, method: str, **options: Any) -> VisibilityQuery:
    """Prepare a scene for `scan`: as one mesh where nothing moves or lets light pass, else as a `DynamicScene`.

    Raises
    ------
    OptionError, UnavailableError, GlError
        As `zbuf_occlude.prepare`.
    """
    if not scene.is_opaque_and_static:
        return DynamicScene(scene, method, **options)
    return prepare(scene.mesh, method, warn=False, **options)


class _RigidGroup(NamedTuple):
    """Faces of a scene that move together, all transparent or all opaque."""

    occluder: VisibilityQuery
    face_ids: NDArray[np.intp]  # of the scene's mesh, ascending
    mover: Placed | None  # object that they are of; None: they do not move
    is_pane: bool  # True where they let light pass


class DynamicScene(VisibilityQuery):
    """A scene queried in groups: each moving object in its own frame, and transparent faces apart from opaque ones.

    For an object that moved since time 0, the ray is moved back instead and meets the object at time 0. Behind a
    transparent face the ray is cast again. Hits are therefore as exact as the method's.
    """

    def __init__(self, scene: Scene, method: str, **options: Any) -> None:
        super().__init__(scene.mesh)
        self._prepare: Callable[[Mesh], VisibilityQuery] = lambda mesh: prepare(mesh, method, warn=False, **options)
        owners = np.where(np.isin(scene.instances, list(scene.moving)), scene.instances, -1)
        panes = np.zeros(len(owners), dtype=bool) if scene.transmittance is None else scene.transmittance > 0.0
        self._solid = np.flatnonzero(~panes)
        self._groups = [
            self._group(np.flatnonzero((owners == owner) & (panes == is_pane)), scene.moving.get(owner), is_pane)
            for owner, is_pane in sorted(set(zip(owners.tolist(), panes.tolist(), strict=True)))
        ]
        self.renderer = self._groups[0].occluder.renderer

    def _group(self, which: NDArray[np.intp], mover: Placed | None, is_pane: bool) -> _RigidGroup:
        mesh = Mesh(self.mesh.vertices, self.mesh.faces[which], self.mesh.name)
        return _RigidGroup(self._prepare(mesh), which, mover, is_pane)

    @cached_property
    def _at_start(self) -> _RigidGroup:
        return self._group(self._solid, None, False)

    def _visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        """Return the visibility at time 0; transparent faces hide nothing."""
        if not len(self._solid):
            return np.ones((len(eyes), len(points)), dtype=bool)
        numbers = np.full(len(self.mesh.faces) + 1, -1, np.int32)  # the last is of free points
        numbers[self._solid] = np.arange(len(self._solid))
        mine = SurfacePoints(points.positions, numbers[points.face_ids], points.normals)
        return self._at_start.occluder.visible(mine, eyes)

    def _first_hits(self, origins: FloatArray, directions: FloatArray) -> FirstHits:
        """Return the first hits at time 0, transparent faces included."""
        face_ids, distances = self.layers(origins, directions, np.zeros(len(directions)))
        return FirstHits(face_ids[:, 0], distances[:, 0])

    def layers(self, origins: FloatArray, directions: FloatArray, times: FloatArray) -> FirstHits:
        """Return the hits (n, l) of n rays cast at times (n,), seconds: in order, up to the first opaque face."""
        face_ids, distances = np.full(len(directions), -1, np.int32), np.full(len(directions), np.inf)
        for group in self._groups:
            if not group.is_pane:
                ids, away = _hits(group, *_in_frame_of(group.mover, times, origins, directions))
                nearer = (away < distances) | ((away == distances) & (ids < face_ids))
                face_ids[nearer], distances[nearer] = ids[nearer], away[nearer]
        found = [FirstHits(face_ids, distances)]
        for group in self._groups:
            if group.is_pane:
                found += _pane_hits(group, *_in_frame_of(group.mover, times, origins, directions), distances)
        order = np.argsort(np.stack([each.distances for each in found], axis=1), axis=1, kind="stable")
        return FirstHits._make(
            np.take_along_axis(np.stack(each, axis=1), order, axis=1) for each in zip(*found, strict=True)
        )

    def _release(self) -> None:
        for group in self._groups:
            group.occluder.close()
        if "_at_start" in vars(self):
            self._at_start.occluder.close()


def cast(occluder: VisibilityQuery, origins: FloatArray, directions: FloatArray, times: FloatArray | None) -> FirstHits:
    """Return the hits (n, l) of n rays in what `prepare_scene` returned: in order, up to the first opaque face.

    `times` (n,) are seconds; None: all rays are cast at time 0. Rays with fewer hits are padded with -1 and infinity.
    """
    if isinstance(occluder, DynamicScene):
        return occluder.layers(origins, directions, np.zeros(len(directions)) if times is None else times)
    face_ids, distances = occluder.first_hits(origins, directions)
    return FirstHits(face_ids[:, None], distances[:, None])


def _hits(group: _RigidGroup, origins: FloatArray, directions: FloatArray) -> FirstHits:
    """Return the first hits in a group, with the scene's face numbers."""
    face_ids, distances = group.occluder.first_hits(origins, directions)
    return FirstHits(np.where(face_ids >= 0, group.face_ids[face_ids], -1).astype(np.int32), distances)


def _pane_hits(group: _RigidGroup, origins: FloatArray, directions: FloatArray, ends: FloatArray) -> list[FirstHits]:
    """Return the hits of n rays in a transparent group before their ends (n,), layer by layer, (n,) each.

    Faces nearer to each other along the ray than the contact tolerance count as one.
    """
    found, at, behind = list[FirstHits](), np.arange(len(directions)), np.zeros(len(directions))
    apart = CONTACT * group.occluder.mesh.diagonal
    units = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    for _ in range(MAX_PANES):
        starts = origins if not found else origins[at if len(origins) > 1 else [0]] + behind[:, None] * units[at]
        face_ids, distances = _hits(group, starts, directions[at])
        distances = distances + behind
        met = distances < ends[at]
        if not met.any():
            break
        at, behind = at[met], distances[met] + apart
        found.append(FirstHits(np.full(len(directions), -1, np.int32), np.full(len(directions), np.inf)))
        found[-1].face_ids[at], found[-1].distances[at] = face_ids[met], distances[met]
    return found


def _in_frame_of(
    mover: Placed | None, times: FloatArray, origins: FloatArray, directions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return rays (n, 3) cast at times (n,), moved back as far as `mover` has moved since time 0."""
    if mover is None:
        return origins, directions
    about = mover.pose[:3, 3]
    rotations, positions = Motion(mover.velocity, mover.turn).poses(times)
    starts = np.einsum("nji,nj->ni", rotations, origins - about - positions) + about
    return starts, np.einsum("nji,nj->ni", rotations, directions)


def placed_at(placed: Placed, time: float) -> Placed:
    """Return an object as it is at a time, seconds: its pose then, and the velocity that it has then."""
    rotations, positions = Motion(placed.velocity, placed.turn).poses(np.array([time]))
    pose = placed.pose.copy()
    pose[:3] = np.column_stack([rotations[0] @ pose[:3, :3], pose[:3, 3] + positions[0]])
    return replace(placed, pose=pose, velocity=rotations[0] @ placed.velocity)


def normals_at(scene: Scene, instances: IntArray, times: FloatArray, normals: FloatArray) -> FloatArray:
    """Return the normals (n, 3) of faces at times (n,), given those at time 0 and the objects `instances` (n,)."""
    for number, mover in scene.moving.items():
        mine = np.flatnonzero(instances == number)
        rotations, _ = Motion(turn=mover.turn).poses(times[mine])
        normals[mine] = np.einsum("nij,nj->ni", rotations, normals[mine])
    return normals
