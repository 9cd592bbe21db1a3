"""What people type and keep on their disks without thinking of this program: one clear line, or the right thing."""

import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from tests.cli.conftest import Run, write_off
from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.generate import generate
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.errors import GlError
from zbuf_occlude.meshes import MeshCollection
from zbuf_occlude.visibility import find_method

SMALL = ("--method", "oracle", "--views", "ring:2@30", "--points", 50, "--sample-size", 8, "--workers", 1)
TETRAHEDRON = np.vstack([np.zeros(3), np.eye(3)]), np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]])


@pytest.fixture
def tetrahedron(tmp_path: Path) -> Path:
    return write_off(tmp_path / "solids" / "tetrahedron_1.off", *TETRAHEDRON)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--views", "fibonacci:999999999999"), "views must be paper100"),
        (("--views", "grid:1000000x1000000"), "the number of views must be at most 1,000,000"),
        (("--points", 10**26), "points must be at most 2,147,483,647"),
        (("--variations", 10**26), "variations must be at most 2,147,483,647"),
        (("--sample-size", 3_000_000_000), "sample size must be at most 100,000,000"),
        (("--density", "inf"), "density must be at most 2,147,483,647; got inf"),
        (("--mesh-seconds", "nan"), "seconds that a mesh may take must be positive; got nan"),
        (("--shard", "5/2"), "--shard must be I/N"),
    ],
)
def test_absurd_numbers_are_usage_errors(run: Run, tetrahedron: Path, arguments: Any, message: str) -> None:
    outcome = run("generate", tetrahedron, "--dry-run", *arguments)
    assert (outcome.code, outcome.out) == (2, "")
    assert message in outcome.err
    assert "Traceback" not in outcome.err


SENSOR = ("--sensor", "vlp-16", "--size", 4.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--classes", ""), "it must have a word, or several between commas; got ''"),
        (("--splits", " , "), "it must have a word, or several between commas"),
        (("--sensor", "vlp-16", "--size", "chiar=0.9"), "--size must be of classes that there are, tetrahedron"),
        ((*SENSOR, "--range", 9, "--views", "cameras.json"), "--range must go without cameras of a file"),
    ],
)
def test_what_nothing_would_look_at_is_a_usage_error(
    run: Run, tetrahedron: Path, monkeypatch: pytest.MonkeyPatch, arguments: Any, message: str
) -> None:
    monkeypatch.chdir(tetrahedron.parent)
    Path("cameras.json").write_text('[{"R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "t": [0, 0, 5]}]')
    outcome = run("generate", tetrahedron, "--dry-run", *arguments)
    assert (outcome.code, outcome.out) == (2, "")
    assert message in outcome.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--cameras", "cameras.json", "--azimuth", 4), "--azimuth must go without --cameras"),
        (("--cameras", "cameras.json", "--distance", 4, "--roll", 1), "--distance, --roll must go without --cameras"),
        (("--azimuth", 0, "--elevation", 0, "--index", 3), "--index must go with --cameras"),
        (("--azimuth", 0, "--elevation", 0, "--look-at", "nan", 0, 0), "nan is not a finite number"),
        (("--azimuth", 0, "--elevation", 0, "--fov", "nan"), "nan is not a finite number"),
    ],
)
def test_a_camera_is_said_in_one_way(
    run: Run, tetrahedron: Path, monkeypatch: pytest.MonkeyPatch, arguments: Any, message: str
) -> None:
    monkeypatch.chdir(tetrahedron.parent)
    Path("cameras.json").write_text('[{"R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "t": [0, 0, 5]}]')
    outcome = run("visible", tetrahedron, "--method", "oracle", *arguments, "--out", "cloud.ply")
    if "--sensor" in arguments:
        outcome = run("visible", tetrahedron, *arguments, "--out", "cloud.ply")
    assert outcome.code == 2
    assert message in outcome.err
    assert not Path("cloud.ply").exists()


@pytest.mark.parametrize(
    ("method", "setting", "message"),
    [
        ("oracle", "contact=wide", "contact must be a number, like the default 1e-05; got 'wide'"),
        ("oracle", "contact=1e400", "contact must lie in [0, 1), a fraction of the mesh's diagonal; got inf"),
        ("depth_buffer", "resolution=64.5", "resolution must be an int in [16, 8192], pixels along a side; got 64.5"),
        ("depth_buffer", "resolution=-1", "resolution must be an int in [16, 8192], pixels along a side; got -1"),
        ("depth_buffer", "resolution=True", "resolution must be a number, like the default 512; got True"),
        ("depth_buffer", "refine=3", "refine must be a word, like the default witness; got 3"),
        ("hidden_point_removal", "radius=[1]", "radius must be a number, like the default None; got '[1]'"),
    ],
)
def test_settings_that_the_method_cannot_have(
    request: pytest.FixtureRequest, run: Run, tetrahedron: Path, method: str, setting: str, message: str
) -> None:
    row = find_method(method)
    if row.needs_gl:
        request.getfixturevalue("gl")
    if lacking := row.missing():
        pytest.skip(lacking)
    outcome = run("generate", tetrahedron, "--dry-run", "--method", method, "--set", setting)
    assert (outcome.code, outcome.out) == (2, "")
    assert message in outcome.err


def test_a_dry_run_where_the_method_cannot_run(run: Run, tetrahedron: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cluster's front end may have no driver: the plan is told all the same, and that."""

    def refuse(*_: object, **__: object) -> None:
        raise GlError("no driver here.")

    monkeypatch.setattr("zbuf_occlude.gl.context.GlContext.open", refuse)
    outcome = run("generate", tetrahedron, "--method", "depth_buffer", "--dry-run")
    assert outcome.code == 0, outcome.err
    assert "1 mesh x 25 views" in outcome.out
    assert outcome.out.endswith("\nnot on this machine: no driver here.\n")


def test_an_output_folder_that_is_a_file_is_a_usage_error(run: Run, tetrahedron: Path) -> None:
    before = tetrahedron.read_bytes()
    commands: tuple[tuple[object, ...], ...] = (
        ("generate", tetrahedron, *SMALL),
        ("generate", tetrahedron, *SMALL, "--dry-run"),
        ("convert", tetrahedron.parent, "--format", "npz"),
        ("show", tetrahedron.parent),
        ("compare", tetrahedron),
    )
    for command in commands:
        outcome = run(*command, "--out", tetrahedron)
        assert (outcome.code, outcome.out) == (2, "")
        assert f"'--out': it must be a folder; {str(tetrahedron)!r} is a file. Choose another." in outcome.err
    assert tetrahedron.read_bytes() == before


def test_an_output_folder_that_is_a_broken_link_is_a_usage_error(run: Run, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "gone")
    outcome = run("generate", *SMALL, "--out", tmp_path / "link")
    assert (outcome.code, outcome.out) == (2, "")
    assert f"a link to {str(tmp_path / 'gone')!r}, which is not there. Make that folder first." in outcome.err


def test_an_output_folder_that_cannot_be_made_is_a_usage_error(
    run: Run, tetrahedron: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    commands: tuple[tuple[object, ...], ...] = (("generate", *SMALL), ("generate", *SMALL, "--dry-run"))
    for command in commands:
        outcome = run(*command, "--out", tetrahedron / "a" / "b")
        assert (outcome.code, outcome.out) == (2, "")
        assert f"cannot be made in {str(tetrahedron)!r}: that is a file. Choose another." in outcome.err
    monkeypatch.setattr("os.access", lambda path, mode: False)  # whoever tests may be allowed everything
    for command in commands:
        outcome = run(*command, "--out", tmp_path / "a" / "b")
        assert (outcome.code, outcome.out) == (2, "")
        assert f"cannot be made in {str(tmp_path)!r}: it may not be written in. Choose another." in outcome.err


@pytest.mark.parametrize("option", ["--views", "--labels", "--sensor", "--scene"])
def test_a_file_that_is_not_there_is_told_once_and_in_words(run: Run, tetrahedron: Path, option: str) -> None:
    name = {"--views": "gone.csv", "--labels": "gone.csv", "--sensor": "gone.yaml", "--scene": "gone.json"}[option]
    command = ("scan", "--sensor", "vlp-16") if option == "--scene" else ("generate",)
    where = ("--azimuth", 0, "--range", 5, "--size", 1) if option == "--scene" else ()
    outcome = run(*command, tetrahedron, *where, option, name, "--out", tetrahedron.parent / "out.ply")
    assert outcome.code == 2
    said = outcome.err.splitlines()[-1]
    assert f"{name}: No such file or directory" in said
    assert said.count(name) == 1
    assert "Errno" not in said


def test_a_dry_run_into_a_folder_that_is_another_s(run: Run, tetrahedron: Path, tmp_path: Path) -> None:
    """It says what `generate` would."""
    full, taken = tmp_path / "full", tmp_path / "taken"
    full.mkdir()
    (full / "mine.txt").write_text("mine")
    assert run("generate", tetrahedron, *SMALL, "--out", taken).code == 0
    for out, options in ((full, ()), (full, ("--overwrite",)), (taken, ("--seed", 1))):
        outcome = run("generate", tetrahedron, *SMALL, *options, "--out", out, "--dry-run")
        assert (outcome.code, outcome.out) == (1, "")
        assert (
            outcome.err.splitlines()[-1]
            == run("generate", tetrahedron, *SMALL, *options, "--out", out).err.splitlines()[-1]
        )
    for options in ((), ("--seed", 1, "--overwrite")):
        assert run("generate", tetrahedron, *SMALL, *options, "--out", taken, "--dry-run").code == 0


@pytest.mark.parametrize("command", ["visible", "visible by cameras", "scan"])
def test_what_is_read_is_not_written_over(run: Run, command: str, tmp_path: Path) -> None:
    mesh, views = tmp_path / "box.ply", tmp_path / "views.csv"
    mesh.write_bytes(trimesh.creation.box().export(file_type="ply"))
    views.write_text("azimuth,elevation\n30,20\n")
    (tmp_path / "link.ply").symlink_to(mesh)
    before = mesh.read_bytes(), views.read_bytes()
    where = ("--azimuth", 30, "--elevation", 20, "--out", tmp_path / "link.ply")
    outcome = run(
        *{
            "visible": ("visible", mesh, *where),
            "visible by cameras": ("visible", mesh, "--cameras", views, "--index", 0, "--out", views),
            "scan": ("scan", mesh, "--sensor", "vlp-16", "--size", 2, "--out", mesh),
        }[command]
    )
    assert (outcome.code, outcome.out) == (2, "")
    assert "--out must not be a file that is read" in outcome.err
    assert (mesh.read_bytes(), views.read_bytes()) == before


def test_too_little_memory_is_one_line(run: Run, tetrahedron: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def starve(*_: object, **__: object) -> None:
        raise MemoryError("Unable to allocate 745. GiB")

    monkeypatch.setattr("zbuf_occlude.cli.one_view.sample_surface", starve)
    outcome = run("visible", tetrahedron, "--method", "oracle", "--azimuth", 0, "--elevation", 0, "--out", "a.ply")
    assert outcome.code == 1
    assert re.fullmatch(
        r"error: it must fit in .*; it does not \(Unable to allocate 745\. GiB\)\. Ask for less: .*\n",
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


def test_an_output_that_cannot_be_written_is_named_as_it_was_typed(run: Run, tetrahedron: Path) -> None:
    for out in (tetrahedron.parent / "missing" / "a.ply", tetrahedron / "a.ply"):
        where = ("--azimuth", 0, "--elevation", 0, "--points", 9, "--method", "oracle", "--out", out)
        outcome = run("visible", tetrahedron, *where)
        assert outcome.code == 2
        assert f"--out must be in a folder that there is; {str(out.parent)!r} is none." in outcome.err


def test_a_file_is_whole_or_not_there(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError):
        atomic.write(tmp_path / "a", lambda file: file.write(b"half") / 0)
    assert list(tmp_path.iterdir()) == []


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
    outcome = run("generate", root, "--out", tmp_path / "out", *SMALL)
    assert outcome.code == 3, outcome.err
    assert "Traceback" not in outcome.err
    assert (tmp_path / "out/shape_names.txt").read_text().splitlines() == ["plain", r"x$\foo$", "椅子 <b>"]
    keys = (tmp_path / "out/mesh_keys.txt").read_text().splitlines()
    assert sorted(keys) == sorted(entry.key for entry in MeshCollection.from_paths(root))
    assert {r"plain/\xff.off", "椅子 <b>/two\\nlines.off"} <= set(keys)
    assert r"plain/\xff.off: " in outcome.out


def test_a_run_before_in_a_folder_among_the_meshes_is_no_mesh(run: Run, tetrahedron: Path) -> None:
    out = tetrahedron.parent / "out"
    first = run("generate", tetrahedron.parent, "--out", out, "--format", "ply", *SMALL)
    assert first.code == 0, first.err
    again = run("generate", tetrahedron.parent, "--out", out, "--format", "ply", *SMALL)
    assert (again.code, again.out) == (0, first.out)
    within = run("generate", tetrahedron.parent, "--out", tetrahedron.parent, *SMALL)
    assert within.code == 1
    assert "--out must not be a folder of meshes" in within.err


def test_a_mesh_of_which_too_much_is_asked_does_not_end_the_run(
    tetrahedron: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    corners = np.random.default_rng(0).uniform(size=(900, 3))  # far more area than its longest side says
    write_off(tetrahedron.parent / "soup_1.off", corners, np.arange(900).reshape(300, 3))
    monkeypatch.setattr("zbuf_occlude.geometry.sampling.MAX_POINTS", 2_000)
    recipe = Recipe("oracle", views="ring:1@30", n_points=None, density=200.0, sample_size=8)
    document = generate(Plan(MeshCollection.from_paths(tetrahedron.parent), recipe), tmp_path / "out")
    assert document["counts"]["clouds"] == 1
    assert list(document["failures"]) == ["solids/soup_1.off"]
    assert "points; at most 2^31 - 1 can be made" in document["failures"]["solids/soup_1.off"]
