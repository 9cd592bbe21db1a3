"""Rows survive: appended one by one, a torn last line is left out, a damaged one is named."""

from pathlib import Path
from typing import Any

import pytest

from zbuf_occlude.compare.run import ROWS, Store
from zbuf_occlude.errors import DatasetError


def row(subject: str, key: str = "k") -> dict[str, Any]:
    return {"key": key, "suite": "meshes", "case": "a", "subject": subject}


def test_the_last_row_of_a_subject_counts(tmp_path: Path) -> None:
    store = Store(tmp_path / "new" / "folder")
    assert store.rows() == {}
    for each in (row("x", "old"), row("y"), row("x", "new")):
        store.append(each)
    assert [r["key"] for r in store.rows().values()] == ["new", "k"]
    assert len((store.folder / ROWS).read_text().splitlines()) == 3


def test_a_torn_line_is_left_out_and_then_replaced(tmp_path: Path) -> None:
    store = Store(tmp_path)
    store.append(row("x"))
    with open(tmp_path / ROWS, "a") as file:
        file.write('{"key": "half')
    assert list(store.rows()) == [("meshes", "a", "x")]
    store.append(row("y"))
    assert [subject for _, _, subject in store.rows()] == ["x", "y"]


def test_a_damaged_line_is_named(tmp_path: Path) -> None:
    (tmp_path / ROWS).write_text('nonsense\n{"key": 1}\n')
    with pytest.raises(DatasetError, match="line 1 is not"):
        Store(tmp_path).rows()


def test_a_missing_cloud_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="Run compare again"):
        Store(tmp_path).load("worst", "k")
