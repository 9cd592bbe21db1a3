"""Where skips are refused, a skip fails; this is what lets continuous integration prove that everything ran."""

from pathlib import Path

import pytest

from tests.processes import python

ROOT = Path(__file__).parents[1]


FILES = {
    "lacking": "import pytest\ndef test(): pytest.skip('no OpenGL here')",
    "data": "import pytest\ndef test(): pytest.skip('set ZBUF_OCCLUDE_DATA')",
    "module": "import pytest\npytest.importorskip('no_such_package', reason='not installed')",
    "sound": "def test(): pass",
    "slow": "import pytest\n@pytest.mark.long\ndef test(): raise AssertionError",
}


@pytest.mark.parametrize(
    ("refused", "outcomes"),
    [
        ("1", {"FAILED test_lacking.py", "SKIPPED test_data.py", "ERROR test_module.py", "PASSED test_sound.py"}),
        ("", {"SKIPPED test_lacking.py", "SKIPPED test_data.py", "SKIPPED test_module.py", "PASSED test_sound.py"}),
    ],
)
def test_a_skip_is_refused_and_what_is_left_out_is_said(tmp_path: Path, refused: str, outcomes: set[str]) -> None:
    (tmp_path / "conftest.py").write_text((ROOT / "tests" / "conftest.py").read_text())
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = long\n  gl\naddopts = -m 'not long'\n")
    for name, body in FILES.items():
        (tmp_path / f"test_{name}.py").write_text(body + "\n")
    child = python(
        *("-m", "pytest", "-q", "-rA", "--no-fold-skipped", "--continue-on-collection-errors", tmp_path),
        cwd=tmp_path,
        PYTHONPATH=str(ROOT),
        PYTEST_DISABLE_PLUGIN_AUTOLOAD="1",
        ZBUF_OCCLUDE_NO_SKIP=refused,
    )
    said = {line.partition("::")[0].partition(" - ")[0].partition(":")[0] for line in child.stdout.splitlines()}
    assert outcomes <= said, child.stdout
    assert "LEFT OUT [1] long; .ci/run has them: python -m pytest -m long\n  test_slow.py::test\n" in child.stdout
