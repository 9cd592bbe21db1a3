"""Files are on the disk, whole, before anything says so. The suite does not wait for that (tests/conftest.py)."""

import os
from pathlib import Path

import numpy as np
import pytest

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.folder import SHARDS
from zbuf_occlude.dataset.generate import generate
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.dataset.shared import Rows, unfinished, write_npy
from zbuf_occlude.meshes.collection import MeshCollection


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, bytes]]:
    """The inode and the content of each file that the disk was asked to keep, as they were then."""
    seen: list[tuple[int, bytes]] = []

    def fsync(file: int) -> None:
        number = os.fstat(file).st_ino
        (path,) = (path for path in tmp_path.rglob("*") if path.stat().st_ino == number)
        seen.append((number, path.read_bytes()))

    monkeypatch.setattr(os, "fsync", fsync)
    return seen


@pytest.mark.parametrize("exclusive", [False, True])
def test_a_file_is_kept_before_it_has_its_name(
    tmp_path: Path, kept: list[tuple[int, bytes]], monkeypatch: pytest.MonkeyPatch, exclusive: bool
) -> None:
    n_kept = []
    for name in ("link", "replace"):
        original = getattr(os, name)
        monkeypatch.setattr(os, name, lambda *a, original=original: (n_kept.append(len(kept)), original(*a)))
    path = tmp_path / "file"
    atomic.write(path, lambda file: file.write(b"content"), exclusive=exclusive)
    assert kept == [(path.stat().st_ino, b"content")]
    assert n_kept[0] == 1


def test_rows_are_kept_when_they_are_written(tmp_path: Path, kept: list[tuple[int, bytes]]) -> None:
    (tmp_path / SHARDS).mkdir()
    values = np.arange(6.0).reshape(2, 3)
    write_npy(tmp_path, "rows.npy", Rows(1, 3, values))
    inode, content = kept[-1]
    path = unfinished(tmp_path, "rows.npy")
    assert inode == path.stat().st_ino
    assert content == path.read_bytes()
    assert np.array_equal(np.load(path)[1:], values)


def test_shards_are_not_kept_but_what_is_made_of_them_before_they_go(
    tmp_path: Path, kept: list[tuple[int, bytes]], monkeypatch: pytest.MonkeyPatch
) -> None:
    out, gone, original = tmp_path / "out", [], Path.unlink

    def unlink(path: Path, missing_ok: bool = False) -> None:
        if path.suffix == ".records" and path.exists():
            made = [*out.glob("*.h5"), *(out / SHARDS).glob("part-*.json")]
            numbers = {number for number, _ in kept}
            assert len(made) == 2
            assert {each.stat().st_ino for each in made} <= numbers
            assert path.stat().st_ino not in numbers
            gone.append(path)
        original(path, missing_ok)

    monkeypatch.setattr(Path, "unlink", unlink)
    (tmp_path / "tetrahedron.off").write_text(
        "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"
    )
    recipe = Recipe(method="oracle", views="ring:4@30", n_points=50, sample_size=8)
    generate(Plan(MeshCollection.from_paths([tmp_path / "tetrahedron.off"]), recipe), out)
    assert len(gone) == 1
