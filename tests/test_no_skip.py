"""Where skips are refused, a skip fails; this is what lets continuous integration prove that everything ran."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize(
    ("body", "refused", "outcome"),
    [
        ("def test(): pytest.skip('no OpenGL here')", "1", "1 failed"),
        ("def test(): pytest.skip('no OpenGL here')", "", "1 skipped"),
        ("def test(): pytest.skip('set ZBUF_OCCLUDE_DATA')", "1", "1 skipped"),
        ("pytest.importorskip('no_such_package', reason='not installed')", "1", "1 error"),
        ("def test(): pass", "1", "1 passed"),
    ],
)
def test_a_skip_is_refused(tmp_path: Path, body: str, refused: str, outcome: str) -> None:
    (tmp_path / "conftest.py").write_text((ROOT / "tests" / "conftest.py").read_text())
    (tmp_path / "test_it.py").write_text(f"import pytest\n{body}\n")
    child = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path)],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "ZBUF_OCCLUDE_NO_SKIP": refused},
        check=False,
    )
    assert outcome in child.stdout, child.stdout
