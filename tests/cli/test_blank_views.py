"""Clouds that show next to nothing, and objects without any: counted, and named with the view and the reason."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.cli.conftest import Run, write_off
from tests.scenes import ACROSS, HALVES, box
from zbuf_occlude.datasets.source import open_dataset

ALONE = "--views ring:1@0 --size file --method exact --sample-size 8 --workers 1"
PINHOLE = "--sensor pinhole:width=60,height=60,fov=90 --set-sensor range_min=0.8"


def manifest(out: Path) -> dict[str, Any]:
    return dict(json.loads((out / "manifest.json").read_text()))


def sorted_records(out: Path) -> Any:
    """All records of a dataset, by mesh and view."""
    source = open_dataset(out)
    records = source.take(np.concatenate(list(source.order.values())))
    return records[np.lexsort((records["view_id"], records["mesh_id"]))]


def rays(path: Path, azimuths: np.ndarray) -> None:
    path.write_text("azimuth,elevation\n" + "".join(f"{float(azimuth)},0\n" for azimuth in azimuths))


@pytest.mark.parametrize(("n", "n_few"), [(2, 1), (15, 1), (16, 0), (17, 0)])
def test_clouds_of_a_few_points_are_counted(run: Run, tmp_path: Path, n: int, n_few: int) -> None:
    """Of a plate that every ray meets: a point per ray, 100 times each, so that only distinct ones tell."""
    write_off(tmp_path / "plate.off", ACROSS, HALVES)
    rays(tmp_path / "rays.csv", np.repeat(np.linspace(-2, 2, n), 100))
    outcome = run(f"generate plate.off --sensor rays.csv --range 5 {ALONE} --least-points 0 --out out")
    counts = manifest(tmp_path / "out")["counts"]
    assert (counts["clouds"], counts["clouds_of_fewer_than_16_distinct_points"]) == (1, n_few)
    assert ("1 of 1 cloud show fewer than 16 distinct points" in outcome.out) == bool(n_few)


@pytest.mark.parametrize(("least", "n_clouds"), [(None, 0), (15, 1), (16, 0)])
def test_scans_of_too_few_points_are_left_out(run: Run, tmp_path: Path, least: int | None, n_clouds: int) -> None:
    """Of 15 rays at a plate, 100 times each: fewer than the default, 16."""
    write_off(tmp_path / "plate.off", ACROSS, HALVES)
    rays(tmp_path / "rays.csv", np.repeat(np.linspace(-2, 2, 15), 100))
    given = "" if least is None else f"--least-points {least}"
    run(
        f"generate plate.off --sensor rays.csv --range 5 {ALONE} {given} --out out",
        code=1 - n_clouds,
        says="" if n_clouds else "only 15 distinct points, fewer than --least-points 16",
    )


@pytest.mark.parametrize("format", ["hdf5", "packed"])
def test_what_least_points_leaves_out_is_what_a_run_with_0_has_beside(run: Run, tmp_path: Path, format: str) -> None:
    line = (
        "generate --sensor vlp-16 --set-sensor columns=200 --range 5..60 --views ring:6@0 --limit 3 --sample-size 64 "
        f"--method exact --format {format} --workers 1"
    )
    outcome = run(f"{line} --out some")
    assert "left out" not in run(f"{line} --least-points 0 --out every").out
    some, every = (sorted_records(tmp_path / name) for name in ("some", "every"))
    n_points = np.array([len(np.unique(record["data"], axis=0)) for record in every])
    assert 0 < (n_points < 16).sum() < len(every) - 1
    assert some.tobytes() == every[n_points >= 16].tobytes()
    counts, n_sparse = manifest(tmp_path / "some")["counts"], int((n_points < 16).sum())
    assert counts["scans_of_too_few_points"] == n_sparse
    assert counts["clouds"] == len(every) - n_sparse
    assert counts["views_that_see_nothing"] == manifest(tmp_path / "every")["counts"]["views_that_see_nothing"]
    assert f"{n_sparse} scans of {len(every)} left out: fewer than 16 distinct points" in outcome.out
    blank = manifest(tmp_path / "some")["blank_views"]
    assert sum(each["n_views"] for each in blank.values()) == 18 - len(some)
    if format == "hdf5":
        run("verify some --samples 3")


def test_least_points_is_for_scans(run: Run) -> None:
    run("generate --least-points 4 --limit 1 --out out", code=2, says="--least-points is for scans; give --sensor")


def test_points_in_one_place_are_no_cloud(run: Run, tmp_path: Path) -> None:
    write_off(tmp_path / "plate.off", ACROSS, HALVES)
    rays(tmp_path / "rays.csv", np.zeros(300))
    run(f"generate plate.off --sensor rays.csv --range 5 {ALONE} --out out", code=1, says="in one place")
    run(f"generate plate.off --points 1 {ALONE.replace('--size file', '')} --out one", code=1, says="in one place")


def test_the_summary_has_the_reason_of_a_view_without_a_cloud(run: Run, tmp_path: Path) -> None:
    """Of three points on a cube a camera sees none, one, or enough."""
    cube = box()
    write_off(tmp_path / "cube.off", cube.vertices, cube.faces)
    line = "generate cube.off --points 3 --views fibonacci:8 --sample-size 5 --method exact --workers 1 --out out"
    said = run(line).out
    n_blank = 8 - len(sorted_records(tmp_path / "out"))
    assert f"{n_blank} views without a cloud; cube.off, view 3: all points that it sees are in one place\n" in said


def test_a_sensor_s_least_range_cuts_an_object(run: Run, tmp_path: Path) -> None:
    """Of a cube of side 1 seen straight on, all that is seen is half a metre before its middle."""
    cube = box()
    write_off(tmp_path / "cube.off", cube.vertices, cube.faces)
    said = run(f"generate cube.off {PINHOLE} --range 1.25..1.299 {ALONE} --out none", code=1).err
    assert "view 0: all of it that rays meet is too near for pinhole, which measures at 0.8 to inf m" in said
    line = f"scan cube.off {PINHOLE} --size file --out cube.ply"
    run(f"{line} --range 1.29", code=1, says="all of it that rays meet is too near for pinhole")
    assert "nearer" not in run(f"{line} --range 1.31").err
    said = run(f"{line} --range 1.1 --azimuth 30").err
    assert "of the objects' returns are nearer, and lost. With --range 1.49 or more none" in said
    outcome = run(f"generate cube.off {PINHOLE} --range 1.1 --views ring:2@30 {ALONE[17:]} --out cut")
    cut = manifest(tmp_path / "cut")["cut_by_range"]
    # the nearest edge is an edge of the upper face, seen from 30 degrees: x = z = 1/2
    assert cut["clear_range"] == pytest.approx(0.8 + (np.cos(np.pi / 6) + np.sin(np.pi / 6)) / 2)
    assert 0.5 < cut["too_near"] < 1.0
    assert f"{cut['too_near']:.1%} of the objects' returns are nearer, and lost. With --range 1.49" in outcome.out
    clear = run(f"generate cube.off {PINHOLE} --range 1.49 --views ring:2@30 {ALONE[17:]} --out clear")
    assert manifest(tmp_path / "clear")["cut_by_range"]["too_near"] == 0.0
    assert "nearer" not in clear.out


@pytest.mark.parametrize(("format", "n_views"), [("frames", 4), ("pcn --points 16384", 8)])
def test_objects_that_a_layout_leaves_out_are_named(run: Run, tmp_path: Path, format: str, n_views: int) -> None:
    """A plate's edge is met by no ray, from two of the sides."""
    cube = box()
    write_off(tmp_path / "meshes" / "a" / "cube.off", cube.vertices, cube.faces)
    write_off(tmp_path / "meshes" / "b" / "plate.off", ACROSS, HALVES)
    of_views = f"--views ring:{n_views}@0 --size file --method exact --workers 1 --set-sensor noise=0"
    line = (
        f"generate meshes --sensor pinhole:width=40,height=40,fov=60 --range 3 {of_views} --out out --format {format}"
    )
    outcome = run(line)
    left_out, reason = manifest(tmp_path / "out")["left_out"], f"view {n_views // 4}: no ray of pinhole meets it"
    assert left_out == {"b/plate.off": reason}
    assert f"1 mesh left out:\n  b/plate.off: {reason}" in outcome.out
    assert "of 1 mesh, " in outcome.out
    assert manifest(tmp_path / "out")["blank_views"]["b/plate.off"]["n_views"] == 2
    counts = manifest(tmp_path / "out")["counts"]
    assert (counts["meshes"], counts["clouds"], counts["clouds_by_split"]) == (1, n_views, {"train": n_views})


def test_an_object_without_any_cloud_is_named_in_every_format(run: Run, tmp_path: Path) -> None:
    """The cube's side is within the sensor's limit, the plate across its middle is not."""
    cube = box()
    write_off(tmp_path / "meshes" / "a" / "cube.off", cube.vertices, cube.faces)
    write_off(tmp_path / "meshes" / "b" / "plate.off", ACROSS, HALVES)
    flat = "--sensor pinhole:width=9,height=9,fov=20 --range 2 --views ring:1@0 --method exact --workers 1"
    outcome = run(f"generate meshes {flat} --size a=1,b=3.9 --set-sensor range_max=1.9 --sample-size 8 --out out")
    left_out = manifest(tmp_path / "out")["left_out"]
    assert list(left_out) == ["b/plate.off"]
    assert manifest(tmp_path / "out")["counts"]["meshes"] == 1
    assert left_out["b/plate.off"].startswith("view 0: all of it that rays meet is too far for pinhole")
    assert "1 mesh left out:\n  b/plate.off: view 0" in outcome.out
    run("convert out --format npz --out npz")
    assert manifest(tmp_path / "npz")["left_out"] == left_out
