"""Unusual arguments and files: each gives the right result or one line of error."""

import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.cli.conftest import Run, write_off
from zbuf_occlude.base import atomic
from zbuf_occlude.base.errors import GlError
from zbuf_occlude.datasets.generate import generate
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.meshes import MeshCollection

SMALL = "--method oracle --views ring:2@30 --points 50 --sample-size 8 --workers 1"
TETRAHEDRON = np.vstack([np.zeros(3), np.eye(3)]), np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]])


@pytest.fixture
def tetrahedron(tmp_path: Path) -> Path:
    return write_off(tmp_path / "solids" / "tetrahedron_1.off", *TETRAHEDRON)


def test_a_dry_run_where_the_method_cannot_run(run: Run, tetrahedron: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without OpenGL, as on a cluster's front end, --dry-run prints the plan and a warning."""

    def refuse(*_: object, **__: object) -> None:
        raise GlError("no driver here.")

    monkeypatch.setattr("zbuf_occlude.engines.gl.context.GlContext.open", refuse)
    outcome = run(f"generate {tetrahedron} --method depth_buffer --dry-run")
    assert "1 mesh x 25 views" in outcome.out
    assert outcome.out.endswith("\nnot on this machine: no driver here.\n")


def test_an_output_folder_that_is_a_broken_link_is_a_usage_error(run: Run, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "gone")
    said = f"a link to {str(tmp_path / 'gone')!r}, which does not exist. Make that folder first."
    assert run("generate --out link", code=2, says=said).out == ""


@pytest.mark.parametrize("option", ["", "--dry-run"])
def test_an_output_folder_that_may_not_be_made_is_a_usage_error(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, option: str
) -> None:
    monkeypatch.setattr("os.access", lambda path, mode: False)  # whoever tests may be allowed everything
    said = f"cannot be made in {str(tmp_path)!r}: it is not writable. Choose another."
    assert run(f"generate {option} --out a/b", code=2, says=said).out == ""


def test_a_dry_run_into_a_folder_that_is_another_s(run: Run, tetrahedron: Path, tmp_path: Path) -> None:
    """The message is that of `generate`."""
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    line = f"generate {tetrahedron} {SMALL}"
    run(f"{line} --out taken")
    for options in ("--out full", "--out full --overwrite", "--out taken --seed 1"):
        planned, made = run(f"{line} {options} --dry-run", code=1), run(f"{line} {options}", code=1)
        assert planned.out == ""
        assert planned.err.splitlines()[-1] == made.err.splitlines()[-1]
    for options in ("--out taken", "--out taken --seed 1 --overwrite"):
        run(f"{line} {options} --dry-run")


@pytest.mark.parametrize(
    "line",
    [
        "visible box.ply --out link.ply",
        "visible box.ply --cameras views.csv --index 0 --out views.csv",
        "scan box.ply --sensor vlp-16 --size 2 --out box.ply",
    ],
)
def test_what_is_read_is_not_written_over(run: Run, tmp_path: Path, line: str) -> None:
    mesh, views = tmp_path / "box.ply", tmp_path / "views.csv"
    mesh.write_bytes(trimesh.creation.box().export(file_type="ply"))
    views.write_text("azimuth,elevation\n30,20\n")
    (tmp_path / "link.ply").symlink_to(mesh)
    before = mesh.read_bytes(), views.read_bytes()
    assert run(line, code=2, says="--out must not be an input file").out == ""
    assert (mesh.read_bytes(), views.read_bytes()) == before


def test_too_little_memory_is_one_line(run: Run, tetrahedron: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def starve(*_: object, **__: object) -> None:
        raise MemoryError("Unable to allocate 745. GiB")

    monkeypatch.setattr("zbuf_occlude.cli.visible.sample_surface", starve)
    outcome = run(f"visible {tetrahedron} --method oracle --azimuth 0 --elevation 0 --out a.ply", code=1)
    assert re.fullmatch(
        r"error: out of memory; the limit is .* \(Unable to allocate 745\. GiB\)\. Reduce points, views or size\.\n",
        outcome.err,
    )


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux keeps to a limit of address space")
def test_an_archive_that_unpacks_to_more_than_may_be_says_the_limit(tmp_path: Path) -> None:
    with (
        zipfile.ZipFile(tmp_path / "bomb.zip", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("a.obj", "w") as member,
    ):
        for _ in range(900):
            member.write(b" " * 2**20)
    visible = f"{sys.executable} -m zbuf_occlude visible {tmp_path}/bomb.zip/a.obj --azimuth 0 --elevation 0"
    limited = ["bash", "-c", f"ulimit -v 1400000; exec {visible} --method oracle --out {tmp_path}/a.ply"]
    child = subprocess.run(limited, capture_output=True, text=True, timeout=120, check=False)
    assert child.returncode == 1
    assert re.fullmatch(
        r"error: .*/a\.obj: it must fit in the 1\.4 GB .*\(ulimit -v\); unpacked .* 943,718,400 bytes\. .*\n",
        child.stderr,
    )


def test_a_disk_that_fills_within_numpy_is_told_in_words(tmp_path: Path) -> None:
    def tofile(file: object) -> None:  # as NumPy does when a write is short
        raise OSError("3 requested and 0 written")

    with pytest.raises(OSError, match="could not be written whole; is the disk full") as caught:
        atomic.write(tmp_path / "a", tofile)
    assert caught.value.filename == str(tmp_path / "a")


def test_names_no_text_file_can_hold(run: Run, tmp_path: Path) -> None:
    root = tmp_path / "meshes"
    for label in (r"x$\foo$", "椅子 <b>"):
        write_off(root / label / "a b_1.off", *TETRAHEDRON)
        write_off(root / label / "two\nlines.off", *TETRAHEDRON)
    odd = os.fsencode(root / "plain") + b"/\xff.off"
    write_off(root / "plain" / "good.off", *TETRAHEDRON)
    Path(os.fsdecode(odd)).write_text("OFF\n")
    outcome = run(f"generate {root} --out out {SMALL}", code=3)
    assert (tmp_path / "out/shape_names.txt").read_text().splitlines() == ["plain", r"x$\foo$", "椅子 <b>"]
    keys = (tmp_path / "out/mesh_keys.txt").read_text().splitlines()
    assert sorted(keys) == sorted(entry.key for entry in MeshCollection.from_paths(root))
    assert {r"plain/\xff.off", "椅子 <b>/two\\nlines.off"} <= set(keys)
    assert r"plain/\xff.off: " in outcome.out


def test_a_run_before_in_a_folder_among_the_meshes_is_no_mesh(run: Run, tetrahedron: Path) -> None:
    meshes = tetrahedron.parent
    line = f"generate {meshes} --out {meshes}/out --format ply {SMALL}"
    assert run(line).out == run(line).out
    run(f"generate {meshes} --out {meshes} {SMALL}", code=1, says="--out must not be a folder of meshes")


def test_a_mesh_of_which_too_much_is_asked_does_not_end_the_run(
    tetrahedron: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    corners = np.random.default_rng(0).uniform(size=(900, 3))  # far more area than its longest side says
    write_off(tetrahedron.parent / "soup_1.off", corners, np.arange(900).reshape(300, 3))
    monkeypatch.setattr("zbuf_occlude.meshes.sampling.MAX_POINTS", 2_000)
    config = DatasetConfig("oracle", views="ring:1@30", n_points=None, density=200.0, sample_size=8)
    document = generate(Plan(MeshCollection.from_paths(tetrahedron.parent), config), tmp_path / "out")
    assert document["counts"]["clouds"] == 1
    assert list(document["failures"]) == ["solids/soup_1.off"]
    assert "points; at most 2^31 - 1 can be made" in document["failures"]["solids/soup_1.off"]
