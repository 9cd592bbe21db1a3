"""The paper's Table 1: its objects and numbers, and what was measured here beside them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from zbuf_occlude.compare.summary import Row, milliseconds, seconds_for_all_points, share
from zbuf_occlude.compare.tables import Table


@dataclass(frozen=True)
class PaperObject:
    """An object of Table 1 and where ModelNet40 has it.

    Parameters
    ----------
    label : str
        As the paper calls it.
    file, kind : str
        Name of the OFF file without its ending, and of its class.
    faces, vertices : int
        As the paper counts them.
    """

    label: str
    file: str
    kind: str
    faces: int
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
"""Seconds of the original and of the modified HSR, and the reduction in percent."""

TABLE_1B: dict[tuple[PaperObject, int], tuple[float, float, float, float, float]] = {
    (CAR_5, 1_000): (18.5, 0.3, 0.3, 98.4, 98.4),
    (CAR_5, 10_000): (163.8, 1.3, 2.4, 99.2, 98.5),
    (CAR_5, 50_000): (812.7, 1.5, 6.3, 99.8, 99.2),
    (CAR_6, 5_000): (24.2, 0.7, 1.1, 97.1, 95.5),
    (CAR_6, 20_000): (96.5, 1.3, 3.7, 98.7, 96.2),
    (CAR_6, 100_000): (493.0, 1.6, 4.8, 99.7, 99.0),
}
"""By object and number of points: seconds of exact HSR, grid 32, grid 64; reductions of the two grids in percent."""

MODIFIED = "vertex_hsr_culled:suggestion=2"
GRIDS = ("occupancy_grid:n=32", "occupancy_grid:n=64")


def paper_tables(rows: Sequence[Row]) -> list[Table]:
    """Return Table 1A and 1B with what was measured, as far as there are rows."""
    tables = []
    for suite, make in (("table1a", table_1a), ("table1b", table_1b)):
        chosen = [row for row in rows if row["suite"] == suite and row["status"] == "ok"]
        if chosen:
            tables.append(make(chosen))
    return tables


def table_1a(rows: Sequence[Row]) -> Table:
    """Return Table 1A: HSR by vertices against the second suggestion, and image space on the same vertices."""
    body = []
    for paper, (original, modified, reduction) in TABLE_1A.items():
        here = _of_object(rows, paper.label)
        if not here:
            continue
        size = f"{paper.faces:,} · {paper.vertices:,}"
        body.append([paper.label, "**paper**", size, f"{original} s", f"{modified} s", f"{reduction} %", "–", "–", "–"])
        slow, fast = here.get("vertex_hsr"), here.get(MODIFIED)
        if slow and fast:
            body.append(
                [
                    "",
                    f"here: {slow['facts']['stand_in']}",
                    _size(slow),
                    f"{milliseconds(slow['timed']['seconds_per_view'])} ms",
                    f"{milliseconds(fast['timed']['seconds_per_view'])} ms",
                    _reduction(slow["timed"]["seconds_per_view"], fast["timed"]["seconds_per_view"]),
                    _reduction(slow["timed"]["cpu_seconds_per_view"], fast["timed"]["cpu_seconds_per_view"]),
                    _reduction(slow["timed"]["tests_per_view"], fast["timed"]["tests_per_view"]),
                    f"{_wrong(slow)} · {_wrong(fast)}",
                ]
            )
        body += _others(
            here, {"vertex_hsr", MODIFIED}, slow, lambda row, time, less: [_size(row), "", time, less, "–", "–"]
        )
    return Table(
        "Table 1A of the paper: HSR by vertices, and with far faces excluded (second suggestion)",
        ["object", "", "faces · points", "original", "modified", "reduction", "of CPU time", "of tests", "wrong"],
        body,
        "Seconds of the paper are MATLAB's, for one view; what compares are the reductions. Here: time of one view, "
        "preparing not counted, all cores; CPU time is theirs together. Of tests: how many fewer pairs of vertex and "
        "face were tested; making and comparing the distances costs the rest. Wrong: outside the boundary band, of "
        "points sampled on the faces that are kept or dropped; of the vertices themselves in the rows of other "
        "methods, which were asked about exactly the vertices.",
        texts=2,
    )


def table_1b(rows: Sequence[Row]) -> Table:
    """Return Table 1B: exact HSR against occupancy grids, their error beside, and image space on the same points."""
    body = []
    for (paper, n_points), (exact, g32, g64, r32, r64) in TABLE_1B.items():
        here = _of_object([row for row in rows if row["n_points"] == n_points], paper.label)
        if not here:
            continue
        body.append(
            [
                f"{paper.label}, {n_points:,}",
                "**paper**",
                f"{exact} s",
                f"{g32} s",
                f"{g64} s",
                f"{r32} %",
                f"{r64} %",
                "–",
            ]
        )
        slow, grids = here.get("exact_hsr"), [here.get(name) for name in GRIDS]
        if slow and all(grids):
            seconds = seconds_for_all_points(slow)
            two = [(grid, seconds_for_all_points(grid)) for grid in grids if grid]
            body.append(
                [
                    "",
                    f"here: {slow['facts']['stand_in']}",
                    f"{milliseconds(seconds)} ms",
                    *(f"{milliseconds(s)} ms" for _, s in two),
                    *(_reduction(seconds, s) for _, s in two),
                    " · ".join(_wrong(grid) for grid, _ in two),
                ]
            )
        body += _others(here, {"exact_hsr", *GRIDS}, slow, lambda row, time, less: [time, "", "", less, ""])
    return Table(
        "Table 1B of the paper: exact HSR, and occupancy grids",
        ["object, points", "", "exact HSR", "32³", "64³", "reduction 32³", "64³", "wrong (grids: 32³ · 64³)"],
        body,
        "Seconds of the paper are MATLAB's, for one view; what compares are the reductions. Here: time of one view, "
        "preparing (for grids: filling them, once a mesh) not counted, all cores. Wrong: outside the boundary band, "
        "against `oracle`; the paper gives no error.",
        texts=2,
    )


def _of_object(rows: Sequence[Row], label: str) -> dict[str, Row]:
    return {row["subject"]: row for row in rows if row["facts"]["object"] == label}


def _others(
    here: dict[str, Row], known: set[str], slow: Row | None, cells: Callable[[Row, str, str], list[str]]
) -> list[list[str]]:
    """Lines of the subjects that the paper does not have."""
    lines = []
    for subject, row in here.items():
        if subject not in known:
            seconds = seconds_for_all_points(row)
            less = _reduction(seconds_for_all_points(slow), seconds) if slow else "–"
            lines.append(["", f"`{subject}`", *cells(row, f"{milliseconds(seconds)} ms", less), _wrong(row)])
    return lines


def _size(row: Row) -> str:
    return f"{row['mesh']['faces']:,} · {row['facts'].get('vertices', row['n_points']):,}"


def _reduction(slow: float, fast: float) -> str:
    return f"{100 * (1 - fast / slow):.1f} %"


def _wrong(row: Row) -> str:
    return share(1.0 - row["judged"]["outside"]["agreement"])
