"""`depth` writes one image three ways."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.cli.conftest import Run, write_off
from zbuf_occlude.gl.context import GlContext

OpenEXR = pytest.importorskip("OpenEXR")
TILTED = np.array([[-2, -1, -1], [2, -1, 1], [2, 1, 1], [-2, 1, -1]]), np.array([[0, 1, 2], [0, 2, 3]])


def test_the_command_writes_the_same_numbers_everywhere(gl: GlContext, run: Run, tmp_path: Path) -> None:
    mesh = write_off(tmp_path / "tilted.off", *TILTED)
    paths = [tmp_path / f"depth{suffix}" for suffix in (".npy", ".exr", ".png")]
    for path in paths:
        outcome = run("depth", mesh, "--azimuth=0", "--elevation=90", "--size=64", "--out", path)
        assert outcome.code == 0, outcome.err
        assert f": {path}" in outcome.out
    array = np.load(paths[0])
    with OpenEXR.File(str(paths[1])) as exr:
        assert np.array_equal(exr.channels()["Z"].pixels, array)
    grey = np.asarray(Image.open(paths[2])).astype(int)
    assert ((grey > 0) == np.isfinite(array)).all()
    assert grey.max() == 65535
    assert np.unravel_index(grey.argmax(), grey.shape)[0] == np.unravel_index(array.argmin(), array.shape)[0]
