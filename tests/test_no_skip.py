"""Skips: where they are refused they fail, what was skipped can be run alone, and what cannot be loaded is named."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests import needs
from tests.needs import DEBIAN, lacking
from tests.processes import python

ROOT = Path(__file__).parents[1]


FILES = {
    "lacking": "import pytest\ndef test(): pytest.skip('no OpenGL here')",
    "data": "import pytest\ndef test(): pytest.skip('set ZBUF_OCCLUDE_DATA')",
    "module": "import pytest\npytest.importorskip('no_such_package', reason='not installed')\ndef test(): pass",
    "sound": "def test(): pass",
    "slow": "import pytest\n@pytest.mark.long\ndef test(): raise AssertionError",
}


@pytest.fixture
def suite(tmp_path: Path) -> Callable[..., str]:
    """A function that runs a suite of these files and returns what pytest said."""
    (tmp_path / "conftest.py").write_text((ROOT / "tests" / "conftest.py").read_text())
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = long\n  gl\n  needs\naddopts = -m 'not long'\n")
    for name, body in FILES.items():
        (tmp_path / f"test_{name}.py").write_text(body + "\n")

    def run(*options: str, **environment: str) -> str:
        return python(
            *("-m", "pytest", "-q", "-rA", "--no-fold-skipped", "--continue-on-collection-errors", *options, tmp_path),
            cwd=tmp_path,
            **{
                "PYTHONPATH": str(ROOT),
                "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
                "ZBUF_OCCLUDE_NO_SKIP": "",
                **environment,
            },
        ).stdout

    return run


def outcomes(said: str) -> set[str]:
    lines = {line.partition("::")[0].partition(" - ")[0].partition(":")[0] for line in said.splitlines()}
    return {line for line in lines if line.startswith(("FAILED", "ERROR", "SKIPPED", "PASSED"))}


@pytest.mark.parametrize(
    ("refused", "expected"),
    [
        ("1", {"FAILED test_lacking.py", "SKIPPED test_data.py", "ERROR test_module.py", "PASSED test_sound.py"}),
        ("", {"SKIPPED test_lacking.py", "SKIPPED test_data.py", "SKIPPED test_module.py", "PASSED test_sound.py"}),
    ],
)
def test_a_skip_is_refused_and_what_is_left_out_is_said(
    suite: Callable[..., str], refused: str, expected: set[str]
) -> None:
    said = suite(ZBUF_OCCLUDE_NO_SKIP=refused)
    assert outcomes(said) == expected, said
    assert "LEFT OUT [1] long; .ci/run has them: python -m pytest -m long\n  test_slow.py::test\n" in said


@pytest.mark.parametrize("processes", ["0", "2"])
def test_what_was_skipped_is_run_alone_once_it_can_be(
    suite: Callable[..., str], tmp_path: Path, processes: str
) -> None:
    options = ("-p", "xdist", "-n", processes)
    suite(*options)
    (tmp_path / "no_such_package.py").touch()
    said = suite(*options, "--skipped", PYTHONPATH=f"{ROOT}:{tmp_path}")
    assert outcomes(said) == {"SKIPPED test_lacking.py", "SKIPPED test_data.py", "PASSED test_module.py"}, said


def test_without_a_cache_tests_run_and_what_was_skipped_is_not_known(suite: Callable[..., str]) -> None:
    said = suite("-p", "no:cacheprovider")
    assert "PASSED test_sound.py" in outcomes(said)
    assert "1 passed, 3 skipped" in said.splitlines()[-1]
    assert "PASSED test_sound.py" not in outcomes(suite("-p", "no:cacheprovider", "--skipped"))


def test_a_file_of_which_all_failed_is_run_again(suite: Callable[..., str], tmp_path: Path) -> None:
    (tmp_path / "test_wrong.py").write_text("def test(): raise AssertionError\n")
    assert "FAILED test_wrong.py" in outcomes(suite())
    assert outcomes(suite("--lf")) == {"FAILED test_wrong.py"}


def test_what_cannot_be_loaded_is_named_with_what_helps(monkeypatch: pytest.MonkeyPatch) -> None:
    loads = {"crashes": "import os; os.abort()", "refuses": "raise OSError('libnowhere.so.7 is not there')", "is": ""}
    monkeypatch.setattr(needs, "PROGRAMS", loads)
    monkeypatch.setattr(needs, "DEBIAN", dict.fromkeys(loads, "libnowhere7"))
    found = {thing: lacking(thing) for thing in loads}
    lacking.cache_clear()
    assert found["is"] == ""
    assert "code -6" in found["crashes"]
    assert "libnowhere.so.7 is not there (Debian: apt-get install libnowhere7)" in found["refuses"]
    assert all("libnowhere7" in found[thing] for thing in ("crashes", "refuses"))


def test_the_packages_that_are_named_are_all_that_skips_ask_for() -> None:
    """One command of CONTRIBUTING.md installs what any skip names, and nothing else."""
    text = (ROOT / "CONTRIBUTING.md").read_text()
    command = text.partition("<!-- packages of tests -->")[2].partition("```bash\n")[2].partition("```")[0]
    named = command.replace("\\\n", " ").partition("--no-install-recommends")[2].split()
    assert set(named) == {package for packages in DEBIAN.values() for package in packages.split()}
    assert len(set(named)) == len(named)


def test_nothing_is_left_in_the_temporary_folder_but_pytests_own(suite: Callable[..., str], tmp_path: Path) -> None:
    (tmp_path / "test_sound.py").write_text("import tempfile\ndef test(tmp_path): tempfile.mkdtemp()\n")
    folder = tmp_path / "folder"
    folder.mkdir()
    # as in a shell: nothing of this suite's own
    said = suite(TMPDIR=str(folder), PYTEST_DEBUG_TEMPROOT=str(folder), PYTEST_XDIST_WORKER="")
    assert "PASSED test_sound.py" in outcomes(said)
    assert [path.name.partition("-of-")[0] for path in folder.iterdir()] == ["pytest"]
