"""Compiled functions find a folder also where nothing of the package's or the user's can be written."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from zbuf_occlude import numba_cache

NOWHERE = "/dev/null"  # no folder, and nothing can be made in it, by root neither


def test_a_temporary_folder_where_nothing_can_be_written(tmp_path: Path) -> None:
    program = (
        "import os, sys\n"
        "import zbuf_occlude.numba_cache as c\n"  # its import has looked once, in a place that can be written
        f"c.__file__ = {NOWHERE + '/numba_cache.py'!r}\n"
        "c.ensure_writable()\n"
        "print(os.environ['NUMBA_CACHE_DIR'])\n"
    )
    environment = {**os.environ, "XDG_CACHE_HOME": NOWHERE, "NUMBA_CACHE_DIR": NOWHERE, "TMPDIR": str(tmp_path)}
    child = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    folder = Path(child.stdout.strip())
    assert folder.parent == tmp_path
    assert not folder.exists(), "it goes with the process"


def test_what_can_be_written_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "not" / "yet"))
    numba_cache.ensure_writable()
    assert os.environ["NUMBA_CACHE_DIR"] == str(tmp_path / "not" / "yet")


PROGRAM = (
    "import sys; sys.modules['scipy'] = None\n"  # numba would look for it, for a fifth of a second
    "import numba_cache; numba_cache.forget_stale(); import caller, apart\n"
    "print(caller.ask(), sum(caller.ask.stats.cache_hits.values()), apart.zero(), len(apart.zero.stats.cache_hits))"
)
"""Prints two functions' answers, after each whether it was there already."""


def says(folder: Path, cache: Path | None) -> list[str]:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache or "")}
    call = [sys.executable, "-B", "-c", PROGRAM]
    child = subprocess.run(call, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert child.returncode == 0, child.stderr
    return child.stdout.split()


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """The module under test, in a folder of files that import each other."""
    folder = tmp_path / "package"
    folder.mkdir()
    (folder / "numba_cache.py").write_text(Path(numba_cache.__file__).read_text())
    jit = "@numba.njit(cache=True)\n"
    (folder / "caller.py").write_text(f"import numba\nimport callee\n{jit}def ask():\n    return callee.answer()\n")
    (folder / "callee.py").write_text(
        "import numba\nfrom constants import (\n    ANSWER,\n)\n@numba.njit\ndef answer():\n    return ANSWER\n"
    )
    (folder / "constants.py").write_text("ANSWER = 1\n")
    (folder / "apart.py").write_text(f"import numba\n{jit}def zero():\n    return 0\n")
    return folder


@pytest.mark.parametrize("elsewhere", [False, True])
def test_a_changed_function_is_compiled_anew_where_others_call_it(package: Path, elsewhere: bool) -> None:
    cache = package.parent / "cache" if elsewhere else None
    assert says(package, cache) == ["1", "0", "0", "0"]
    assert says(package, cache) == ["1", "1", "0", "1"]
    (package / "constants.py").write_text("ANSWER = 22\n")
    assert says(package, cache) == ["22", "0", "0", "1"]  # what does not import the constant stays


def test_a_run_with_a_folder_of_its_own_leaves_what_others_compiled(package: Path) -> None:
    assert says(package, None) == ["1", "0", "0", "0"]
    assert says(package, package.parent / "cache") == ["1", "0", "0", "0"]
    assert says(package, None) == ["1", "1", "0", "1"]


@pytest.mark.parametrize("given", ["{beside}/", "{folder}/link", "{folder}/cache"])
def test_what_was_left_alone_goes_when_it_is_stale(package: Path, given: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the usual place is called in between."""
    beside = package / "__pycache__"
    beside.mkdir()
    (package.parent / "link").symlink_to(beside)
    monkeypatch.setattr(numba_cache, "__file__", str(package / "numba_cache.py"))
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    numba_cache.forget_stale()
    names = ["caller.ask-1.py311.nbi", "callee.answer-5.py311.1.nbc", "apart.zero-1.py311.nbi"]
    for name in names:
        (beside / name).touch()
    monkeypatch.setenv("NUMBA_CACHE_DIR", given.format(beside=beside, folder=package.parent))
    numba_cache.forget_stale()
    assert all((beside / name).exists() for name in names)
    (package / "constants.py").write_text("ANSWER = 22\n")
    numba_cache.forget_stale()
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    numba_cache.forget_stale()
    assert [(beside / name).exists() for name in names] == [False, False, True]


def test_nobody_finds_half_a_note(package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that begins while another writes the note would take all that is compiled for stale."""
    monkeypatch.setattr(numba_cache, "__file__", str(package / "numba_cache.py"))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(package.parent / "cache"))
    numba_cache.forget_stale()
    (note,) = (package.parent / "cache").glob("*.sources")
    before, during = note.read_text(), []
    write_text = Path.write_text

    def write(path: Path, text: str) -> int:
        written = write_text(path, text)
        during.append(note.read_text())
        return written

    (package / "constants.py").write_text("ANSWER = 22\n")
    monkeypatch.setattr(Path, "write_text", write)
    with monkeypatch.context() as full:
        full.setattr(Path, "replace", lambda path, target: (_ for _ in ()).throw(OSError("refused")))
        numba_cache.forget_stale()
    assert note.read_text() == before
    numba_cache.forget_stale()
    assert during == [before, before]
    assert note.read_text() != before
    assert [path.name for path in note.parent.iterdir()] == [note.name]


def test_what_was_compiled_is_noted_until_a_source_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    assert not numba_cache.is_compiled("job")
    numba_cache.note_compiled("job")
    assert numba_cache.is_compiled("job")
    assert not numba_cache.is_compiled("another")
    monkeypatch.setattr(numba_cache, "__file__", str(tmp_path / "numba_cache.py"))
    (tmp_path / "changed.py").touch()
    assert not numba_cache.is_compiled("job")


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere LLVM alone knows the processor")
def test_a_note_is_looked_for_without_llvm() -> None:
    """To import it takes as long as NumPy, in a process that compiles nothing."""
    program = "import sys, zbuf_occlude.numba_cache as c; c.is_compiled('job'); print('llvmlite' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True).stdout == "False\n"
