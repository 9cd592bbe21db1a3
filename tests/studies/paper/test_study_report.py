"""study.html and study.md: made from results alone, self-contained, shown in a browser."""

import json
import re
import shutil
from pathlib import Path

import pytest

from tests.browser import open_page
from tests.studies.paper.hand_made import TINY, study_of_augmentation, study_of_elevation, study_of_methods
from zbuf_occlude.base.errors import DatasetError
from zbuf_occlude.studies.paper import study_report as report
from zbuf_occlude.studies.paper.results import AREAS, FOLDER, STUDY, Result

SHARES = [[0.2 + 0.004 * e, 1.0, 1.0 - 0.005 * abs(e)] for e in range(-90, 91, 10)]


def write(folder: Path, results: list[Result]) -> None:
    """Write results as a study does."""
    (folder / FOLDER).mkdir(parents=True)
    study = {
        "size": TINY.to_dict(),
        "objects": "shapes <b>",
        "date": "2026-01-02",
        "missing_methods": {"x": "no | luck"},
        "failed_meshes": {},
    }
    (folder / STUDY).write_text(json.dumps(study))
    areas = {"elevations": list(range(-90, 91, 10)), "planes": ["y-z", "x-z", "x-y"], "mean": SHARES, "n_objects": 3}
    (folder / AREAS).write_text(json.dumps(areas))
    for number, one in enumerate(results):
        tests = {
            name: {"truth": c.truth, "predicted": c.predicted, "confusion": c.counts.tolist()}
            for name, c in one.tests.items()
        }
        document = {**one.document, "experiment": one.experiment, "facts": dict(one.facts), "tests": tests}
        (folder / FOLDER / f"{number:03d}.json").write_text(json.dumps(document))


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a study with its report, made once."""
    out = tmp_path_factory.mktemp("written")
    write(out, [*study_of_augmentation(), *study_of_methods(), *study_of_elevation()])
    report.write_study(out)
    return out


@pytest.fixture
def folder(written: Path, tmp_path: Path) -> Path:
    return shutil.copytree(written, tmp_path / "study")


def test_the_page_needs_nothing_else_and_says_what_the_text_says(folder: Path) -> None:
    page, text = (folder / "study.html").read_text(), (folder / "study.md").read_text()
    assert not re.findall(r"""(?:src|href)=["'](?!data:)""", page)
    assert "<script" not in page
    assert "shapes &lt;b&gt;" in page
    for words in ("Do the paper's findings show?", "Table 3B of the paper", "Table 3A of the paper", "The dead angle"):
        assert f"## {words}" in text
        assert words.replace("'", "&#x27;") in page
    assert "no | luck" in text
    assert "Sryamkin" in page
    assert "A random guess is right in 50.0 % (of 2 classes)." in text
    assert "could not be used" not in text
    for picture in re.findall(r"\]\((\w+\.png)\)", text):
        assert (folder / picture).stat().st_size > 5_000
    assert len(re.findall(r"\]\(\w+\.png\)", text)) == 3


def test_meshes_that_failed_are_named(folder: Path) -> None:
    study = json.loads((folder / STUDY).read_text())
    (folder / STUDY).write_text(json.dumps({**study, "failed_meshes": {"car/test/car_0001.off": "no face"}}))
    report.write_study(folder)
    assert "1 mesh could not be used: car/test/car_0001.off." in (folder / "study.md").read_text()


def test_the_report_of_one_experiment_has_no_tables_of_the_other(tmp_path: Path) -> None:
    write(tmp_path / "one", study_of_elevation())
    report.write_study(tmp_path / "one")
    text = (tmp_path / "one" / "study.md").read_text()
    assert "Table 3A" in text
    assert "Table 3B" not in text
    assert not (tmp_path / "one" / "augmentation.png").exists()


@pytest.mark.needs("chromium")
def test_in_a_browser_every_plot_shows_and_nothing_is_cut_off(folder: Path, tmp_path: Path) -> None:
    with open_page(folder / "study.html", tmp_path) as page:
        assert page.ask("return document.title") == report.TITLE
        images = page.ask("return [...document.images].map((i) => [i.naturalWidth, i.getBoundingClientRect().width])")
        assert len(images) == 3
        assert min(natural for natural, _ in images) > 800
        assert min(shown for _, shown in images) > 400
        tables = page.ask("return [...document.querySelectorAll('table')].map((t) => t.rows.length)")
        assert len(tables) == 7
        assert min(tables) > 2
        assert page.ask("return document.documentElement.scrollWidth <= window.innerWidth"), "wide tables scroll alone"


def test_what_is_missing_or_damaged_is_said(tmp_path: Path, folder: Path) -> None:
    with pytest.raises(DatasetError, match=r"must hold a study; it has no study\.json"):
        report.write_study(tmp_path)
    whole = (folder / STUDY).read_text()
    study = json.loads(whole)
    for damaged in ([], {**study, "size": None}, *({n: study[n] for n in study if n != lost} for lost in study)):
        (folder / STUDY).write_text(json.dumps(damaged))
        with pytest.raises(DatasetError, match=r"study\.json is damaged"):
            report.write_study(folder)
    (folder / STUDY).write_text(whole)
    (folder / FOLDER / "000.json").write_text("{")
    with pytest.raises(DatasetError, match=r"000\.json must be a trial's result; it is damaged"):
        report.write_study(folder)
    document = json.loads((folder / FOLDER / "001.json").read_text())
    for change in (
        {"facts": {**document["facts"], "model": "alexnet"}},
        {"facts": {**document["facts"], "seed": "first"}},
        {"facts": {}},
        {"facts": []},
        {"experiment": "another"},
        {"tests": {"original": {"truth": ["bed", "car"], "predicted": [], "confusion": []}}},
        {"tests": {"original": {"truth": ["bed", "car"], "predicted": ["bed", "car"], "confusion": [[1, 2]]}}},
        {"tests": {"original": {"truth": ["bed"], "predicted": ["bed"], "confusion": [[-1]]}}},
        {"epochs": None},
        {"machine": {}},
    ):
        (folder / FOLDER / "000.json").write_text(json.dumps({**document, **change}))
        with pytest.raises(DatasetError, match=r"000\.json must be a trial's result; it is damaged"):
            report.write_study(folder)
    (folder / FOLDER / "000.json").unlink()
    areas = json.loads((folder / AREAS).read_text())
    for damaged in ([], {**areas, "mean": [[1.0]]}, {**areas, "planes": "xy"}, {**areas, "n_objects": None}):
        (folder / AREAS).write_text(json.dumps(damaged))
        with pytest.raises(DatasetError, match=r"areas\.json must hold projected areas; it is damaged"):
            report.write_study(folder)
    for path in (folder / FOLDER).iterdir():
        path.unlink()
    with pytest.raises(DatasetError, match="must hold results; it has none"):
        report.write_study(folder)
