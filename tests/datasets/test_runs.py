"""Runs by the command line that meet each other, that are interrupted, or whose inputs or outputs are changed."""

import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zbuf_occlude
from tests.cli.conftest import write_off
from tests.datasets.test_generate import files
from tests.scenes import box

SMALL = "--limit 4 --method exact --views ring:3@30 --points 2048 --sample-size 64 --workers 1"
FORMATS = {
    "hdf5": SMALL,
    "ply": SMALL,
    "epn3d": "--limit 4 --method exact --points 2048 --workers 1",
    "pairs": "--limit 2 --method exact --points 2048 --sample-size 64 --views fibonacci:8 --workers 1",
    "mvp": "--limit 2 --method exact --points 2048 --workers 1",
}
"""One that is written at once, and exports from both formats that layouts are made from."""


def begin(folder: Path, line: str, **options: Any) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "zbuf_occlude", *line.split()]
    pipes: Any = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(command, cwd=folder, **pipes, **options)


def command(folder: Path, line: str, code: int = 0) -> str:
    """Run a command line in a folder to its end; return what it said."""
    process = begin(folder, line)
    out, err = process.communicate()
    assert process.returncode == code, err
    assert "Traceback" not in err
    return out + err


def wait_for(path: Path, process: subprocess.Popen[str]) -> None:
    while not path.exists() and process.poll() is None:
        time.sleep(0.001)


@pytest.mark.long
@pytest.mark.parametrize("format", FORMATS)
def test_of_two_runs_at_once_one_is_refused_or_both_end_whole(tmp_path: Path, format: str) -> None:
    line = f"generate --format {format} {FORMATS[format]} --out"
    command(tmp_path, f"{line} alone")
    expected, refused = files(tmp_path / "alone"), 0
    for moment in ("plan.json", "shards/000000.json", "work/export", "work/export.json", "manifest.json"):
        runs = [begin(tmp_path, f"{line} out")]
        wait_for(tmp_path / "out" / moment, runs[0])
        runs.append(begin(tmp_path, f"{line} out"))
        said = [run.communicate()[1] for run in runs]
        codes = [run.returncode for run in runs]
        assert 0 in codes, said
        assert files(tmp_path / "out") == expected
        if codes != [0, 0]:
            refused += 1
            assert "one run at a time" in said[codes.index(1)]
        shutil.rmtree(tmp_path / "out")
    assert refused < 5, "a run that begins when the other has ended finds it done"


@pytest.mark.parametrize("format", ["hdf5", "pairs", "modelnet40-c", "mvp"])
def test_a_file_without_room_ends_a_run_with_one_line(tmp_path: Path, format: str) -> None:
    """No file may grow beyond a limit, as on a full disk; HDF5 and memory maps would end the process by a signal."""
    line = f"generate --format {format} {FORMATS.get(format, SMALL)} --out"
    command(tmp_path, f"{line} alone")
    sizes = {path.relative_to(tmp_path / "alone"): path.stat().st_size for path in (tmp_path / "alone").rglob("*.*")}
    most = int(
        (0.5 if format == "hdf5" else 0.9) * max(size for path, size in sizes.items() if path.suffix in (".h5", ".npy"))
    )

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))

    process = begin(tmp_path, f"{line} out", preexec_fn=limit)
    _, err = process.communicate()
    assert process.returncode == 1, err
    assert len(re.findall(r"^error: File too large", err, re.MULTILINE)) == 1, err
    assert "Traceback" not in err
    command(tmp_path, f"{line} out")
    assert files(tmp_path / "out") == files(tmp_path / "alone")


def test_no_file_of_a_dataset_is_written_through_a_memory_map() -> None:
    """On a full disk a memory map ends the process by SIGBUS, and HDF5 on a file by SIGSEGV."""
    sources = sorted((Path(zbuf_occlude.__file__).parent / "datasets").rglob("*.py"))
    writing = re.compile(r"memmap|h5py\.File\((?!disk, )[^)]*, *\"[wa]")
    assert sources
    assert [path.name for path in sources if writing.search(path.read_text())] == []


@pytest.mark.parametrize("format", ["hdf5", "epn3d"])
def test_a_damaged_file_of_a_finished_dataset_is_made_again(tmp_path: Path, format: str) -> None:
    line = f"generate --format {format} {FORMATS[format]} --out out"
    command(tmp_path, line)
    expected = files(tmp_path / "out")
    path = max((path for path in (tmp_path / "out").rglob("*") if path.suffix in (".h5", ".npy")), key=str)
    for damage in ("cut", "gone"):
        os.truncate(path, 100) if damage == "cut" else path.unlink()
        said = command(tmp_path, line)
        assert f"{path.name} is missing or damaged, and is made again" in said
        assert files(tmp_path / "out") == expected
    assert "made again" not in command(tmp_path, line)


@pytest.mark.long
class TestInterrupts:
    """Ctrl-C reaches a run and its workers alike."""

    @pytest.mark.parametrize("moment", ["work/export", "work/export.json", "shards/000000.json"])
    def test_an_interrupted_export_is_overwritten_or_resumed(self, tmp_path: Path, moment: str) -> None:
        line = f"generate --format epn3d {FORMATS['epn3d']} --out"
        command(tmp_path, f"{line} alone")
        expected, out = files(tmp_path / "alone"), tmp_path / "out"
        for more in ("", " --overwrite"):
            for stop in (signal.SIGINT, signal.SIGKILL):
                process = begin(tmp_path, f"{line} out --overwrite", start_new_session=True)
                wait_for(out / moment, process)
                os.killpg(process.pid, stop)
                process.communicate()
                assert process.returncode in (130, -9)
                command(tmp_path, f"{line} out{more}")
                assert files(out) == expected
        assert not (out / "work").exists()

    @pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
    def test_the_end_of_a_run_whose_workers_start_is_no_traceback(self, tmp_path: Path, stop: int) -> None:
        command(tmp_path, f"generate {SMALL} --out out")
        rng = np.random.default_rng(stop)
        for _ in range(6):
            process = begin(tmp_path, "verify out --workers 4", start_new_session=True)
            time.sleep(rng.uniform(0.3, 1.5))
            os.killpg(process.pid, signal.SIGINT) if stop == signal.SIGINT else process.send_signal(stop)
            _, err = process.communicate()
            assert "Traceback" not in err
            assert "Error" not in err


class TestInputs:
    """Files that are changed between two runs of a command are no longer what its data are made of."""

    LINE = "generate ball.off --sensor pinhole:width=24,height=18 --range 4 --size 1 --keep all --views V --workers 1"

    @pytest.fixture
    def folder(self, tmp_path: Path) -> Path:
        write_off(tmp_path / "ball.off", box().vertices, box().faces)
        write_off(tmp_path / "wall.off", box((1.0, 2.0, 3.0)).vertices, box().faces)
        scene = {"objects": [{"mesh": "wall.off", "position": [0, 2, 0]}, {"class": "truck", "position": [9, 9, 0]}]}
        (tmp_path / "scene.json").write_text(json.dumps(scene))
        self.write_camera(tmp_path, 5.0)
        return tmp_path

    @staticmethod
    def write_camera(folder: Path, distance: float) -> None:
        camera = {"R": np.eye(3).tolist(), "t": [0, 0, distance], "K": [[30, 0, 12], [0, 30, 9], [0, 0, 1]]}
        (folder / "cameras.json").write_text(json.dumps(camera | {"width": 24, "height": 18}))

    @staticmethod
    def write_sensor(folder: Path, columns: int) -> None:
        (folder / "sensor.yaml").write_text(f"kind: spinning\nlasers: [-8, 0, 8]\ncolumns: {columns}\nrange_max: 80\n")

    @staticmethod
    def write_drive(folder: Path, metres: float) -> None:
        np.savetxt(folder / "drive.txt", [[0, 0, 0, 0, 0, 0, 0, 1], [1, metres, 0, 0, 0, 0, 0, 1]])

    def change(self, folder: Path, what: str, number: float) -> None:
        if what == "mesh of the scene":
            write_off(folder / "wall.off", box((1.0, 2.0, number)).vertices, box().faces)
        elif what == "scene":
            text = (folder / "scene.json").read_text()
            (folder / "scene.json").write_text(re.sub(r"\[0, \d", f"[0, {number:.0f}", text))
        elif what == "cameras":
            self.write_camera(folder, number)
        elif what == "sensor":
            numbers = f"columns: {number * 30:.0f}\nrange_max: 80\n"
            (folder / "sensor.yaml").write_text(f"kind: spinning\nlasers: [-8, 0, 8]\n{numbers}")
        else:
            np.savetxt(folder / "drive.txt", [[0, 0, 0, 0, 0, 0, 0, 1], [1, number, 0, 0, 0, 0, 0, 1]])

    def test_verify_names_a_mesh_of_the_scene_that_was_changed_since(self, folder: Path) -> None:
        command(folder, self.LINE.replace("V", "ring:2@20") + " --scene scene.json --sample-size 64 --out out")
        command(folder, "verify out ball.off --samples 2")
        self.change(folder, "mesh of the scene", 4)
        assert "wall.off" in command(folder, "verify out ball.off --samples 2", code=1)

    @pytest.mark.parametrize("changed", ["mesh of the scene", "scene", "cameras", "sensor", "trajectory"])
    def test_a_changed_input_is_refused(self, folder: Path, changed: str) -> None:
        line = self.LINE.replace("V", "ring:2@20") + " --scene scene.json --out out"
        if changed == "cameras":
            line = line.replace("ring:2@20", "cameras.json").replace("--range 4 ", "")
        elif changed == "sensor":
            line = line.replace("pinhole:width=24,height=18", "sensor.yaml")
        elif changed == "trajectory":
            line = line.replace("pinhole:width=24,height=18", "vlp-16") + " --trajectory drive.txt"
        self.change(folder, changed, 3)
        command(folder, line + " --shard 0/2")
        named = {"mesh of the scene": "objects.0.sha256", "scene": "objects.0.position"}.get(changed, "")
        for number in (4, 3):  # unfinished, and finished
            before = files(folder / "out")
            self.change(folder, changed, number)
            said = command(folder, line, code=1)
            assert "must be empty or hold this same plan" in said
            assert named in said
            assert files(folder / "out") == before
            command(folder, f"{line} --overwrite")
            assert files(folder / "out").keys() >= {"plan.json", "ply_data_train0.h5"}
