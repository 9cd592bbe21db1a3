"""The numbers of the pages are those of docs/figures.json, and each part that makes them can be run."""

import importlib
import re
import shlex
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "benchmarks"))

import figures  # noqa: E402
import parts  # noqa: E402

PAGES = [page.relative_to(ROOT).as_posix() for page in figures.pages()]
BLOCKS = {page: figures.marked((ROOT / page).read_text(encoding="utf-8")) for page in PAGES}


@pytest.mark.parametrize("page", [page for page in PAGES if BLOCKS[page]])
def test_blocks_are_what_was_measured(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    assert text == figures.rendered(text, figures.read()), "python benchmarks/all.py --pages makes the blocks anew"


def test_what_was_measured_is_shown_and_can_be_measured_again() -> None:
    known = figures.read()
    names = {part.name for part in parts.PARTS}
    assert len(names) == len(parts.PARTS)
    assert names == {mark.partition("/")[0] for marks in BLOCKS.values() for mark in marks}, "each part has its page"
    assert set(known) <= names
    for name, figure in known.items():
        assert re.fullmatch(r"20\d\d-\d\d-\d\d", figure["date"]), name
        assert figure["value"], name
        assert figure["machine"], name


def test_what_was_measured_was_written_by_all_py() -> None:
    known, commands = figures.read(), {part.name: part.command for part in parts.PARTS}
    for name, figure in known.items():
        assert figure["seconds"] > 0, f"python benchmarks/all.py {name} writes it"
        assert figure["command"] == commands[name], f"{name}: measure it again by the command that it has now"


@pytest.mark.parametrize("part", parts.PARTS, ids=lambda part: part.name)
def test_commands_are_of_the_repository(part: parts.Part) -> None:
    for command in (part.command, part.cheap):
        first, second, *_ = shlex.split(command)
        assert first in (parts.PYTHON, parts.COMMAND)
        assert first == parts.COMMAND or (ROOT / second).is_file(), command
    assert 0 < part.minutes <= 60


def test_commands_are_run_by_this_python_in_folders_of_this_machine(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    run = importlib.import_module("all")
    (tmp_path / "modelnet" / "bed" / "train").mkdir(parents=True)
    for name in ("b.off", "a.off"):
        (tmp_path / "modelnet" / "bed" / "train" / name).touch()
    monkeypatch.setenv("ZBUF_OCCLUDE_DATA", str(tmp_path))
    words = run.words_of("python benchmarks/own_surface.py ../shared/data/modelnet/*/train/*.off", Path("out"))
    assert words[:2] == [sys.executable, "benchmarks/own_surface.py"]
    assert [Path(word).name for word in words[2:]] == ["a.off", "b.off"]
    words = run.words_of("zbuf-occlude paper table3 --out OUT/study", tmp_path)
    assert words == [sys.executable, "-m", "zbuf_occlude", "paper", "table3", "--out", f"{tmp_path}/study"]


def test_a_number_changed_by_hand_is_noticed() -> None:
    figure = {"command": "python x.py", "date": "2026-01-02", "machine": "m", "seconds": 3, "value": ["| 1.5 |"]}
    text = "before\n<!-- figure: x -->\nold\n<!-- end of figure -->\nafter\n"
    made = figures.rendered(text, {"x": figure})
    assert made.splitlines()[:4] == ["before", "<!-- figure: x -->", "", "| 1.5 |"]
    assert "(`python x.py`, 2026-01-02, 3 s, m)" in made
    assert made.endswith("<!-- end of figure -->\nafter\n")
    assert figures.rendered(made, {"x": figure}) == made
    assert figures.rendered(made.replace("1.5", "1.4"), {"x": figure}) == made
    assert "(not measured yet: `python benchmarks/all.py x`)" in figures.rendered(made, {})


def test_a_section_of_a_report() -> None:
    lines = ["# Title", "", "intro", "", "## One: more", "", "![p](p.png)", "", "| a |", "", "note", "", "## Two", "x"]
    assert figures.section_of(lines, "One") == ["| a |", "", "note"]
    assert figures.section_of(lines, "Title") == ["intro"]
    with pytest.raises(KeyError, match="no heading begins with 'Three'"):
        figures.section_of(lines, "Three")
