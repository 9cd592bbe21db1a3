"""What is in datasets: the same as ever (digests.json), for any number of workers, in shards, after kills."""

import json
import os
import random
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest

from tests.net.digests import DATASETS, Contents, command, convert, generate, write_meshes

EXPECTED = json.loads(Path(__file__).with_name("digests.json").read_text())
SOME_FAILED = 3  # the exit code: one of the meshes cannot be read

long = pytest.mark.long


@pytest.fixture(scope="module")
def meshes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_meshes(tmp_path_factory.mktemp("net") / "meshes")


def run(line: list[str], code: int = SOME_FAILED) -> None:
    assert subprocess.run(line, check=False).returncode == code, line


@pytest.mark.parametrize("name", DATASETS)
def test_as_ever_for_any_number_of_workers_and_in_two_shards(name: str, meshes: Path, tmp_path: Path) -> None:
    """By one worker, and in two shards by two and by three; those that are killed below have two."""
    one, shards = tmp_path / "one", tmp_path / "shards"
    run(generate(name, meshes, one, "--workers", 1))  # alone, as it may have to compile
    lines = [generate(name, meshes, shards, "--workers", 2 + i, "--shard", f"{i}/2") for i in (0, 1)]
    together = [subprocess.Popen(line) for line in lines]
    expected = Contents(name, one)
    assert expected.digests == EXPECTED[name]
    assert {process.wait() for process in together} <= {0, SOME_FAILED}  # 0: of a share without the broken mesh
    run(command("merge", shards))
    found = Contents(name, shards)
    assert (found.digests, found.places) == (EXPECTED[name], expected.places)
    assert found.manifest["error"] == expected.manifest["error"]


def test_packed_is_converted_to_what_it_was(meshes: Path, tmp_path: Path) -> None:
    run(generate("packed", meshes, tmp_path / "packed"))
    run(convert(tmp_path / "packed", tmp_path / "hdf5"), 0)
    assert Contents("hdf5", tmp_path / "hdf5").digests == EXPECTED["packed converted"]


@long
def test_ray_makes_the_same(meshes: Path, tmp_path: Path) -> None:
    run(generate("hdf5", meshes, tmp_path / "ray", "--engine", "ray"))
    assert Contents("hdf5", tmp_path / "ray").digests == EXPECTED["hdf5"]


@pytest.mark.parametrize(
    ("name", "n_kills"),
    [("hdf5", 3), ("pcn", 2), *(pytest.param(name, 2, marks=long) for name in DATASETS if name not in ("hdf5", "pcn"))],
)
def test_killed_at_random_moments_and_resumed(name: str, n_kills: int, meshes: Path, tmp_path: Path) -> None:
    seed = random.SystemRandom().randrange(10**6)
    print(f"moments of the kills: seed {seed}")  # noqa: T201  (pytest shows it where the test fails)
    rng, out = random.Random(seed), tmp_path / "out"
    line, begun = generate(name, meshes, out, "--workers", 2), time.monotonic()
    run(line)
    seconds = time.monotonic() - begun
    shutil.rmtree(out)
    while n_kills:
        begun = time.monotonic()
        process = subprocess.Popen(line, start_new_session=True)
        try:
            assert process.wait(rng.uniform(0.3, 1.0) * seconds) == SOME_FAILED
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            n_kills -= 1
        else:  # done before its kill: the first run compiled, or the machine was busy
            seconds = min(seconds, time.monotonic() - begun)
            assert Contents(name, out).digests == EXPECTED[name]
            shutil.rmtree(out)
    run(line)
    assert Contents(name, out).digests == EXPECTED[name]


def test_what_is_finished_stays(meshes: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """The same command changes nothing, another is refused, a foreign file survives, and damage is found."""
    out, foreign = tmp_path / "npz", tmp_path / "npz" / "notes.txt"
    line, verify = generate("npz", meshes, out), command("verify", out, meshes)
    run(line)
    foreign.write_text("mine")
    before = {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in out.glob("*.npz")}
    run(line)
    run([*line, "--seed", "8"], 1)
    assert "seed was 7, and is 8" in capfd.readouterr().err
    assert {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in out.glob("*.npz")} == before
    assert foreign.read_text() == "mine"
    run(verify, 0)
    path = next(iter(before))
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    run(verify, 1)
    assert path.name in "".join(capfd.readouterr())
