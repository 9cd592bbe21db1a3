"""What `generate` says of the meshes before it begins: layout, classes x splits, warnings; and what selects them."""

from pathlib import Path

import pytest

from tests.cli.conftest import Run
from zbuf_occlude.cli.messages import MAX_ROWS, overview
from zbuf_occlude.datasets.formats import find_format
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry

TRIANGLE = "OFF 3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"


def plant(root: Path, *names: str) -> Path:
    for name in names:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(TRIANGLE)
    return root


def table(err: str) -> list[list[str]]:
    return [line.split() for line in err.splitlines()]


def test_the_table_comes_before_the_work(run: Run, modelnet: Path) -> None:
    outcome = run("generate", modelnet.parent, "--dry-run", says=f"{modelnet.parent}: layout ModelNet")
    rows = table(outcome.err)
    begin = rows.index(["class", "train", "test"])
    assert rows[begin + 1 :] == [["ball", "2", "2"], ["brick", "2", "2"], ["2", "classes", "4", "4"]]
    assert "warning" not in outcome.err
    assert "8 meshes x 25 views" in outcome.out


@pytest.mark.parametrize(
    ("names", "warning"),
    [
        (("all/chair/a.off", "all/bed/b.off"), "warning: one class, 'all': nothing to tell apart."),
        (("a/x.off", "b/x.off", "c/x.off"), "warning: one object per class"),
    ],
)
def test_what_looks_wrong_is_said(run: Run, tmp_path: Path, names: tuple[str, ...], warning: str) -> None:
    run("generate", plant(tmp_path / "m", *names), "--dry-run", says=warning)


def test_a_preset_with_fewer_objects_than_its_paper_says_so(run: Run, modelnet: Path) -> None:
    said = "warning: paper-modelnet40 has 200 objects in its paper; here are 8."
    run(f"generate {modelnet} --preset paper-modelnet40 --dry-run", says=said)


@pytest.mark.parametrize(("format", "warned"), [("pcn", True), ("projected-shapenet", False), ("hdf5", False)])
def test_what_published_tests_cannot_divide_is_said(run: Run, modelnet: Path, format: str, warned: bool) -> None:
    outcome = run(f"generate {modelnet} --format {format} --points 20000 --dry-run")
    assert ("needs at least 10 test objects; here are 4" in outcome.err) is warned


@pytest.mark.parametrize(("limit", "warned"), [(3, True), (8, True), (24, False)])
def test_splits_of_different_classes_are_said(run: Run, limit: int, warned: bool) -> None:
    """Built-in shapes: eight classes, three splits; what the table shows is what the warning says."""
    outcome = run(f"generate --limit {limit} --dry-run")
    warnings = [line for line in outcome.err.splitlines() if line.startswith("warning:")]
    rows = {label: numbers for label, *numbers in table(outcome.err) if len(numbers) == 3 and numbers[0].isdigit()}
    assert len(rows) == min(limit, 8)
    assert any("0" in numbers for numbers in rows.values()) is warned
    assert len(warnings) == warned
    assert all(word in line for line in warnings for word in ("different classes", "train lacks", "--limit"))


def test_splits_of_different_classes_without_a_limit(run: Run, modelnet: Path) -> None:
    (modelnet / "brick" / "test").rename(modelnet / "brick" / "val")
    said = "warning: the splits have different classes: val lacks ball; test lacks brick."
    assert "--limit" not in run(f"generate {modelnet} --dry-run", says=said).err


def test_labels_classes_and_splits(run: Run, modelnet: Path, tmp_path: Path) -> None:
    (tmp_path / "labels.csv").write_text("file,class,split\nball_0,sphere,test\nball_1.off,sphere,val\n")
    line = f"generate {modelnet} --dry-run"
    assert "2 meshes x" in run(f"{line} --classes ball --splits test").out
    run(f"{line} --classes bowl", code=2, says="class must be one of ball, brick; got 'bowl'")
    said = "a label must match one mesh; 'ball_0' matches ball/test/ball_0.off"
    run(f"{line} --labels labels.csv", code=2, says=said)
    outcome = run(f"generate {modelnet}/ball/train --dry-run --labels labels.csv")
    assert table(outcome.err)[-3:-1] == [["class", "val", "test"], ["sphere", "1", "1"]]


def test_many_classes_are_cut_short_and_counted() -> None:
    entries = [
        MeshEntry(f"{i}/{j}", f"class{i:03}", "train", lambda: None) for i in range(100) for j in range(2 + i // 50)
    ]  # type: ignore[arg-type,return-value]
    rows = table(overview(MeshCollection(entries), find_format("hdf5")))
    assert len(rows) == MAX_ROWS + 3
    assert rows[-2] == ["40", "more", "80"]
    assert rows[-1] == ["100", "classes", "250"]
