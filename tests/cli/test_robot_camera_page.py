"""docs/robot_camera.md: its commands and code, run as written with few, small images."""

import json
import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from tests.cli.conftest import Run

pytestmark = [
    pytest.mark.usefixtures("no_pictures"),
    *(pytest.mark.needs(each) for each in ("open3d", "networkx", "mcap_ros2", "rosbags", "PIL")),
]
PAGE = Path(__file__).resolve().parents[2] / "docs" / "robot_camera.md"
SMALL = {"realsense-d435": "realsense-d435:width=106,height=60,match_window=1", "fibonacci:30": "fibonacci:2"}


def test_the_page_as_written(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from PIL import Image

    monkeypatch.chdir(tmp_path)
    trimesh.creation.box((80, 50, 70)).export("part.stl")
    trimesh.creation.box((30, 100, 120)).export("box.stl")
    trimesh.creation.cylinder(radius=33, height=115).export("can.stl")
    names: dict[str, Any] = {}
    blocks = re.findall(r"^```(\w+)\n(.*?)^```", PAGE.read_text(), re.DOTALL | re.MULTILINE)
    assert [kind for kind, _ in blocks] == ["json", "bash", "python", "bash", "python", "bash"]
    for kind, code in blocks:
        if kind == "json":
            Path("scene.json").write_text(code)
        elif kind == "python":
            exec(compile(code, "page", "exec"), names)
        else:
            for large, small in SMALL.items():
                code = code.replace(large, small)
            run(f"{' '.join(shlex.split(code)[1:])} --workers 1")
    world, points, xyz = names["world"], names["points"], names["xyz"]
    assert points.shape == xyz.shape == (60, 106, 3)
    top = np.abs(world[:, 2] + 0.035) < 0.004
    assert 0.1 < top.mean() < 0.95, "the table's top is below the part by half its height"
    assert np.abs(world[top][:, :2]).max(axis=0) == pytest.approx([0.25, 0.2], abs=0.02), (
        "and as large as the file says"
    )
    last = json.loads(Path("bop/train/000000/scene_camera.json").read_text())["1"]
    assert last["depth_scale"] == 1.0
    assert len(json.loads(Path("bop/train/000000/scene_gt.json").read_text())["0"]) == 4
    depth = np.asarray(Image.open("bop/train/000000/depth/000001.png"))
    both = np.isfinite(xyz[..., 2])
    assert (both == (depth > 0)).all(), "the same noise in each format"
    assert depth[both] / 1000 == pytest.approx(xyz[..., 2][both], abs=0.00051)
