"""The report: made from rows alone, self-contained; in a browser the cloud is drawn and turns."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from tests.browser import open_page
from tests.scenes import box, two_plates
from zbuf_occlude import views
from zbuf_occlude.base.errors import DatasetError
from zbuf_occlude.drawing.pages import Table, write_pages
from zbuf_occlude.studies.compare import comparison_report as report
from zbuf_occlude.studies.compare.cases import Case, Subject, sample_question
from zbuf_occlude.studies.compare.run import ComparisonFolder, run

SUBJECTS = [Subject("oracle"), Subject("embree"), *(Subject("occupancy_grid", {"n": n}) for n in (4, 8))]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small comparison with all parts of a report."""
    out = tmp_path_factory.mktemp("comparison")
    around = views.modelnet8()
    cases = [
        Case(
            "meshes",
            name,
            lambda name=name, mesh=mesh: sample_question(name, mesh, around, n_points=500, seed=0),
            SUBJECTS,
        )
        for name, mesh in (("plates", two_plates()), ("a <b>box</b>", box()))
    ]
    cases += [
        Case(
            "scaling",
            f"{n} points",
            lambda n=n: sample_question("box", box(), around, n_points=n, seed=0),
            [Subject("embree")],
            compared=False,
            facts={"sweep": "points"},
        )
        for n in (200, 400, 800)
    ]
    run(cases, out, budget=0.3)
    report.write_report(out)
    return out


def test_what_is_written(folder: Path) -> None:
    names = {path.name for path in folder.iterdir() if path.is_file()}
    assert {"report.html", "report.md", "rows.jsonl", "pareto.png", "resolution.png", "scaling.png"} <= names
    text = (folder / "report.md").read_text()
    assert "`oracle`" in text
    assert "better method" in text
    assert "| `occupancy_grid:n=8` |" in text
    for image in re.findall(r"\]\((\w+\.png)\)", text):
        assert (folder / image).stat().st_size > 5_000


def test_the_page_needs_nothing_else(folder: Path) -> None:
    page = (folder / "report.html").read_text()
    assert not re.findall(r"""(?:src|href)=["'](?!data:)""", page)
    assert "http" not in page
    assert "a &lt;b&gt;box" in page, "names are escaped"
    assert "<b>box" not in page


def test_the_report_computes_no_visibility(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*args: object, **kwargs: object) -> None:
        raise AssertionError("visibility was computed")

    monkeypatch.setattr("zbuf_occlude.visibility.interface.VisibilityQuery.visible", refuse)
    before = (folder / "report.md").read_text()
    report.write_report(folder)
    assert (folder / "report.md").read_text() == before


def test_outcomes_of_a_worst_view_add_up(folder: Path) -> None:
    store = ComparisonFolder(folder)
    rows = [row for row in store.rows().values() if row["suite"] == "meshes"]
    for row in rows:
        outcomes = store.load_arrays("worst", row["key"])["outcomes"]
        assert np.mean(outcomes == 2) == pytest.approx(row["worst"]["false_visible"])
        assert np.mean(outcomes == 3) == pytest.approx(row["worst"]["false_hidden"])
    assert any(row["worst"]["false_visible"] > 0 for row in rows)
    assert not any(
        (store.load_arrays("worst", row["key"])["outcomes"] >= 2).any() for row in rows if row["subject"] == "oracle"
    )


LOOK = """
const canvas = document.getElementById("worst-view");
await frame();
const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
const counts = {drawn: 0, falseVisible: 0, hash: 0, left: Infinity, right: 0};
const column = (i) => (i / 4) % canvas.width;
for (let i = 0; i < data.length; i += 4) {
  const [r, g, b] = [data[i], data[i + 1], data[i + 2]];
  if (r + g + b === 765) continue;
  counts.drawn++;
  counts.hash = (counts.hash * 31 + i + r + 3 * g + 5 * b) % 1000003;
  counts.left = Math.min(counts.left, column(i));
  counts.right = Math.max(counts.right, column(i));
  if (r === 213 && g === 94 && b === 0) counts.falseVisible++;
}
return counts;
"""
SELECT = "const e = document.getElementById('{}'); e.value = '{}'; e.dispatchEvent(new Event('change'));"
NAMES = "return [...document.getElementById('{}').options].map((option) => option.value)"


@pytest.mark.needs("chromium")
def test_in_a_browser_the_cloud_is_drawn_and_turns(folder: Path, tmp_path: Path) -> None:
    with open_page(folder / "report.html", tmp_path) as page:
        assert page.ask(NAMES.format("mesh")) == ["plates", "a <b>box</b>"], "the one with more errors is first"
        page.ask(SELECT.format("mesh", "a <b>box</b>"))
        assert sorted(page.ask(NAMES.format("subject"))) == sorted(s.label for s in SUBJECTS)
        page.ask(SELECT.format("subject", "occupancy_grid:n=4"))
        first = page.ask(LOOK)
        assert first["drawn"] > 2_000, "the canvas shows a cloud"
        assert first["falseVisible"] > 50, "with its errors in their colour"

        page.ask("document.getElementById('worst-view').scrollIntoView({block: 'center'})")
        box = page.ask("return document.getElementById('worst-view').getBoundingClientRect().toJSON()")
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.drag((x, y), (x + 120, y + 30))
        turned = page.ask(LOOK)
        assert turned["hash"] != first["hash"], "dragging turns it"
        assert turned["drawn"] > 1_000
        page.wheel((x, y), -200)
        nearer = page.ask(LOOK)
        assert nearer["right"] - nearer["left"] > 1.15 * (turned["right"] - turned["left"]), "the wheel zooms"
        page.ask("document.getElementById('aside').click()")
        assert page.ask(LOOK) == first, "and it goes back"

        page.ask("document.querySelector('.legend input[value=\"2\"]').click()")
        assert page.ask(LOOK)["falseVisible"] == 0, "an outcome can be left out"
        page.ask("document.querySelector('.legend input[value=\"2\"]').click()")
        page.ask(SELECT.format("subject", "oracle"))
        right = page.ask(LOOK)
        assert right["drawn"] > 1_000
        assert right["falseVisible"] == 0, "the reference makes no errors"
        assert "azimuth" in page.ask("return document.getElementById('fact').textContent")
        images = page.ask("return [...document.images].map((image) => image.naturalWidth)")
        assert len(images) >= 4
        assert min(images) > 100, "every plot is in the page"


@pytest.mark.needs("chromium")
@pytest.mark.parametrize("script", ["nothing.here()", "console.error('oh')", "Promise.reject(new Error('late'))"])
def test_a_pages_error_would_be_seen(script: str, tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    path.write_text(f"<html><head></head><body><script>{script}</script></body></html>")
    with pytest.raises(AssertionError, match="logged errors"), open_page(path, tmp_path) as page:
        assert page.ask("return 1 + 1") == 2


def test_no_rows_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"must hold a comparison's rows.jsonl"):
        report.write_report(tmp_path)


def test_only_failures_still_make_a_report(tmp_path: Path) -> None:
    row = {"key": "", "suite": "meshes", "case": "a", "subject": "oracle", "status": "failed", "reason": "no | luck"}
    (tmp_path / "rows.jsonl").write_text(
        json.dumps(row | {"machine": "m", "facts": {}, "method": "oracle", "options": {}}) + "\n"
    )
    report.write_report(tmp_path)
    assert "no \\| luck" in (tmp_path / "report.md").read_text()


def test_tables_in_both_forms(tmp_path: Path) -> None:
    table = Table("T", ["a", "b"], [["`x<y`", "**1**"]], "note")
    text = "## T\n\n| a | b |\n| ---- | ---: |\n| `x<y` | **1** |\n\nnote\n"
    assert table.as_markdown() == text
    aligned = table.as_markdown(aligned=True).splitlines()
    assert aligned[2:5] == ["| a     |     b |", "| ----- | ----: |", "| `x<y` | **1** |"]
    page, markdown = write_pages(tmp_path, "r", "R <1>", answers=["`a`"], facts=["b"], sections=[table])
    assert "<td><code>x&lt;y</code></td><td class=number><b>1</b></td>" in page.read_text()
    assert "<h1>R &lt;1&gt;</h1>" in page.read_text()
    assert markdown.read_text() == f"# R <1>\n\n`a`\n\nb\n\n{text}"
