"""Questions (a mesh, points, eyes), subjects (a method and its options), and the cases that combine both."""

import hashlib
import json
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.base.limits import Limits
from zbuf_occlude.base.provenance import seed_of
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes import shapes
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry
from zbuf_occlude.meshes.sampling import SurfacePoints, sample_surface
from zbuf_occlude.views import Views, paper100
from zbuf_occlude.visibility import METHODS, find_method

MAX_VIEWS = 15
"""Default maximum of views of a question: every 7th of the paper's 100."""

SWEEP: dict[str, tuple[dict[str, Any], ...]] = {
    "depth_buffer": (
        *({"resolution": n, "refine": "none"} for n in (256, 512, 1024)),
        *({"resolution": n} for n in (256, 512, 1024)),
    ),
    "pyrender": ({"resolution": 512}, {"resolution": 1024}),
    "vertex_hsr_culled": ({"suggestion": 1}, {"suggestion": 2}),
    "exact_hsr": ({}, {"cull": "second"}),
    "occupancy_grid": ({"n": 16}, {"n": 32}, {"n": 64}, {"n": 128}),
}
"""Options of the methods compared by default; a method that is not listed runs with its own defaults."""

SCALING, PRESET_VIEWS = "scaling", 5
IMAGE_SPACE = ("depth_buffer:resolution=512", "pyrender", "exact", "exact_gl", "embree")
GRIDS = ("occupancy_grid:n=32", "occupancy_grid:n=64")
SCALING_SUBJECTS = ("exact_hsr", "oracle", *GRIDS, *IMAGE_SPACE, "hidden_point_removal")
POINT_SWEEP = (1_000, 3_000, 10_000, 30_000, 100_000, 300_000)
FACE_SWEEP = (1_000, 3_000, 10_000, 30_000, 100_000)
SWEEP_FACES, SWEEP_POINTS = 3_000, 2_000
"""Number of faces while points grow, and of points while faces grow."""


# ---- questions ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Question:
    """Points of a mesh in random order, and the views from which their visibility is computed."""

    key: str  # unique within a comparison
    mesh: Mesh  # world space
    points: SurfacePoints  # n points; the first m of them are a random sample too
    views: Views  # k views about the mesh, world units

    @cached_property
    def fingerprint(self) -> str:
        """Hash of mesh, points and eyes; questions with equal hashes have equal answers."""
        digest = hashlib.sha256()
        mesh, points = self.mesh, self.points
        for array in (mesh.vertices, mesh.faces, points.positions, points.face_ids, self.views.eyes):
            digest.update(f"{array.shape}{array.dtype}".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()[:16]

    def describe(self) -> dict[str, Any]:
        """Return the fields of a row that describe the question."""
        faces, vertices, dropped = len(self.mesh.faces), len(self.mesh.vertices), dict(self.mesh.dropped)
        mesh = {"key": self.key, "faces": faces, "vertices": vertices, "dropped": dropped}
        return {"question": self.fingerprint, "mesh": mesh, "n_points": len(self.points)}


def sample_question(
    key: str, mesh: Mesh, views: Views, *, n_points: int, seed: int, most_views: int = MAX_VIEWS
) -> Question:
    """Sample a mesh and place views about it.

    `key` and `seed` determine the sampling. `views` are about the origin, distances in longest sides; at most
    `most_views` of them are used, evenly spread.
    """
    rng = np.random.default_rng(seed_of(seed, key))
    points = sample_surface(mesh, n_points=n_points, seed=rng)
    points = points.select(rng.permutation(len(points)))
    return Question(key, mesh, points, thinned(views, most_views).around(mesh.centre, mesh.longest_side))


def question_of_vertices(key: str, mesh: Mesh, views: Views, *, most_views: int) -> Question:
    """Return a question about the mesh's vertices, as in the paper's Table 1A; they have no face of their own."""
    points = SurfacePoints.free(mesh.vertices[np.unique(mesh.faces)])
    return Question(key, mesh, points, thinned(views, most_views).around(mesh.centre, mesh.longest_side))


def thinned(views: Views, most: int) -> Views:
    """Return every m-th view, with the smallest m that leaves at most `most`."""
    return views.select(np.arange(0, len(views), -(-len(views) // most)))


def row_key(question: Question, method: str, options: dict[str, Any], suite: str) -> str:
    """Return the key of a row: a hash of suite, question, method and options."""
    text = json.dumps([suite, question.fingerprint, method, options], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


# ---- subjects ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Subject:
    """A method and its options.

    Raises OptionError for an unknown method or option; UnavailableError where options are given and a package is
    missing.
    """

    method: str
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        row = find_method(self.method)
        if self.options:
            row.check_options(dict(self.options))

    @property
    def label(self) -> str:
        """``name:key=value,...``, as typed at the command line."""
        options = ",".join(f"{key}={value}" for key, value in self.options.items())
        return f"{self.method}:{options}" if options else self.method


def default_subjects() -> list[Subject]:
    """Return every method of the table, those of `SWEEP` once for each of their settings.

    Methods that cannot run here are included without options: their rows hold the reason.
    """
    subjects = []
    for method in METHODS:
        settings: Iterable[dict[str, Any]] = ({},) if method.missing() else SWEEP.get(method.name, ({},))
        subjects += [Subject(method.name, options) for options in settings]
    return subjects


def subjects_of(labels: Iterable[str]) -> list[Subject]:
    """Return the subjects of labels ``name:key=int,...``."""
    subjects = []
    for label in labels:
        method, _, text = label.partition(":")
        pairs = (pair.partition("=") for pair in filter(None, text.split(",")))
        subjects.append(Subject(method, {key: int(value) for key, _, value in pairs}))
    return subjects


# ---- cases -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Case:
    """A question and the subjects that answer it."""

    suite: str  # "meshes" or a preset's name; the report has a section for each
    label: str
    make_question: Callable[[], Question]  # called when the case is run; may raise OccludeError
    subjects: Sequence[Subject]
    compared: bool = True  # True if answers are compared with the reference, False if they are only timed
    facts: dict[str, Any] | None = None  # fields copied into each row
    budget: float | None = None  # seconds of timed calls for each row; None: the comparison's default


def mesh_cases(
    meshes: MeshCollection,
    subjects: Sequence[Subject],
    views_of: Callable[[str], Views],
    *,
    n_points: int,
    seed: int,
    most_views: int,
) -> list[Case]:
    """Return a case for each mesh; `views_of` returns the views of a mesh by its key."""

    def question(entry: MeshEntry) -> Question:
        with Limits().watch():
            mesh = entry.load()
        return sample_question(
            entry.key, mesh, views_of(entry.key), n_points=n_points, seed=seed, most_views=most_views
        )

    short = Counter(Path(entry.key).stem for entry in meshes)
    labels = [stem if short[stem := Path(entry.key).stem] == 1 else entry.key for entry in meshes]
    return [
        Case("meshes", label, partial(question, entry), subjects) for label, entry in zip(labels, meshes, strict=True)
    ]


def scaling_cases(seed: int, budget: float | None = None) -> list[Case]:
    """Return cases that only time methods, against the number of points and the number of faces.

    The mesh is a built-in chair whose edges are halved until it has the number of faces; its surface is unchanged.
    """
    subjects = subjects_of(SCALING_SUBJECTS)

    def question(n_faces: int, n_points: int) -> Question:
        mesh = shapes.refined(shapes.make("chair", 2), n_faces)
        return sample_question(
            f"chair/{n_faces}", mesh, paper100(), n_points=n_points, seed=seed, most_views=PRESET_VIEWS
        )

    sizes = [("points", SWEEP_FACES, n) for n in POINT_SWEEP] + [("faces", f, SWEEP_POINTS) for f in FACE_SWEEP]
    return [
        Case(
            SCALING,
            f"{n_points:,} points, about {n_faces:,} faces",
            partial(question, n_faces, n_points),
            subjects,
            compared=False,
            facts={"sweep": sweep},
            budget=budget,
        )
        for sweep, n_faces, n_points in sizes
    ]
