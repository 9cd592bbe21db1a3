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


@pytest.mark.parametrize("elsewhere", [False, True])
def test_a_changed_function_is_compiled_anew_where_others_call_it(tmp_path: Path, elsewhere: bool) -> None:
    (tmp_path / "numba_cache.py").write_text(Path(numba_cache.__file__).read_text())
    jit = "@numba.njit(cache=True)\n"
    (tmp_path / "caller.py").write_text(f"import numba\nimport callee\n{jit}def ask():\n    return callee.answer()\n")
    (tmp_path / "callee.py").write_text(
        "import numba\nfrom constants import (\n    ANSWER,\n)\n@numba.njit\ndef answer():\n    return ANSWER\n"
    )
    (tmp_path / "apart.py").write_text(f"import numba\n{jit}def zero():\n    return 0\n")
    program = (
        "import numba_cache; numba_cache.forget_stale(); import caller, apart\n"
        "print(caller.ask(), sum(caller.ask.stats.cache_hits.values()), apart.zero(), len(apart.zero.stats.cache_hits))"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache") if elsewhere else ""}
    said = []
    for answer in (1, 1, 22):
        if answer > 1 or not said:
            (tmp_path / "constants.py").write_text(f"ANSWER = {answer}\n")
        call = [sys.executable, "-B", "-c", program]
        child = subprocess.run(call, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        assert child.returncode == 0, child.stderr
        said.append(child.stdout.split())
    # each: its answer, and whether it was there already; what does not import the constant stays
    assert said == [["1", "0", "0", "0"], ["1", "1", "0", "1"], ["22", "0", "0", "1"]]


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
