"""The paper's Tables 1 and 2 with measurements beside them, and the cases that repeat Table 1."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from zbuf_occlude.datasets.folder import CONTACT_SHEET, GALLERY, SHARDS, partition_files, read_finished
from zbuf_occlude.drawing.pages import NONE, Table
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes import shapes
from zbuf_occlude.meshes.load import load_mesh
from zbuf_occlude.studies.compare.cases import (
    GRIDS,
    IMAGE_SPACE,
    PRESET_VIEWS,
    Case,
    Question,
    question_of_vertices,
    sample_question,
    subjects_of,
)
from zbuf_occlude.studies.compare.metrics import Row, format_error, format_milliseconds, seconds_for_all_points
from zbuf_occlude.views import paper100

TABLE_SECONDS = 30.0
"""Seconds of timed calls per row: enough for the paper's methods from all 5 views, every 20th of its 100."""
MODIFIED = "vertex_hsr_culled:suggestion=2"


class PaperObject(NamedTuple):
    """An object of Table 1 and its file in ModelNet40."""

    label: str  # name in the paper
    file: str  # name of the OFF file without suffix
    kind: str
    faces: int  # number in the paper
    vertices: int


CAR_5 = PaperObject("Car (5)", "car_0005", "car", 18_014, 12_759)
CAR_6 = PaperObject("Car (6)", "car_0006", "car", 13_164, 19_475)
CHAIR_3 = PaperObject("Chair (3)", "chair_0003", "chair", 2_628, 7_884)
LAMP_3 = PaperObject("Lamp (3)", "lamp_0003", "lamp", 5_903, 5_364)

TABLE_1A: dict[PaperObject, tuple[float, float, float]] = {
    CAR_5: (228.1, 94.8, 58.4),
    CAR_6: (343.2, 159.0, 53.7),
    CHAIR_3: (12.5, 5.6, 55.2),
    LAMP_3: (29.9, 12.4, 58.5),
}
"""Seconds of original and modified HSR, and the reduction in percent, by object."""

TABLE_1B: dict[tuple[PaperObject, int], tuple[float, float, float, float, float]] = {
    (CAR_5, 1_000): (18.5, 0.3, 0.3, 98.4, 98.4),
    (CAR_5, 10_000): (163.8, 1.3, 2.4, 99.2, 98.5),
    (CAR_5, 50_000): (812.7, 1.5, 6.3, 99.8, 99.2),
    (CAR_6, 5_000): (24.2, 0.7, 1.1, 97.1, 95.5),
    (CAR_6, 20_000): (96.5, 1.3, 3.7, 98.7, 96.2),
    (CAR_6, 100_000): (493.0, 1.6, 4.8, 99.7, 99.0),
}
"""Seconds of exact HSR, grid 32 and grid 64, and reductions of the grids in percent, by object and points."""


# ---- cases -------------------------------------------------------------------------------------------------------


def cases_1a(root: Path | None, seed: int, budget: float | None = None) -> list[Case]:
    """Return the cases of Table 1A, vertices against faces.

    The paper's methods keep or drop faces; methods in image space test the vertices. Objects come from `root`,
    ModelNet40's folder; missing ones are replaced by built-in shapes with the same numbers of faces and vertices.
    `budget` is the seconds of timed calls per row. Default: `TABLE_SECONDS` for the paper's own methods, and that of
    the comparison for others.
    """
    cases = []
    for paper in TABLE_1A:
        find, what = mesh_of(paper, root)
        facts = {"object": paper.label, "stand_in": what, "vertices": len(find().vertices)}
        for make, labels, seconds in (
            (_sampled(find, paper, 2_000, seed), ("vertex_hsr", MODIFIED), budget or TABLE_SECONDS),
            (partial(_ask_vertices, find, paper), IMAGE_SPACE, budget),
        ):
            cases.append(Case("table1a", paper.label, make, subjects_of(labels), facts=facts, budget=seconds))
    return cases


def cases_1b(root: Path | None, seed: int, budget: float | None = None) -> list[Case]:
    """Return the cases of Table 1B: sampled points by exact HSR, grids and image space; arguments as for `cases_1a`."""
    cases, subjects = [], subjects_of(["exact_hsr", *GRIDS, *IMAGE_SPACE])
    for paper, n_points in TABLE_1B:
        find, what = mesh_of(paper, root)
        make, label = _sampled(find, paper, n_points, seed), f"{paper.label}, {n_points:,}"
        facts = {"object": paper.label, "stand_in": what}
        cases.append(Case("table1b", label, make, subjects, facts=facts, budget=budget or TABLE_SECONDS))
    return cases


def _sampled(find: Callable[[], Mesh], paper: PaperObject, n_points: int, seed: int) -> Callable[[], Question]:
    return lambda: sample_question(
        paper.file, find(), paper100(), n_points=n_points, seed=seed, most_views=PRESET_VIEWS
    )


def _ask_vertices(find: Callable[[], Mesh], paper: PaperObject) -> Question:
    return question_of_vertices(paper.file, find(), paper100(), most_views=PRESET_VIEWS)


def mesh_of(paper: PaperObject, root: Path | None) -> tuple[Callable[[], Mesh], str]:
    """Return a function that loads an object of the paper, and the name of its file or of its replacement."""
    found = [] if root is None else sorted(root.rglob(f"{paper.file}.off"))
    if found:
        return partial(load_mesh, found[0]), f"{paper.file}.off"
    mesh = shapes.benchmark_mesh(paper.faces, paper.kind)
    mesh = shapes.with_vertices(mesh, min(paper.vertices, 3 * len(mesh.faces)))
    return (lambda: mesh), f"built-in {paper.kind}, {len(mesh.faces):,} faces, {len(mesh.vertices):,} vertices"


CASES = {"table1a": cases_1a, "table1b": cases_1b}

# ---- tables ------------------------------------------------------------------------------------------------------


def paper_tables(rows: Sequence[Row]) -> list[Table]:
    """Return Tables 1A and 1B with measurements, where there are rows."""
    measured = [row for row in rows if row["status"] == "ok"]
    chosen = {make: [row for row in measured if row["suite"] == suite] for suite, make in TABLES.items()}
    return [make(some) for make, some in chosen.items() if some]


def table_1a(rows: Sequence[Row]) -> Table:
    """Return Table 1A: HSR by vertices, the second suggestion, and image space on the same vertices."""
    body = []
    for paper, (original, modified, reduction) in TABLE_1A.items():
        here = _of_object(rows, paper.label)
        if not here:
            continue
        size = f"{paper.faces:,} · {paper.vertices:,}"
        body.append([paper.label, "**paper**", size, f"{original} s", f"{modified} s", f"{reduction} %", *[NONE] * 3])
        slow, fast = here.pop("vertex_hsr", None), here.pop(MODIFIED, None)
        if slow and fast:
            columns = ("seconds_per_view", "cpu_seconds_per_view", "tests_per_view")
            body.append(
                [
                    "",
                    f"here: {slow['facts']['stand_in']}",
                    _size(slow),
                    *(f"{format_milliseconds(row['timed']['seconds_per_view'])} ms" for row in (slow, fast)),
                    *(_reduction(slow["timed"][column], fast["timed"][column]) for column in columns),
                    f"{format_error(slow)} · {format_error(fast)}",
                ]
            )
        for subject, row in here.items():
            time, less = _time_and_reduction(row, slow)
            body.append(["", f"`{subject}`", _size(row), "", time, less, NONE, NONE, format_error(row)])
    return Table(
        "Table 1A of the paper: HSR by vertices, and with far faces excluded (second suggestion)",
        ["object", "", "faces · points", "original", "modified", "reduction", "of CPU time", "of tests", "wrong"],
        body,
        "Seconds of the paper are MATLAB's for one view; compare the reductions. Here: time of one view on all cores, "
        "preparing not counted; CPU time is the sum over the cores. Of tests: reduction of the pairs of vertex and "
        "face that are tested; computing distances costs the rest. Wrong: errors outside the boundary band, of points "
        "sampled on the kept or dropped faces; in the rows of other methods, of the vertices.",
        texts=range(2),
    )


def table_1b(rows: Sequence[Row]) -> Table:
    """Return Table 1B: exact HSR, occupancy grids with their errors, and image space on the same points."""
    body = []
    for (paper, n_points), (exact, g32, g64, r32, r64) in TABLE_1B.items():
        here = _of_object([row for row in rows if row["n_points"] == n_points], paper.label)
        if not here:
            continue
        label = f"{paper.label}, {n_points:,}"
        seconds = [f"{number} s" for number in (exact, g32, g64)]
        body.append([label, "**paper**", *seconds, f"{r32} %", f"{r64} %", NONE])
        slow = here.pop("exact_hsr", None)
        grids = [row for name in GRIDS if (row := here.pop(name, None))]
        if slow and len(grids) == len(GRIDS):
            times = [seconds_for_all_points(row) for row in (slow, *grids)]
            body.append(
                [
                    "",
                    f"here: {slow['facts']['stand_in']}",
                    *(f"{format_milliseconds(time)} ms" for time in times),
                    *(_reduction(times[0], time) for time in times[1:]),
                    " · ".join(map(format_error, grids)),
                ]
            )
        for subject, row in here.items():
            time, less = _time_and_reduction(row, slow)
            body.append(["", f"`{subject}`", time, "", "", less, "", format_error(row)])
    return Table(
        "Table 1B of the paper: exact HSR, and occupancy grids",
        ["object, points", "", "exact HSR", "32³", "64³", "reduction 32³", "64³", "wrong (grids: 32³ · 64³)"],
        body,
        "Seconds of the paper are MATLAB's for one view; compare the reductions. Here: time of one view on all cores, "
        "preparing not counted (for grids: filling them, once per mesh). Wrong: errors outside the boundary band "
        "against `oracle`; the paper gives none.",
        texts=range(2),
    )


TABLES = {"table1a": table_1a, "table1b": table_1b}


def _of_object(rows: Sequence[Row], label: str) -> dict[str, Row]:
    return {row["subject"]: row for row in rows if row["facts"]["object"] == label}


def _time_and_reduction(row: Row, slow: Row | None) -> tuple[str, str]:
    seconds = seconds_for_all_points(row)
    return f"{format_milliseconds(seconds)} ms", _reduction(seconds_for_all_points(slow), seconds) if slow else NONE


def _size(row: Row) -> str:
    return f"{row['mesh']['faces']:,} · {row['facts'].get('vertices', row['n_points']):,}"


def _reduction(slow: float, fast: float) -> str:
    return f"{100 * (1 - fast / slow):.1f} %"


# ---- Table 2: datasets -----------------------------------------------------------------------------------------------


class DatasetRow(NamedTuple):
    """A row of Table 2; a megabyte is 10^6 bytes."""

    name: str
    n_samples: int
    n_classes: int
    type: str
    representation: str
    megabytes: float

    @property
    def samples_per_megabyte(self) -> float:
        """Last column of the table."""
        return self.n_samples / self.megabytes


TABLE_2 = (
    DatasetRow("McGill Benchmark", 427, 19, "Synthesized", "Mesh", 412),
    DatasetRow("Sydney Urban Objects", 631, 14, "Real-World", "Point Cloud", 9.66),
    DatasetRow("ModelNet10", 4_899, 10, "Synthesized", "Mesh", 2_170),
    DatasetRow("ModelNet40", 12_311, 40, "Synthesized", "Mesh", 9_100),
    DatasetRow("ShapeNet", 57_454, 55, "Synthesized", "Mesh", 92_900),
    DatasetRow("The paper's dataset", 200_000, 40, "Synthesized", "Point Cloud", 6_940),
)
"""Rows of the paper's Table 2; its last column follows from two others."""


def row_of(folder: Path) -> DatasetRow:
    """Return the row of a complete dataset, with the size of all files needed to read it.

    Raises DatasetError where the folder holds no complete dataset.
    """
    plan, manifest = read_finished(folder)
    own, _ = partition_files(folder, plan)
    beside = (CONTACT_SHEET, GALLERY)
    files = [folder / name for name in own if not (name in beside or name.startswith(SHARDS) or name.endswith("/"))]
    megabytes = sum(path.stat().st_size for path in files) / 1e6
    n_clouds, name = manifest["counts"]["clouds"], f"This one ({plan.format})"
    return DatasetRow(name, n_clouds, len(plan.classes), "Synthesized", "Point Cloud", megabytes)


def table_2(folder: Path) -> Table:
    """Return Table 2 with the row of a dataset; raises as `row_of` does."""
    body = []
    for row in (*TABLE_2, row_of(folder)):
        megabytes = f"{row.megabytes:,.2f}" if row.megabytes < 100 else f"{row.megabytes:,.0f}"
        counts, share = (f"{row.n_samples:,}", f"{row.n_classes}"), f"{row.samples_per_megabyte:,.2f}"
        body.append([row.name, *counts, row.type, row.representation, megabytes, share])
    header = ["Dataset name", "#Samples", "#Classes", "Type", "Representation", "Size (MB)", "#Samples / 1 MB"]
    return Table("", header, body, texts=(0, 3, 4))
