"""benchmarks/gpu.py: parts that fail or are there already, steps within steps, and the serial share of a job."""

import json
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

import gpu
import gpu_parts
import gpu_speed


def counted(amount: Any) -> dict[str, Any]:
    return {"meshes": amount.meshes}


def broken(amount: Any) -> dict[str, Any]:
    raise ZeroDivisionError("nothing to divide by")


def test_a_part_that_failed_is_run_again_and_one_that_is_there_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gpu, "PARTS", {"right": broken, "frames": counted})
    assert not gpu.made("right", tmp_path, "A card", True)
    record = json.loads((tmp_path / "right.json").read_text())
    assert "nothing to divide by" in record["failure"]
    assert gpu.made("frames", tmp_path, "A card", True)
    monkeypatch.setattr(gpu, "PARTS", {"right": counted, "frames": broken})
    assert gpu.made("right", tmp_path, "A card", True)
    assert gpu.made("frames", tmp_path, "A card", True)
    assert gpu.read(tmp_path, "right")["found"] == {"meshes": gpu_parts.SMALL.meshes}
    for renderer, small in (("Another card", True), ("A card", False)):
        with pytest.raises(SystemExit, match="another folder"):
            gpu.made("frames", tmp_path, renderer, small)


@pytest.mark.parametrize(("software", "small", "refused"), [(True, False, True), (False, False, False)])
def test_a_cpu_is_measured_only_in_small(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, software: bool, small: bool, refused: bool
) -> None:
    monkeypatch.setattr(gpu, "call_in_child", lambda *_, **__: ("llvmpipe", software))
    monkeypatch.setattr(gpu, "made", lambda *_: True)
    if refused:
        with pytest.raises(SystemExit, match="no GPU but a CPU"):
            gpu.main(out=tmp_path, small=small)
    else:
        assert gpu.main(out=tmp_path, small=small) == 0


def test_a_step_is_clocked_without_the_steps_within(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gpu_speed.Buffers, "read_into", lambda self: time.sleep(0.02))
    monkeypatch.setattr(gpu_speed.PointPass, "fetch", lambda self: gpu_speed.Buffers.read_into(self))
    gl: Any = SimpleNamespace(wait=lambda: None)
    with gpu_speed.watched(gl) as spent:
        gpu_speed.PointPass.fetch(None)  # type: ignore[arg-type]
    assert spent["transfer"] >= 0.02
    assert spent["unpack"] < spent["transfer"]


def test_the_serial_share_is_that_of_amdahls_law(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [{"workers": n, "clock": 2.0 + 8.0 / n} for n in (8, 4, 2, 1)]
    monkeypatch.setattr(gpu_parts, "datasets_made", lambda *_: {"rows": rows})
    found = gpu_parts.cores(gpu_parts.SMALL)
    assert found["serial_share"] == pytest.approx(0.2)
    assert found["serial_seconds"] == pytest.approx(2.0)
