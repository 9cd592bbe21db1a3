"""`zbuf-occlude visible --out partial.obj`: the visible part as a mesh."""

from pathlib import Path

import pytest

import zbuf_occlude as zo
from tests.cli.conftest import Run
from tests.scenes import box


@pytest.mark.parametrize("suffix", ["obj", "off"])
def test_the_part_is_written_as_a_mesh(run: Run, tmp_path: Path, suffix: str) -> None:
    mesh, out = tmp_path / "box.off", tmp_path / f"part.{suffix}"
    mesh.write_text(box().to_trimesh().export(file_type="off"))
    line = ["visible", mesh, "--azimuth", "30", "--elevation", "20", "--out", out]
    done = run(*line)
    assert done.code == 0, done.err
    assert "50.0% of the surface" in done.out
    assert zo.load_mesh(out, up="z").areas.sum() == pytest.approx(box().areas.sum() / 2)
    done = run(*line, "--points", "9")
    assert done.code == 2
    assert "--points" in done.err
    assert "--method must be exact" in run(*line, "--method", "oracle").err
    assert run(*line, "--method", "exact").code == 0
