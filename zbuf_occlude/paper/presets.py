"""What `compare` compares: meshes that were named, the paper's Table 1A and 1B, and the growth of cost."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from zbuf_occlude import shapes
from zbuf_occlude.checks import check_word
from zbuf_occlude.compare.question import Question, ask, ask_vertices
from zbuf_occlude.compare.run import Case
from zbuf_occlude.compare.subjects import Subject
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.limits import Limits
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry
from zbuf_occlude.meshes.files import load_mesh
from zbuf_occlude.paper.table1 import GRIDS, MODIFIED, TABLE_1A, TABLE_1B, PaperObject
from zbuf_occlude.views import Views, paper100
from zbuf_occlude.visibility import METHODS

OBJECTS_OF_THE_PAPER = ("table1a", "table1b")
PRESETS = (*OBJECTS_OF_THE_PAPER, "scaling")
TABLE_VIEWS = 5
"""Views of the presets: every 20th of the paper's 100."""
TABLE_SECONDS = 30.0
"""Budget of a row of the paper's tables: enough for the paper's methods to be asked from all of those views."""
IMAGE_SPACE = ("depth_buffer:resolution=512", "pyrender", "exact", "exact_gl", "embree")
SCALING = ("exact_hsr", "oracle", *GRIDS, *IMAGE_SPACE, "hidden_point_removal")
POINT_SWEEP = (1_000, 3_000, 10_000, 30_000, 100_000, 300_000)
FACE_SWEEP = (1_000, 3_000, 10_000, 30_000, 100_000)
SWEEP_SHAPE = ("chair", 2)
"""The built-in shape whose edges are halved until it has this many faces; its surface stays."""
SWEEP_FACES, SWEEP_POINTS = 3_000, 2_000
"""What stays as it is while the other number grows."""


def of_meshes(
    meshes: MeshCollection,
    subjects: Sequence[Subject],
    views_of: Callable[[str], Views],
    *,
    n_points: int,
    seed: int,
    most_views: int,
) -> list[Case]:
    """Return a case for each mesh, of the views that `views_of` gives for its key."""

    def question(entry: MeshEntry) -> Question:
        with Limits().watch():
            mesh = entry.load()
        return ask(entry.key, mesh, views_of(entry.key), n_points=n_points, seed=seed, most_views=most_views)

    short = Counter(Path(entry.key).stem for entry in meshes)
    labels = [stem if short[stem := Path(entry.key).stem] == 1 else entry.key for entry in meshes]
    return [
        Case("meshes", label, partial(question, entry), subjects) for label, entry in zip(labels, meshes, strict=True)
    ]


def preset(name: str, *, root: Path | None, seed: int, budget: float | None = None) -> list[Case]:
    """Return the cases of a preset.

    Parameters
    ----------
    name : str
        One of `PRESETS`.
    root : Path, optional
        ModelNet40's folder: the paper's objects are taken from there as far as it has them; built-in shapes
        of as many faces and vertices stand in for the others.
    seed : int
    budget : float, optional
        Seconds of timed calls for each row; by default `TABLE_SECONDS` for the paper's own methods, and the
        comparison's for all else.

    Raises
    ------
    OptionError
        No such preset.
    """
    check_word("preset", name, PRESETS)
    tables = {"table1a": table_1a, "table1b": table_1b}
    cases = tables[name](root, seed) if name in tables else scaling(seed)
    return cases if budget is None else [replace(case, budget=budget) for case in cases]


def table_1a(root: Path | None, seed: int) -> list[Case]:
    """Vertices against faces: the paper's methods keep or drop faces, image space is asked about the vertices."""
    cases = []
    views = paper100()
    for paper in TABLE_1A:
        find, what = mesh_of(paper, root)

        def sampled(find: Callable[[], Mesh] = find, key: str = paper.file) -> Question:
            return ask(key, find(), views, n_points=2_000, seed=seed, most_views=TABLE_VIEWS)

        def vertices(find: Callable[[], Mesh] = find, key: str = paper.file) -> Question:
            return ask_vertices(key, find(), views, most_views=TABLE_VIEWS)

        facts = {"object": paper.label, "stand_in": what, "vertices": len(find().vertices)}
        cases.append(
            Case("table1a", paper.label, sampled, chosen(["vertex_hsr", MODIFIED]), facts=facts, budget=TABLE_SECONDS)
        )
        cases.append(Case("table1a", paper.label, vertices, chosen(IMAGE_SPACE), facts=facts))
    return cases


def table_1b(root: Path | None, seed: int) -> list[Case]:
    """Sampled points: exact HSR, grids, image space."""
    cases = []
    views = paper100()
    for paper, n_points in TABLE_1B:
        find, what = mesh_of(paper, root)

        def question(find: Callable[[], Mesh] = find, key: str = paper.file, n: int = n_points) -> Question:
            return ask(key, find(), views, n_points=n, seed=seed, most_views=TABLE_VIEWS)

        facts = {"object": paper.label, "stand_in": what}
        subjects, label = chosen(["exact_hsr", *GRIDS, *IMAGE_SPACE]), f"{paper.label}, {n_points:,}"
        cases.append(Case("table1b", label, question, subjects, facts=facts, budget=TABLE_SECONDS))
    return cases


def scaling(seed: int) -> list[Case]:
    """Time alone against the number of points, and against the number of faces of one shape made ever finer."""
    subjects = chosen(SCALING)
    sizes = [("points", SWEEP_FACES, n) for n in POINT_SWEEP] + [("faces", f, SWEEP_POINTS) for f in FACE_SWEEP]
    cases = []
    for sweep, n_faces, n_points in sizes:

        def question(n_faces: int = n_faces, n_points: int = n_points) -> Question:
            mesh = shapes.refined(shapes.make(*SWEEP_SHAPE), n_faces)
            return ask(f"chair/{n_faces}", mesh, paper100(), n_points=n_points, seed=seed, most_views=TABLE_VIEWS)

        label = f"{n_points:,} points, about {n_faces:,} faces"
        cases.append(Case("scaling", label, question, subjects, judged=False, facts={"sweep": sweep}))
    return cases


def chosen(labels: Iterable[str]) -> list[Subject]:
    """Return the subjects of labels, as far as their methods are in the table."""
    names = {method.name for method in METHODS}
    return [subject_of(label) for label in labels if label.partition(":")[0] in names]


def subject_of(label: str) -> Subject:
    """Return the subject of a label of this module: ``name:key=int,...``."""
    method, _, text = label.partition(":")
    options: dict[str, Any] = {}
    for pair in filter(None, text.split(",")):
        key, _, value = pair.partition("=")
        options[key] = int(value)
    return Subject(method, options)


def mesh_of(paper: PaperObject, root: Path | None) -> tuple[Callable[[], Mesh], str]:
    """Return how to load an object of the paper, and what it is: the file, or what stands in for it."""
    if root is not None:
        found = sorted(root.rglob(f"{paper.file}.off"))
        if found:
            return (lambda: load_mesh(found[0])), f"{paper.file}.off"
    mesh = shapes.benchmark_mesh(paper.faces, paper.kind)
    mesh = shapes.with_vertices(mesh, min(paper.vertices, 3 * len(mesh.faces)))
    return (lambda: mesh), f"built-in {paper.kind}, {len(mesh.faces):,} faces, {len(mesh.vertices):,} vertices"
