"""docs/camera_frame.md: its code, run as written, brings clouds back to the object; the truth is a slab's sides."""

import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.cli.conftest import Run, write_off
from tests.datasets.test_export import slab

pytest.importorskip("torch", reason="PyTorch is not installed")
pytestmark = pytest.mark.usefixtures("no_pictures")

PAGE = Path(__file__).resolve().parents[2] / "docs" / "camera_frame.md"
HALF = np.array([0.125, 0.25, 0.5])
"""Half the sides of the slab, in its longest side."""


def off_the_slab(points: Any, longest: float) -> np.ndarray:
    """Distances of points about the slab's centre from its surface, as far as they are along its normals."""
    heights = np.abs(np.asarray(points) / longest) - HALF
    return np.abs(heights.max(axis=1)) * longest


def test_the_code_of_the_page_leads_there_and_back(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    mesh = slab()
    write_off(tmp_path / "chair.off", (mesh.vertices - mesh.centre) / 4, mesh.faces)  # a metre long
    for name in ("a", "b"):
        write_off(tmp_path / "meshes" / "chair" / f"{name}.off", mesh.vertices, mesh.faces)
    names: dict[str, Any] = {}
    blocks = re.findall(r"^```(python|bash)\n(.*?)^```", PAGE.read_text(), re.DOTALL | re.MULTILINE)
    kinds = [kind for kind, _ in blocks]
    assert kinds == ["python", "bash", "python", "python", "bash", "python"]
    for number, (kind, code) in enumerate(blocks):
        if kind == "bash":
            run(f"{' '.join(shlex.split(code)[1:])} --workers 1")
            continue
        exec(compile(code, f"block {number}", "exec"), names)
        if number == 0:
            assert np.median(off_the_slab(names["back"], 1.0)) < 0.02, "noise of the sensor"
            assert (names["cloud"].points[:, 2] > 2.0).all(), "z is forward"
            towards = (names["cloud"].points * names["cloud"].normals).sum(axis=1)
            assert (towards < 0).all()
        elif number == 2:
            assert off_the_slab(names["in_object"], 0.5).max() < 1e-4
            part = (names["partial"] - names["translation"]) @ names["rotation"]
            assert np.median(off_the_slab(part, 0.5)) < 0.01
            assert 0.7 < float(names["partial"][:, 2].mean()) < 2.2
        elif number == 3:
            pose = names["pose"]
            back = (names["complete"] - pose[:3, 3]) @ pose[:3, :3]
            assert off_the_slab(back, 0.5).max() < 1e-4
            assert 10 <= np.degrees(np.arcsin(-float(pose[2, 2]))) <= 60, "the camera looks down"
        else:
            assert off_the_slab(names["in_mesh"] - mesh.centre, 4.0).max() < 1e-3
