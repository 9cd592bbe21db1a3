"""`show`: the gallery in a real browser, used as a person would; the contact sheet; Table 2."""

import base64
import json
from pathlib import Path

import numpy as np
import pytest

from tests.browser import open_page
from tests.cli.conftest import Run

SMALL = "--method oracle --views fibonacci:9 --points 400 --sample-size 100 --workers 1"


@pytest.fixture
def dataset(run: Run, modelnet: Path, tmp_path: Path) -> Path:
    out = tmp_path / "out"
    run(f"generate {modelnet} --out {out} {SMALL} --format packed")
    return out


def test_pictures_go_where_they_are_wanted(run: Run, dataset: Path, tmp_path: Path) -> None:
    outcome = run(f"show {dataset} --out pictures")
    assert outcome.out.split() == ["gallery", "pictures/gallery.html", "picture", "pictures/contact_sheet.png"]
    assert (tmp_path / "pictures" / "contact_sheet.png").read_bytes().startswith(b"\x89PNG")
    text = (tmp_path / "pictures" / "gallery.html").read_text()
    assert "src=" not in text, "one file, needs nothing else"
    assert "http" not in text


def test_pairs_of_a_layout_are_drawn_too(run: Run, modelnet: Path, tmp_path: Path) -> None:
    run(f"generate {modelnet} --out out --method oracle --format epn3d --views fibonacci:6 --points 2048 --workers 1")
    assert "gallery" in run("show out").out
    page = (tmp_path / "out" / "gallery.html").read_text()
    clouds = json.loads(page.partition('id="clouds">')[2].partition("</script>")[0])["classes"]
    assert [len(row["clouds"]) for row in clouds] == [6, 6]
    for cloud in (cloud for row in clouds for cloud in row["clouds"]):
        codes = np.frombuffer(base64.b64decode(cloud["codes"]), np.uint8)
        assert np.bincount(codes)[:2].tolist() == [2048, 1000], "the partial cloud, and points of the complete one"
        places = np.frombuffer(base64.b64decode(cloud["positions"]), "<i2").reshape(-1, 3) / 32767
        assert np.linalg.norm(places[codes < 2], axis=1).max() == pytest.approx(0.55, abs=1e-3), "fits whichever way"
    run(f"generate {modelnet} --out whole --method oracle --format shapenet55 --points 8192 --workers 1")
    assert "shapenet55" in run("show whole", code=1).err


def test_table2_is_data_on_standard_output(run: Run, dataset: Path) -> None:
    outcome = run(f"paper table2 {dataset}")
    assert outcome.err == ""
    old = run(f"show {dataset} --table2")
    assert old.out == outcome.out
    assert "is now `zbuf-occlude paper table2 DIR`" in old.err
    assert not (dataset / "gallery.html").exists()
    last = [cell.strip() for cell in outcome.out.splitlines()[-1].strip("|").split("|")]
    assert last[:5] == ["This one (packed)", "72", "2", "Synthesized", "Point Cloud"]


@pytest.mark.needs("chromium")
def test_the_gallery_in_a_browser(run: Run, dataset: Path, tmp_path: Path) -> None:
    run(f"show {dataset}")
    with open_page(dataset / "gallery.html", tmp_path) as page:
        headings = page.ask("return [...document.querySelectorAll('.row h3')].map((e) => e.textContent)")
        assert headings == ["ball", "brick"]
        cells = "return [...document.querySelectorAll('.row')].map((r) => r.querySelectorAll('canvas').length)"
        assert page.ask(cells) == [6, 6]
        # every canvas shows something: pixels that are not background
        inked = """
            await frame();
            return [...document.querySelectorAll("canvas")].map((canvas) => {
              const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
              let n = 0;
              for (let i = 0; i < pixels.length; i += 4) n += pixels[i] !== 255 || pixels[i + 1] !== 255;
              return n;
            });"""
        counts = page.ask(inked)
        assert len(counts) == 13
        assert min(counts) > 100
        label = "return document.querySelector('.cell.chosen canvas').getAttribute('aria-label')"
        assert page.ask(label).startswith("ball")

        # a click on another cloud shows it large, and says which it is
        place = page.ask(
            "const box = document.querySelectorAll('.row')[1].querySelectorAll('canvas')[2].getBoundingClientRect();"
            "return [box.x + box.width / 2, box.y + box.height / 2, box.y + box.height];"
        )
        assert place[2] < 900, "in the window"
        page.drag((place[0], place[1]), (place[0], place[1]))
        fact = page.ask("return document.getElementById('fact').textContent")
        assert fact.startswith("brick, brick/")
        assert "camera at azimuth" in fact
        assert page.ask("return document.querySelectorAll('.cell.chosen').length") == 1

        # dragging the large one turns it; all turn when they are told to
        before = page.ask("return [gallery.large.azimuth, ...gallery.small.map((v) => v.azimuth)]")
        box = page.ask(
            "const b = gallery.large.canvas.getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2]"
        )
        page.drag((box[0], box[1]), (box[0] + 50, box[1]))
        after = page.ask("return [gallery.large.azimuth, ...gallery.small.map((v) => v.azimuth)]")
        assert after[0] == pytest.approx(before[0] - 20)
        assert after[1:] == before[1:]
        page.ask("document.getElementById('all').click(); await frame();")
        together = page.ask("return gallery.small.map((v) => v.azimuth)")
        assert set(together) == {after[0]}
        page.ask("document.getElementById('camera').click(); await frame();")
        assert page.ask("return gallery.large.azimuth === gallery.large.camera.azimuth")


@pytest.mark.parametrize("command", ["show", "status", "merge", "verify", "convert --format npz --out other"])
def test_a_folder_of_crops_is_refused_with_what_reads_it(run: Run, tmp_path: Path, command: str) -> None:
    (tmp_path / "crops" / "car").mkdir(parents=True)
    np.save(tmp_path / "crops" / "car" / "a.npy", np.eye(3))
    (tmp_path / "crops" / "objects.csv").write_text("file,class\ncar/a.npy,car\n")
    run(f"{command} crops", code=1, says="folder of cloud files, such as `crop` makes. `view`, `train`")
    assert not (tmp_path / "other").exists()
