"""The first run of a command reports compiling; the next does not."""

import io
import time
from pathlib import Path

import pytest

from tests.cli.conftest import Run
from tests.processes import python
from zbuf_occlude.base.jit import compiler
from zbuf_occlude.cli.shell import Compiling

SMALL = "--limit 1 --views ring:1@0 --sample-size 16 --workers 1"
SAID = "compiling, once"


@pytest.mark.parametrize(
    "job",
    [
        "--method exact",
        "--method exact --set contact=1e-6",
        "--sensor hdl-64e --range 10 --scene ground",
        pytest.param("--method depth_buffer", marks=pytest.mark.gl),
    ],
)
def test_the_first_run_says_that_it_compiles(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, job: str
) -> None:
    noted: set[str] = set()
    monkeypatch.setattr("zbuf_occlude.base.jit.compiler.compiled_before", noted.__contains__)
    monkeypatch.setattr("zbuf_occlude.base.jit.compiler.note_compiled", noted.add)
    compiler._say_once.cache_clear()
    run(f"generate {job} {SMALL} --out first")
    assert caplog.text.count(SAID) == 1
    run(f"generate {job} {SMALL} --out again")
    assert caplog.text.count(SAID) == 1
    first_bytes, again_bytes = (next((tmp_path / name).glob("*.h5")).read_bytes() for name in ("first", "again"))
    assert first_bytes == again_bytes


class Terminal(io.StringIO):
    """Standard error as a terminal."""

    def isatty(self) -> bool:
        return True


def test_a_line_moves_while_functions_are_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = Terminal()
    monkeypatch.setattr("sys.stderr", shown)
    line = Compiling()
    line.total = 3
    for _ in range(3):
        line.one_more()
        time.sleep(0.25)
    line.close()
    assert "2/3" in shown.getvalue()
    assert "3/3" in shown.getvalue()


@pytest.mark.long
def test_the_number_of_functions_is_about_right(tmp_path: Path) -> None:
    program = (
        "from zbuf_occlude.datasets.plan import DatasetConfig\n"
        "from zbuf_occlude.datasets.rehearsal import n_functions, precompile_job, warm_up_jit\n"
        "from zbuf_occlude.base.jit.compiler import on_compiled\n"
        "heard, config = [], DatasetConfig('exact')\non_compiled(lambda: heard.append(1))\n"
        "precompile_job(config)\nwarm_up_jit(config)\nprint(len(heard), n_functions(config))"
    )
    child = python("-c", program, NUMBA_CACHE_DIR=str(tmp_path))
    compiled, expected = map(int, child.stdout.split())
    assert 0.8 * compiled < expected < 1.2 * compiled, (compiled, "rehearsal.N_FUNCTIONS must be counted again")
