"""The first run says that it compiles, whatever it makes; the next does not."""

from pathlib import Path

import pytest

from tests.cli.conftest import Run
from zbuf_occlude.jit import compiler

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
    monkeypatch.setattr("zbuf_occlude.jit.compiler.compiled_before", noted.__contains__)
    monkeypatch.setattr("zbuf_occlude.jit.compiler.note_compiled", noted.add)
    compiler.announce.cache_clear()
    run(f"generate {job} {SMALL} --out first")
    assert caplog.text.count(SAID) == 1
    run(f"generate {job} {SMALL} --out again")
    assert caplog.text.count(SAID) == 1
    first_bytes, again_bytes = (next((tmp_path / name).glob("*.h5")).read_bytes() for name in ("first", "again"))
    assert first_bytes == again_bytes
