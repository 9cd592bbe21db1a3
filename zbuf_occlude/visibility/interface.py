"""Interface of all methods: prepared for one mesh, a query answers what eyes see and what rays meet first."""

import inspect
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any, NamedTuple, Self, final

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.base.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    as_array,
    as_triples,
    as_vectors,
    rescale_directions,
)
from zbuf_occlude.base.errors import ArgumentError, OptionError, UnavailableError, did_you_mean, shown
from zbuf_occlude.base.extras import EXTRAS, importing, missing
from zbuf_occlude.geometry.far_faces import FarFaces, far_faces
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.views import Views

CONTACT = 1e-5
"""Default contact tolerance tau, as a fraction of the bounding box's diagonal (docs/conventions.md)."""

_KINDS: dict[str, Any] = {"True or False": bool, "a word": str, "a number": (int, float, np.integer, np.floating)}
"""Option types. `bool` precedes `int` because it is a subclass of it."""

MAX_DIAGONALS = 1e15
"""Largest accepted distance of points and eyes from the mesh, in mesh diagonals."""

EYES_INSIDE = (
    "eyes lie inside the mesh's bounding box. Are they in its unit? Views of a mesh: "
    "views.around(mesh.centre, mesh.longest_side)."
)
"""Warning of `VisibilityQuery.visible` about eyes inside the mesh's bounding box."""


def contact_advice(far: FarFaces, mesh: Mesh) -> str:
    """Return sentences on the effect of far faces on the contact tolerance, and the remedy."""
    return (
        f"They make the contact tolerance {CONTACT * mesh.diagonal / far.size:.2g} of the others' size, so that "
        f"occlusion is missed. Remove them, or give contact={CONTACT * far.size / mesh.diagonal:.2g} to `exact` or "
        "another method that has it."
    )


class FirstHits(NamedTuple):
    """First hits of n rays.

    face_ids : (n,) int32, index into ``mesh.faces``; -1 for a ray that meets nothing
    distances : (n,) float64, distance from the ray's origin, world units; infinity for a ray that meets nothing
    """

    face_ids: IntArray
    distances: FloatArray


class VisibilityQuery(ABC):
    """Mesh prepared for line-of-sight questions. Use it as a context manager, or call `close`.

    A method subclasses this and implements `_visible`. It implements `_first_hits` if it can cast rays; otherwise its
    row in the table states the reason. It implements `_release` if it holds resources.
    """

    _rescales_directions = False
    """True if `_first_hits` takes directions of any length and calls `rescale_directions` itself."""
    renderer = "none"
    """GL_RENDERER of the context in use; "none" without OpenGL."""
    tolerance = 0.0
    """Distance, in world units, below which two sheets are taken for one, apart from the contact tolerance; 0: none."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self._closed = False
        self._warns_of_eyes = self._warns_of_far_faces = False

    def __repr__(self) -> str:
        state = ", closed" if self._closed else ""
        return f"VisibilityQuery({type(self).__module__.rpartition('.')[2]!r}, {self.mesh!r}{state})"

    @final
    def visible(self, points: SurfacePoints, eyes: ArrayLike | Views) -> BoolArray:
        """Return which points each eye sees.

        Parameters
        ----------
        points : SurfacePoints
            n points, world space; ``face_ids`` index ``mesh.faces``.
        eyes : (k, 3) float, (3,) float, or Views
            Centres of projection, world space; anywhere but on the surface. Points outside the pictures of Views with
            a field of view (`Views.fov_bounds`) are hidden.

        Returns
        -------
        (k, n) bool, True = visible; (n,) for one eye (3,).

        Raises
        ------
        ArgumentError
            Arrays of the wrong shape or type, not finite, or face ids that the mesh does not have.

        Warns
        -----
        UserWarning
            Eyes lie inside the mesh's bounding box and among the points, or few faces lie far from all others and so
            enlarge the contact tolerance. Each is given once per query that was prepared with ``warn=True``.
        """
        self._check_open()
        if not isinstance(points, SurfacePoints):
            raise ArgumentError(
                f"points must be SurfacePoints; got {type(points).__name__}. "
                "Wrap free positions: SurfacePoints.free(positions)."
            )
        if isinstance(eyes, Views):
            mask = self.visible(points, eyes.eyes)
            return mask if eyes.fov_bounds is None else mask & eyes.in_frustum(points.positions)
        eyes = as_array(eyes, "eyes", "(k, 3) float")
        if eyes.shape == (3,):
            return self.visible(points, eyes[None])[0]
        eyes = as_vectors(eyes, "eyes")
        limit = MAX_DIAGONALS * (self.mesh.diagonal or np.inf)  # a mesh of zero size has no scale: accept any distance
        for name, positions in (("points", points.positions), ("eyes", eyes)):
            if len(positions) and not are_within(self.mesh, positions, limit):
                raise ArgumentError(
                    f"{name} must lie within {MAX_DIAGONALS:g} diagonals of the mesh, up to which answers are tested; "
                    f"one is {np.abs(positions).max():.3g} out. Are they in the mesh's unit?"
                )
        if len(points) and int(points.face_ids.max()) >= len(self.mesh.faces):
            raise ArgumentError(
                f"face_ids must index the mesh's {len(self.mesh.faces)} faces; got {int(points.face_ids.max())}. "
                "Were the points sampled on another mesh?"
            )
        if len(eyes) == 0 or len(points) == 0:
            return np.ones((len(eyes), len(points)), dtype=bool)
        if self._warns_of_eyes and len(near := eyes[self.mesh.in_box(eyes)]):
            low, high = points.positions.min(axis=0), points.positions.max(axis=0)  # perhaps one object of a scene
            if ((near > low) & (near < high)).all(axis=1).any():
                self._warns_of_eyes = False
                warnings.warn(EYES_INSIDE, stacklevel=2)
        if self._warns_of_far_faces:
            self._warns_of_far_faces = False
            if far := far_faces(self.mesh):
                warnings.warn(f"{far.summary(self.mesh)}. {contact_advice(far, self.mesh)}", stacklevel=2)
        return self._visible(points, eyes)

    @abstractmethod
    def _visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        """Answer for checked arguments with at least one point and one eye; (k, n) bool."""

    @final
    def warn_once(self, *, far_faces: bool) -> None:
        """Let `visible` warn, once each, of eyes inside the bounding box and, if asked, of far faces."""
        self._warns_of_eyes, self._warns_of_far_faces = True, far_faces

    @final
    def first_hits(self, origins: ArrayLike, directions: ArrayLike) -> FirstHits:
        """Return the first face that each ray meets, and its distance.

        Parameters
        ----------
        origins : (n, 3) or (1, 3) float
            World space, no coordinate beyond 1e70; one origin serves all rays.
        directions : (n, 3) float
            World space, of any length but 0; no component beyond 1e70.

        Returns
        -------
        FirstHits
            The nearest face that meets the open ray, the lowest face id of those equally near. Faces are closed and
            two-sided; one whose plane contains the ray does not meet it (docs/conventions.md).

        Raises
        ------
        ArgumentError
            Arrays of the wrong shape or type, not finite, too large, of different lengths, or a direction of length 0.
        UnavailableError
            The method cannot cast rays.
        """
        self._check_open()
        origins, directions = as_vectors(origins, "origins"), as_triples(directions, "directions")
        if len(origins) not in (1, len(directions)):
            raise ArgumentError(
                f"origins must be one, or one per direction ({len(directions)}); got {len(origins)}. Repeat them."
            )
        if len(directions) == 0:
            return FirstHits(np.empty(0, dtype=np.int32), np.empty(0))
        return self._first_hits(origins, directions if self._rescales_directions else rescale_directions(directions))

    def _first_hits(self, origins: FloatArray, directions: FloatArray) -> FirstHits:
        """Answer for checked arguments with at least one ray; `origins` is (n, 3), or (1, 3) for all rays.

        Directions have safe norms (`arrays.have_safe_norms`) unless `_rescales_directions` is True.
        """
        raise UnavailableError(
            f"{type(self).__name__} cannot cast rays. `zbuf-occlude methods` lists the methods that can."
        )

    @final
    def check_is_of(self, mesh: Mesh) -> None:
        """Raise ArgumentError unless this was prepared for `mesh`, or for one with the same vertices and faces."""
        mine = self.mesh
        if mine is not mesh and not (
            np.array_equal(mine.faces, mesh.faces) and np.array_equal(mine.vertices, mesh.vertices)
        ):
            raise ArgumentError(
                f"occluder must be prepared for the mesh in question, {mesh!r}; it is for {mine!r}. Prepare that one."
            )

    def _check_open(self) -> None:
        if self._closed:
            raise ArgumentError("This visibility query is closed. Call prepare() again.")

    @final
    def close(self) -> None:
        """Release the query's resources; calling it again does nothing."""
        if not self._closed:
            self._closed = True
            self._release()

    def _release(self) -> None:  # noqa: B027  (a method without resources has nothing to release)
        """Release resources; called once."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


@dataclass(frozen=True)
class Method:
    """Row of the table of methods.

    Its module, ``visibility/methods/NAME.py``, is imported when the method is first used. The module's ``prepare``
    takes a Mesh (and ``gl=`` when `needs_gl`) and keyword-only options.

    Parameters
    ----------
    name : str
    summary : str
        One line.
    exact : bool
        True if its answers are those of rational arithmetic, for every line.
    needs_gl : bool
    needs_faces : bool
        True if it uses the mesh's faces; a method that does not can be prepared with a point cloud.
    requires : str
        Optional package that it imports, "" for none.
    libraries : tuple of str
        Libraries that the package links to on Linux and does not include.
    ray_casting_unsupported_reason : str
        Reason why it cannot answer `VisibilityQuery.first_hits`; "" for a method that can.
    """

    name: str
    summary: str
    exact: bool = False
    needs_gl: bool = False
    needs_faces: bool = True
    requires: str = ""
    libraries: tuple[str, ...] = ()
    ray_casting_unsupported_reason: str = ""

    @property
    def module(self) -> str:
        """Name of the method's module."""
        return f"{__package__}.methods.{self.name}"

    @property
    def extra(self) -> str:
        """Extra of this project that installs `requires`; "" for none."""
        return EXTRAS.get(self.requires, "")

    def missing(self) -> str:
        """Return the reason why the method cannot run here; "" if nothing is known to be missing.

        Nothing is imported or opened: ``zbuf-occlude doctor`` tries packages and OpenGL.
        """
        return missing(self.requires, *self.libraries) if self.requires else ""

    def load(self) -> Callable[..., VisibilityQuery]:
        """Import the method's module and return its prepare function.

        Raises
        ------
        UnavailableError
            A package it needs is not installed, or cannot be imported.
        """
        if reason := self.missing():
            raise UnavailableError(f"method {self.name!r} {reason}")
        with importing(self.requires, f"method {self.name!r}") if self.requires else nullcontext():
            prepare: Callable[..., VisibilityQuery] = import_module(self.module).prepare
        return prepare

    def options(self) -> dict[str, Any]:
        """Return the method's options and their defaults, from the signature of its prepare function."""
        return dict(_options_of(self.load()))

    def check_first_hits(self) -> None:
        """Raise OptionError when the method cannot answer `VisibilityQuery.first_hits`."""
        if self.ray_casting_unsupported_reason:
            raise OptionError(
                f"the method must cast rays; {self.name} does not: {self.ray_casting_unsupported_reason}. "
                "`zbuf-occlude methods` lists those that do."
            )

    def check_options(self, options: dict[str, Any]) -> None:
        """Raise OptionError for an unknown option of the method, or a value of another type than its default."""
        known = self.options()
        for name, value in options.items():
            if name not in known:
                raise OptionError(
                    f"method {self.name!r} must be given one of its options {', '.join(known) or '(it has none)'}; "
                    f"got {name!r}.{did_you_mean(name, known)}"
                )
            kind = _kind(known[name]) or "a number"  # an option with default None takes a number
            if _kind(value) != kind and not (value is None and known[name] is None):
                raise OptionError(f"{name} must be {kind}, like the default {known[name]}; got {shown(value)}.")


@cache
def _options_of(prepare: Callable[..., VisibilityQuery]) -> Mapping[str, Any]:
    parameters = inspect.signature(prepare).parameters.values()
    return {p.name: p.default for p in parameters if p.kind is p.KEYWORD_ONLY and p.name != "gl"}


def as_eyes(eyes: ArrayLike) -> FloatArray:
    """Return eyes as (k, 3), also a single eye (3,); raise ArgumentError for anything else."""
    return as_vectors(np.atleast_2d(as_array(eyes, "eyes", "(k, 3) float")), "eyes")


def check_count(name: str, value: Any, least: int, most: int, unit: str) -> None:
    """Raise OptionError unless a value is an int from `least` to `most`."""
    if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or not least <= value <= most:
        raise OptionError(f"{name} must be an int in [{least}, {most}], {unit}; got {shown(value)}.")


def are_within(mesh: Mesh, positions: FloatArray, limit: float) -> bool:
    """Return whether positions (n, 3) are within `limit` of the mesh's centre along each axis."""
    lowest, highest = mesh.centre.min(), mesh.centre.max()
    if max(positions.max() - lowest, highest - positions.min()) <= limit:
        return True  # nearly always, and without a copy
    return bool(np.abs(positions - mesh.centre).max() <= limit)


def _kind(value: Any) -> str:
    """Return the name of an option value's type; "" for a type that no option has."""
    return next((kind for kind, types in _KINDS.items() if isinstance(value, types)), "")
