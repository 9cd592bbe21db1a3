"""Names that are not UTF-8, contain control characters or markup, or are paths: commands work and escape them."""

import csv
import html
import os
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from tests.cli.conftest import Run, write_off
from tests.scenes import box
from zbuf_occlude import cli
from zbuf_occlude.base.errors import escape_control
from zbuf_occlude.drawing.pages import Table, marked_up, verbatim

OFF = b"OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 1 3\n3 0 2 3\n3 1 2 3\n"
CLASSES = (b"<img src=x onerror=alert(1)>", b"a|b\x1b[31m\xff")
MESHES = {b"x\n| y.off": OFF, b"**b** `c` [l](javascript:1) $e$.off": OFF, b"\xfe<u>.off": b"OFF\n9 9 9\n"}
SMALL = ("--points", 60, "--method", "oracle")
COMMANDS_PER_TERMINAL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff]")


@pytest.fixture
def meshes(tmp_path: Path) -> Path:
    """Class folders with two valid meshes and a broken one each."""
    root = os.fsencode(tmp_path) + b"/in\xff<s>"
    for label in CLASSES:
        os.makedirs(root + b"/" + label)
        for name, content in MESHES.items():
            Path(os.fsdecode(root + b"/" + label + b"/" + name)).write_bytes(content)
    return Path(os.fsdecode(root))


class Elements(HTMLParser):
    """Parser of the elements of a page."""

    def __init__(self, page: Path | str) -> None:
        super().__init__()
        self.found: set[str] = set()
        self.feed(page if isinstance(page, str) else page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.found.add(tag if "onerror" not in dict(attributes) else "hostile")


def test_datasets_of_odd_names(run: Run, meshes: Path, tmp_path: Path) -> None:
    out = Path(os.fsdecode(os.fsencode(tmp_path) + b"/out\xfe<u>\x1b[31m"))
    odd = ("--views", "ring:2@20", "--sample-size", 16, "--workers", 1)
    for code, *arguments in (
        (3, "generate", meshes, "--out", out, *SMALL, *odd),
        (3, "generate", meshes, "--out", out, *SMALL, *odd),
        (0, "status", out),
        (0, "verify", out),
        (0, "show", out),
        (0, "paper", "table2", out),
        (0, "convert", out, "--format", "npz", "--out", out / "a\x1b\udcffb"),
    ):
        outcome = run(*arguments, code=code)
        assert not COMMANDS_PER_TERMINAL.search(outcome.out + outcome.err), (outcome.out, outcome.err)
        assert "Traceback" not in outcome.err
        if arguments[0] == "status":
            assert f"failed      a|b\\x1b[31m\\xff/\\xfe<u>.off: {escape_control(str(meshes))}" in outcome.out
    assert Elements(out / "gallery.html").found.isdisjoint({"img", "u", "s", "hostile"})


def test_reports_of_odd_names(run: Run, meshes: Path, tmp_path: Path) -> None:
    out = Path(os.fsdecode(os.fsencode(tmp_path) + b"/out\xfe<u>"))
    outcome = run("compare", meshes, "--out", out, *SMALL, "--views", "ring:2@20", "--judge-points", 20, code=3)
    assert not COMMANDS_PER_TERMINAL.search(outcome.out + outcome.err.replace("\r", ""))
    text = (out / "report.md").read_text(encoding="utf-8")
    assert not COMMANDS_PER_TERMINAL.search(text)
    assert "<" not in text
    assert "&lt;img src=x onerror=alert(1)&gt;/x&#92;n\\| y.off" in text
    assert Elements(out / "report.html").found.isdisjoint({"u", "s", "hostile"})


@pytest.mark.parametrize(
    "name", ["a|b", "`c`", "**b**", "\\", "\\|", "<script>", "&lt;", "[a](b)", "_x_", "a_b", "é😀"]
)
def test_a_name_is_no_markup(name: str) -> None:
    cell = verbatim(name)
    assert html.unescape(marked_up(cell)) == html.unescape(cell) == name
    assert marked_up(f"`{1}` {cell} **x** <") == f"<code>1</code> {cell} <b>x</b> &lt;"
    assert Elements(marked_up(cell)).found == set()
    markdown = pytest.importorskip("markdown", reason="rendering Markdown needs the package markdown")
    table = Table("", ["", ""], [[cell, "a|b"]]).as_markdown()
    cells = re.findall("<td.*?>(.*?)</td>", markdown.markdown(table, extensions=["tables"]))
    assert [html.unescape(each) for each in cells] == [name, "a|b"]
    assert html.unescape(markdown.markdown(f"{cell} x")) == f"<p>{name} x</p>"


def test_commands_print_by_echo_alone() -> None:
    files = Path(cli.__file__).parent.glob("*.py")
    others = [path.name for path in files if "click.echo" in path.read_text(encoding="utf-8")]
    assert others == ["shell.py"]


PATHS = ("..", ".", "../../..", "/etc", "a/b", "~", "...", "-x", "CON", "a\\b")


@pytest.mark.parametrize("layout", ["ply --sample-size 16", "webdataset --sample-size 16", "completion3d"])
def test_files_of_classes_that_are_paths_lie_in_the_datasets_folder(run: Run, tmp_path: Path, layout: str) -> None:
    inside = tmp_path / "above" / "further" / "above"
    with (tmp_path / "labels.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["key", "class"])
        for number, label in enumerate(PATHS):
            write_off(tmp_path / "meshes" / f"m{number}.off", box().vertices, box().faces)
            rows.writerow([f"m{number}", label])
    line = f"generate meshes --labels labels.csv --method exact --views ring:1@20 --points 2048 --format {layout}"
    line += f" --workers 1 --out {inside}/out"
    run(line)
    assert list(inside.iterdir()) == [inside / "out"]
    run(f"verify {inside}/out")
    if layout.startswith("ply"):
        files = list(inside.rglob("*.ply"))
        assert len(files) == len(PATHS)
        assert {path.parents[1] for path in files} == {inside / "out" / "ply" / "train"}
    run(f"{line} --seed 1 --overwrite")
    assert list(inside.iterdir()) == [inside / "out"]
