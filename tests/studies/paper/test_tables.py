"""The paper's Tables 1 and 2: printed and measured rows, and the presets that repeat Table 1."""

from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.scenes import CHAIR, box, needs_chair
from zbuf_occlude import views
from zbuf_occlude.datasets.generate import generate
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry
from zbuf_occlude.studies.compare import cases
from zbuf_occlude.studies.paper.tables import TABLE_1A, TABLE_1B, TABLE_2, paper_tables, row_of, table_2


def row(suite: str, obj: str, subject: str, ms: float, n: int = 1000, **timed: Any) -> dict[str, Any]:
    return {
        "suite": suite,
        "status": "ok",
        "subject": subject,
        "facts": {"object": obj, "stand_in": "a built-in car", "vertices": 123},
        "mesh": {"faces": 18_000},
        "n_points": n,
        "timed": {"seconds_per_view": ms / 1e3, "n_points": n, "tests_per_view": None} | timed,
        "judged": {"outside": {"agreement": 0.9}},
    }


def test_the_papers_reductions_are_its_own_seconds() -> None:
    """The numbers typed in are consistent: reduction is 1 - modified / original."""
    for original, modified, reduction in TABLE_1A.values():
        assert 100 * (1 - modified / original) == pytest.approx(reduction, abs=0.06)
    for (paper, n), (exact, g32, g64, r32, r64) in TABLE_1B.items():
        # seconds of the grids have one decimal, so small ones allow a wide range
        for grid, reduction in ((g32, r32), (g64, r64)):
            assert 100 * (1 - grid / exact) == pytest.approx(reduction, abs=100 * 0.06 / exact + 0.06), (paper, n)


def test_table_1a_compares_reductions() -> None:
    slow, fast = ({"tests_per_view": n, "cpu_seconds_per_view": s} for n, s in ((1000.0, 2.0), (300.0, 1.0)))
    rows = [
        row("table1a", "Car (5)", "vertex_hsr", 10.0, **slow),
        row("table1a", "Car (5)", "vertex_hsr_culled:suggestion=2", 4.0, **fast),
        row("table1a", "Car (5)", "exact", 1.0),
    ]
    (table,) = paper_tables(rows)
    text = table.as_markdown()
    assert "| Car (5) | **paper** | 18,014 · 12,759 | 228.1 s | 94.8 s | 58.4 % |" in text
    assert (
        "| here: a built-in car | 18,000 · 123 | 10.0 ms | 4.00 ms | 60.0 % | 50.0 % | 70.0 % | 10 % · 10 % |" in text
    )
    assert "| `exact` | 18,000 · 123 |  | 1.00 ms | 90.0 % |" in text
    assert "Chair (3)" not in text, "what was not measured is left out"


def test_table_1b_has_the_grids_error_beside() -> None:
    rows = [
        row("table1b", "Car (5)", "exact_hsr", 200.0, 10_000, n_points=5_000),  # half the points: twice the time
        row("table1b", "Car (5)", "occupancy_grid:n=32", 1.0, 10_000),
        row("table1b", "Car (5)", "occupancy_grid:n=64", 4.0, 10_000),
        row("table1b", "Car (5)", "depth_buffer:resolution=512", 2.0, 10_000),
    ]
    (table,) = paper_tables(rows)
    text = table.as_markdown()
    assert "| Car (5), 10,000 | **paper** | 163.8 s | 1.3 s | 2.4 s | 99.2 % | 98.5 % | – |" in text
    assert "| here: a built-in car | 400 ms | 1.00 ms | 4.00 ms | 99.8 % | 99.0 % | 10 % · 10 % |" in text
    assert "`depth_buffer:resolution=512`" in text


def test_the_scaling_preset_varies_one_number_at_a_time() -> None:
    n_faces, n_points, areas = defaultdict[str, set[int]](set), defaultdict[str, set[int]](set), []
    for case in cases.scaling_cases(0):
        if "100,000" not in case.label and "30" not in case.label:
            question = case.make_question()
            n_faces[case.facts["sweep"]].add(len(question.mesh.faces))
            n_points[case.facts["sweep"]].add(len(question.points))
            areas.append(question.mesh.areas.sum())
    assert len(n_faces["points"]) == len(n_points["faces"]) == 1
    assert min(len(n_faces["faces"]), len(n_points["points"])) > 1
    assert np.allclose(areas, areas[0]), "the surface stays"


def test_random_views_are_drawn_for_each_object() -> None:
    """Views depend on the mesh key alone, as in `generate`."""
    config = DatasetConfig(views="random:4", seed=3)
    entries = [MeshEntry(f"{i}.off", "box", "train", box) for i in range(3)]
    asked = [
        [
            case.make_question().views.eyes
            for case in cases.mesh_cases(some, [], config.make_views, n_points=5, seed=3, most_views=4)
        ]
        for some in (MeshCollection(entries), MeshCollection(entries[1:]))
    ]
    assert not np.allclose(asked[0][0], asked[0][1])
    assert np.array_equal(asked[0][1:], asked[1])


@needs_chair
def test_meshes_of_one_name_are_told_apart(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "chair_1.off").write_bytes(CHAIR.read_bytes())
    found = cases.mesh_cases(
        MeshCollection.from_paths(tmp_path), [], lambda key: views.paper100(), n_points=5, seed=0, most_views=3
    )
    assert len({case.label for case in found}) == 2
    (single,) = cases.mesh_cases(
        MeshCollection.from_paths(CHAIR), [], lambda key: views.paper100(), n_points=5, seed=0, most_views=3
    )
    assert single.label == "chair_0003"
    question = single.make_question()
    assert len(question.views) == 3
    assert np.allclose(
        np.linalg.norm(question.views.eyes - question.mesh.centre, axis=1), 4 * question.mesh.longest_side
    )


# ---- Table 2 --------------------------------------------------------------------------------------------------------


def test_the_papers_last_column_is_the_quotient_of_two_others() -> None:
    assert [round(row.samples_per_megabyte, 2) for row in TABLE_2] == [1.04, 65.32, 2.26, 1.35, 0.62, 28.82]


def test_our_row_counts_clouds_and_every_file_that_is_needed(tmp_path: Path) -> None:
    plan = Plan(
        MeshCollection([MeshEntry("b", "box", "train", box)]),
        DatasetConfig(method="oracle", views="ring:4@10", n_points=90, sample_size=30),
        "packed",
    )
    generate(plan, tmp_path / "out")
    (tmp_path / "out" / "notes.txt").write_text("x" * 10_000)
    row = row_of(tmp_path / "out")
    names = ("packed-000000.zip", "plan.json", "manifest.json", "shape_names.txt", "mesh_keys.txt")
    size = sum((tmp_path / "out" / name).stat().st_size for name in names)
    assert row == ("This one (packed)", 4, 1, "Synthesized", "Point Cloud", size / 1e6)
    text = table_2(tmp_path / "out").as_markdown(aligned=True).splitlines()
    assert len({len(line) for line in text}) == 1
    assert text[0].split("|")[1].strip() == "Dataset name"
    assert text[-2].split("|")[-2].strip() == "28.82"
    assert text[-1].split("|")[-2].strip() == f"{4 / (size / 1e6):,.2f}"
