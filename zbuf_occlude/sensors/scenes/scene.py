"""A scene: placed meshes, joined into one mesh, and the object of each face."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.base.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    as_array,
    as_flag,
    as_indices,
    as_number,
    as_numbers,
    as_vector,
    readonly_copy,
)
from zbuf_occlude.base.errors import ArgumentError, shown
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.conversion import MeshLike, as_mesh

ALBEDOS = (0.05, 0.8)
"""Range of the albedos drawn for objects (their logarithms are uniform): dark to light paint at the 905 nm of LiDARs,
assumed. A mesh has no paint or clothes of its own."""
TYPICAL_ALBEDO = 0.2
"""Albedo of objects for which none is drawn: the geometric mean of `ALBEDOS`."""


@dataclass(frozen=True, eq=False)
class Placed:
    """A mesh with its pose in a scene.

    Parameters
    ----------
    mesh : Mesh
    label : str
        Class of the object, or "ground", "pole"...
    pose : (4, 4) float
        Transform from the mesh's space to the world, metres; column vectors. It may scale. Default: the identity.
    albedo : float, optional
        Share of light that the surface reflects. None: unknown, and `Scene.joined` may draw one.
    velocity : (3,) float
        Metres per second along the world's axes at time 0, when the object is at its pose; it turns with the object.
    turn : float
        Yaw rate, degrees per second about the vertical line through the origin of the pose; positive to the left.
    is_background : bool
        True for the surroundings of a drawn scene: ground, room, wall, pole. They have no boxes and models.
    """

    mesh: Mesh
    label: str = "object"
    pose: FloatArray = field(default_factory=lambda: np.eye(4))
    albedo: float | None = None
    velocity: ArrayLike = (0.0, 0.0, 0.0)
    turn: float = 0.0
    is_background: bool = False

    def __post_init__(self) -> None:
        _check_label(self.label)
        if not isinstance(self.mesh, Mesh):
            raise ArgumentError(f"mesh of {self.label} must be a Mesh; got {type(self.mesh).__name__}. Load it first.")
        as_flag(self.is_background, f"is_background of {self.label}")
        pose = as_numbers(self.pose, f"pose of {self.label}", (4, 4))
        if not np.isfinite(pose).all() or not (pose[3] == [0, 0, 0, 1]).all():
            raise ArgumentError(f"pose of {self.label} must be (4, 4), finite, last row 0 0 0 1; got {pose.tolist()}.")
        albedo = self.albedo
        if albedo is not None:
            as_number(albedo, f"albedo of {self.label}", "a number in [0, 1]", lambda share: 0.0 <= share <= 1.0)
        velocity = as_vector(self.velocity, f"velocity of {self.label}")
        as_number(self.turn, f"turn of {self.label}", "a number, degrees a second")
        vars(self).update(pose=readonly_copy(pose), velocity=readonly_copy(velocity))

    @property
    def moves(self) -> bool:
        """True where the object has a velocity or a yaw rate."""
        return bool(np.any(self.velocity) or self.turn)

    @cached_property
    def vertices(self) -> FloatArray:
        """Vertices of the mesh, world space, (v, 3)."""
        return np.asarray(self.mesh.vertices @ self.pose[:3, :3].T + self.pose[:3, 3])

    @cached_property
    def centre(self) -> FloatArray:
        """Centre of a ball that contains the mesh, world space, (3,)."""
        return np.asarray(self.pose[:3, :3] @ self.mesh.centre + self.pose[:3, 3])

    @cached_property
    def radius(self) -> float:
        """Radius of a ball about `centre` that contains the mesh, metres."""
        return self.mesh.diagonal / 2.0 * float(np.linalg.norm(self.pose[:3, :3], ord=2)) * (1.0 + 1e-9)


@dataclass(frozen=True, eq=False)
class Scene:
    """Placed meshes as one mesh. Immutable.

    Parameters
    ----------
    mesh : Mesh
        World space, metres, z up; moving objects are at their pose at time 0.
    instances : (f,) int
        Number of each face's object; 0 is the target.
    labels : tuple of str
        Label of each object.
    albedos : (o,) float
        Albedo of each object.
    placed : tuple of Placed, optional
        The objects, where they are known.
    transmittance : (f,) float, optional
        Share of the light that each face lets pass (`SurfaceColors.transmittance`). Default: 0.
    scattering : (f,) float, optional
        Factor on the albedo of each face (`SurfaceColors.scattering`). Default: 1.

    Examples
    --------
    >>> car = zo.load_mesh("car.obj")
    >>> zo.Scene.joined([zo.scenes.Placed(car, "car"), zo.scenes.Placed(car, "car", zo.scenes.moved(to=(8, 0, 0)))])
    Scene(2 objects, 24 faces)
    """

    mesh: Mesh
    instances: IntArray
    labels: tuple[str, ...]
    albedos: FloatArray
    placed: tuple[Placed, ...] = ()
    transmittance: FloatArray | None = None
    scattering: FloatArray | None = None

    def __post_init__(self) -> None:
        instances = as_indices(self.instances, "instances", columns=None, upper=len(self.labels))
        if len(instances) != len(self.mesh.faces) or len(self.albedos) != len(self.labels):
            raise ArgumentError(
                f"instances must be one per face ({len(self.mesh.faces)}) and albedos one per label "
                f"({len(self.labels)}); got {len(instances)} and {len(self.albedos)}."
            )
        transmittance = self.transmittance
        if transmittance is not None and not (
            len(transmittance) == len(instances) and ((transmittance >= 0) & (transmittance <= 1)).all()
        ):
            raise ArgumentError(f"transmittance must be a share in [0, 1] per face ({len(instances)}); it is not.")
        transmittance = None if transmittance is None or not transmittance.any() else readonly_copy(transmittance)
        scattering = self.scattering
        if scattering is not None:
            scattering = as_numbers(scattering, "scattering", (len(instances),))
            if not ((scattering >= 0) & (scattering <= 1)).all():
                raise ArgumentError("scattering must be a factor in [0, 1] per face; it is not.")
            scattering = None if (scattering == 1.0).all() else readonly_copy(scattering)
        vars(self).update(instances=readonly_copy(instances), transmittance=transmittance, scattering=scattering)

    def __repr__(self) -> str:
        return f"Scene({len(self.labels)} objects, {len(self.mesh.faces)} faces)"

    @classmethod
    def from_mesh(cls, mesh: MeshLike, label: str = "object") -> "Scene":
        """Return the scene of a single mesh, in metres, or of anything that is a mesh (`as_mesh`).

        Raises
        ------
        ArgumentError, MeshError
            As `as_mesh`; a label that is no text.
        """
        mesh = as_mesh(mesh)
        _check_label(label)
        instances, albedos = np.zeros(len(mesh.faces), np.int32), np.full(1, TYPICAL_ALBEDO)
        return cls(mesh, instances, (label,), albedos, (), _transmittance([mesh]), _scattering([mesh]))

    @classmethod
    def joined(
        cls, placed: Sequence[Placed], which: BoolArray | None = None, rng: np.random.Generator | None = None
    ) -> "Scene":
        """Return the scene of placed meshes.

        Parameters
        ----------
        placed : sequence of Placed
        which : (o,) bool, optional
            True for the objects to include. Objects keep their numbers.
        rng : Generator, optional
            Source of the albedos of objects without one (`draw_albedos`). Default: `TYPICAL_ALBEDO`.

        Raises
        ------
        ArgumentError
            No mesh.
        """
        taken = [i for i in range(len(placed)) if which is None or which[i]]
        if not taken:
            raise ArgumentError("a scene must have at least one mesh; got none. Place one.")
        firsts = np.cumsum([0] + [len(placed[i].mesh.vertices) for i in taken])
        mesh = Mesh(
            np.concatenate([placed[i].vertices for i in taken]),
            np.concatenate([placed[i].mesh.faces + first for i, first in zip(taken, firsts, strict=False)]),
            "scene",
        )
        instances = np.repeat(taken, [len(placed[i].mesh.faces) for i in taken])
        drawn = np.full(len(placed), TYPICAL_ALBEDO) if rng is None else draw_albedos(rng, len(placed))
        albedos = [drawn[i] if p.albedo is None else p.albedo for i, p in enumerate(placed)]
        light = [of_faces([placed[i].mesh for i in taken]) for of_faces in (_transmittance, _scattering)]
        return cls(mesh, instances, tuple(p.label for p in placed), np.array(albedos), tuple(placed), *light)

    @cached_property
    def moving(self) -> dict[int, Placed]:
        """The objects that move, by number."""
        return {i: each for i, each in enumerate(self.placed) if each.moves and (self.instances == i).any()}

    @property
    def is_opaque_and_static(self) -> bool:
        """True where nothing moves or lets light pass."""
        return not self.moving and self.transmittance is None


def _check_label(label: str) -> None:
    if not isinstance(label, str):
        raise ArgumentError(f"a label must be a word; got {shown(label)}.")


def _transmittance(meshes: Sequence[Mesh]) -> FloatArray:
    return np.concatenate([np.zeros(len(m.faces)) if m.colors is None else m.colors.transmittance for m in meshes])


def _scattering(meshes: Sequence[Mesh]) -> FloatArray:
    return np.concatenate([np.ones(len(m.faces)) if m.colors is None else m.colors.scattering for m in meshes])


def moved(*, scale: ArrayLike = 1.0, yaw: float = 0.0, to: ArrayLike = (0.0, 0.0, 0.0)) -> FloatArray:
    """Return the pose (4, 4) that scales (one factor, or one per axis), turns about z by `yaw` degrees, and moves.

    Examples
    --------
    >>> zo.scenes.moved(scale=2.0, to=(5, 0, 0))[0].tolist()
    [2.0, -0.0, 0.0, 5.0]
    """
    angle = float(np.radians(as_numbers(yaw, "yaw", ())))
    factors = as_array(scale, "scale", "a number or (3,)")
    return upright_pose(angle, as_vector(to, "to"), as_numbers(factors, "scale", (3,) if factors.ndim else ()))


def upright_pose(angle: float, to: ArrayLike = (0.0, 0.0, 0.0), scale: ArrayLike = 1.0) -> FloatArray:
    """Return the pose (4, 4) of `moved`, by an angle in radians."""
    cos, sin = np.cos(angle), np.sin(angle)
    pose = np.eye(4)
    pose[:3, :3] = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]) * np.asarray(scale, dtype=np.float64)
    pose[:3, 3] = to
    return pose


def draw_albedos(rng: np.random.Generator, n: int) -> FloatArray:
    """Draw albedos (n,), their logarithms uniform over `ALBEDOS`."""
    low, high = ALBEDOS
    return np.asarray(low * (high / low) ** rng.random(n))
