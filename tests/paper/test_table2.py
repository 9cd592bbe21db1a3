"""Table 2: the paper's rows as printed, ours as measured."""

from pathlib import Path

import pytest

from tests.scenes import box
from zbuf_occlude import DatasetError
from zbuf_occlude.dataset.generate import generate
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry
from zbuf_occlude.paper.table2 import PAPER, row_of, table_2


def test_the_papers_last_column_is_the_quotient_of_two_others() -> None:
    assert [round(row.samples_per_megabyte, 2) for row in PAPER] == [1.04, 65.32, 2.26, 1.35, 0.62, 28.82]


def test_our_row_counts_clouds_and_every_file_that_is_needed(tmp_path: Path) -> None:
    plan = Plan(
        MeshCollection([MeshEntry("b", "box", "train", box)]),
        Recipe(method="oracle", views="ring:4@10", n_points=90, sample_size=30),
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


def test_an_unfinished_dataset_has_no_row(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"must hold a dataset; it has no plan\.json"):
        row_of(tmp_path)
