"""Datasets of scans: records in closed form, the same bytes however made, verify, bad input."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.browser import open_page
from tests.cli.conftest import Run
from zbuf_occlude.datasets.folder import read_finished
from zbuf_occlude.datasets.formats import find_format
from zbuf_occlude.datasets.gallery import RAINBOW

GIVEN = "--sensor vlp-32c --range 6..12 --views ring:2@0 --method embree --limit 2 --size airplane=5 --sample-size 64"
STREET = "--scene street --hidden 0.2..0.4 --keep all --scale mesh --keep-clean"


def records_of(out: Path) -> Any:
    plan, manifest = read_finished(out)
    source = find_format(plan.format).load().read(out, plan, manifest["files"])
    records = source.take(np.concatenate(list(source.order.values())))
    return records[np.lexsort((records["view_id"], records["mesh_id"]))]


@pytest.fixture
def street(run: Run, kept: Path) -> Path:
    """Scans in streets, made once."""
    if not (kept / "street" / "manifest.json").exists():
        run(f"generate {GIVEN} {STREET} --workers 1 --out {kept}/street")
    return kept / "street"


def test_what_a_record_has(street: Path) -> None:
    records = records_of(street)
    assert len(records) == 4
    for record in records:
        positions = record["data"].astype(float)
        eye = -record["pose"][:3, :3].T @ record["pose"][:3, 3]
        along = positions - eye
        assert np.allclose(np.linalg.norm(along, axis=1), record["range"], rtol=1e-4)
        assert np.abs(record["range"] - record["clean_range"]).max() < 0.3
        cosines = -(along * record["normal"]).sum(axis=1) / record["range"]
        assert np.allclose(np.cos(record["incidence"]), cosines, atol=2e-2)
        albedos = record["intensity"] * record["clean_range"] ** 2 / np.cos(record["incidence"])
        for instance in set(record["instance"].tolist()):
            mine = albedos[record["instance"] == instance]
            assert np.allclose(mine, mine[0], rtol=1e-2)
            assert 0.049 < mine[0] < 0.81
        assert 1 in record["instance"]  # the ground
        assert ((record["face_ids"] >= 0) == (record["instance"] == 0)).all()
        assert 0 <= record["ring"].min() < record["ring"].max() < 32
        assert 0.18 <= record["hidden"] <= 0.42
        assert record["hidden_reached"] == 1
        assert record["visible_fraction"] == pytest.approx(1 - record["hidden"])
        assert record["size"] in (5.0, 2.1)  # a bed has 2.1 m
        assert 6.0 <= np.hypot(*eye[:2]) <= 12.0
        assert record["n_visible"] > 500


def test_resume_verify_show_and_convert(run: Run, street: Path, tmp_path: Path) -> None:
    assert "points scanned again: the same" in run(f"verify {street} --samples 4").out
    run(f"generate {GIVEN} {STREET} --workers 1 --out {street}")  # nothing to do
    run(f"show {street}")
    run(f"convert {street} --format npz --out npz")
    before, after = records_of(street), records_of(tmp_path / "npz")
    for name in before.dtype.names:
        assert np.array_equal(before[name], after[name]), name


@pytest.mark.needs("chromium")
def test_the_gallery_colours_scans_by_what_they_know(run: Run, street: Path, tmp_path: Path) -> None:
    run(f"show {street}")
    with open_page(street / "gallery.html", tmp_path) as page:
        said = page.ask("return document.getElementById('fact').textContent")
        assert re.search(r"it measures [\d,]+ points; others hide \d+\.\d% of the object; \d+ are shown\.$", said)
        names = page.ask("return [...document.getElementById('colour').options].map((o) => o.value)")
        assert names == ["", "range", "incidence", "ring", "instance"]
        seen = page.ask(
            "const found = []; const select = document.getElementById('colour');"
            "for (const name of ['', 'range', 'instance']) {"
            "  select.value = name; select.dispatchEvent(new Event('change')); await frame();"
            "  found.push(new Set(gallery.large.cloud.codes).size); } return found"
        )
        page.screenshot(tmp_path / "page.png")
    assert seen[0] == 2  # of its class, and the line to its camera
    ramps = set()  # one of the clouds is shown, its ranges as steps of the ramp from its nearest to its farthest
    for values in records_of(street)["range"].astype(float):
        steps = (values - values.min()) / np.ptp(values) * (len(RAINBOW) - 1)
        ramps.add(len(np.unique(np.round(steps))))
    assert seen[1] in ramps
    assert min(ramps) > 1
    assert 1 < seen[2] <= 8


def test_every_scan_keeps_its_own_number_of_points(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "all"
    run(f"generate {GIVEN} --sample-size all --scale mesh --workers 1 --out all")
    records = records_of(out)
    sizes = [len(record["data"]) for record in records]
    assert sizes == records["n_visible"].tolist()
    assert len(set(sizes)) == len(sizes) == 4
    for record in records:
        assert {len(record[name]) for name in ("range", "ring", "normal", "instance")} == {len(record["data"])}
    assert f"{sum(sizes)} points scanned again: the same" in run("verify all --samples 4").out
    run("show all")
    run("convert all --format webdataset --out tars")
    for one, other in zip(records, records_of(tmp_path / "tars"), strict=True):
        assert all(np.array_equal(one[name], other[name]) for name in records.dtype.names)
    plain = run(f"generate {GIVEN} --sample-size all --dry-run --out dry")
    assert "= 4 clouds of all visible points in 2 shards" in plain.out


def test_the_targets_points_alone_and_the_camera_frame(run: Run, tmp_path: Path) -> None:
    run(f"generate {GIVEN} --scale mesh --format npz --workers 1 --out a")
    run(f"generate {GIVEN} --scale mesh --format npz --workers 1 --out b --frame camera")
    for one, other in zip(records_of(tmp_path / "a"), records_of(tmp_path / "b"), strict=True):
        assert (one["instance"] == 0).all()
        assert (one["hidden"], one["hidden_reached"]) == (0.0, 1)
        turn, shift = one["pose"][:3, :3], one["pose"][:3, 3]
        assert np.allclose(one["data"] @ turn.T + shift, other["data"], atol=1e-4)
        assert np.allclose(one["normal"] @ turn.T, other["normal"], atol=1e-5)
        assert np.ptp(one["data"], axis=0).max() < 1.05 * one["size"] + 0.3


def test_an_object_that_no_ray_meets_gives_no_cloud(run: Run, tmp_path: Path) -> None:
    run(
        "generate --sensor pinhole:width=2,height=2,fov=60 --range 900 --views ring:3@0 --method embree "
        "--limit 1 --size 1 --workers 1 --out none",
        code=1,
        says="at least one mesh must give a cloud",
    )
    (sidecar,) = (tmp_path / "none" / "shards").glob("*.json")
    assert json.loads(sidecar.read_text())["counts"]["n_blind_views"] == 3


def test_of_a_range_that_begins_within_an_object_what_is_outside_is_taken(run: Run, tmp_path: Path) -> None:
    """So that one range does for small and large classes; an airplane of 5 m is never seen from within."""
    run(
        f"generate {GIVEN} --range 0.1..2.6 --views ring:8@0 --limit 1 --workers 1 --out near",
        says="the range starts at half the object's size for: airplane (2.5 m)",
    )
    poses = records_of(tmp_path / "near")["pose"]
    assert (np.linalg.norm(poses[:, :3, 3], axis=1) > 2.49).all()


def test_a_range_within_an_object_is_refused(run: Run, tmp_path: Path) -> None:
    words = "--range must be more than half the size of every object; class airplane has 5 m"
    run(f"generate {GIVEN} --range 2..2.5 --out wrong", code=2, says=words)
    assert not (tmp_path / "wrong").exists()


def test_a_camera_is_rolled_as_its_view_says(run: Run, tmp_path: Path) -> None:
    run(
        "generate --sensor pinhole:width=80,height=4,fov=40 --views random-so3:3 --distance 2 --limit 1 --scale mesh "
        "--sample-size 64 --workers 1 --out rolled"
    )
    for record in records_of(tmp_path / "rolled"):
        eye_space = record["data"] @ record["pose"][:3, :3].T + record["pose"][:3, 3]
        heights = eye_space[:, 1] / -eye_space[:, 2]
        assert np.abs(heights).max() < 2.0 * np.tan(np.radians(20)) / 40 + 1e-4, "within the rows of the picture"


@pytest.mark.parametrize("format", ["hdf5", "mvp"])
def test_an_object_out_of_the_sensor_s_reach(run: Run, format: str) -> None:
    """It is said what the sensor measures, and by which options to choose."""
    run(
        f"generate --sensor kinect-v1 --range 50 --method embree --limit 1 --workers 1 --format {format} --out out",
        code=1,
        says="too far for kinect-v1, which measures at 0.8 to 4 m. Choose other --views, --range or --size",
    )


def test_a_lidar_that_moves(run: Run, tmp_path: Path) -> None:
    """As reported and deskewed, points are apart by velocity times time; workers and a resume change nothing."""
    still = f"generate {GIVEN} --set-sensor noise=0 --scale mesh --sample-size all --workers 1"
    moving = f"{still} --velocity 20,0,0"
    run(f"{moving} --out a")
    run(f"{moving} --out two --workers 2")
    run(f"{moving} --out deskewed --deskew")
    found, undone = records_of(tmp_path / "a"), records_of(tmp_path / "deskewed")
    for one, other, third in zip(found, undone, records_of(tmp_path / "two"), strict=True):
        assert all(np.asarray(one[name]).tobytes() == np.asarray(third[name]).tobytes() for name in one.dtype.names)
        rays = np.lexsort((one["ring"], one["column"])), np.lexsort((other["ring"], other["column"]))
        before, after = one["data"][rays[0]], other["data"][rays[1]]
        forward = -one["pose"][2, :3]
        assert after - before == pytest.approx(20.0 * one["time"][rays[0], None] * forward, abs=1e-4)
        assert np.ptp(one["time"]) > 1e-3
    run(f"{still} --out a", code=1, says="motion")
    run("verify a --samples 2")
