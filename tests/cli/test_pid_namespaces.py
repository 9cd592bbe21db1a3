"""Containers that share a folder: processes of the same numbers, at the same time, make one dataset."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import write_off

UNSHARE = ["unshare", "--map-root-user", "--pid", "--fork", "--mount-proc"]
N_MACHINES = 4


@pytest.fixture
def meshes(tmp_path: Path) -> Path:
    for number in range(2 * N_MACHINES):
        vertices = np.vstack([np.zeros(3), np.diag([1.0, 2.0, 1.0 + number])])
        write_off(tmp_path / f"meshes/solid/solid_{number}.off", vertices, np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3]]))
    return tmp_path / "meshes"


@pytest.mark.long
def test_parts_made_in_namespaces_of_their_own_are_one_dataset(meshes: Path, tmp_path: Path) -> None:
    if shutil.which(UNSHARE[0]) is None or subprocess.run([*UNSHARE, "true"], capture_output=True).returncode:
        pytest.skip("this machine may not make PID namespaces")

    def command(out: str) -> list[str]:
        options = ["--method=exact", "--views=ring:4096@20", "--points=40", "--sample-size=8", "--workers=1"]
        return [sys.executable, "-m", "zbuf_occlude", "generate", str(meshes), *options, "--out", str(tmp_path / out)]

    # 4,096 views of eight meshes: two shards for each machine
    subprocess.run(command("alone"), check=True, capture_output=True)
    machines = [
        subprocess.Popen(
            [*UNSHARE, *command("out"), "--shard", f"{i}/{N_MACHINES}"],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
        for i in range(N_MACHINES)
    ]
    said = [machine.communicate(timeout=120)[0].decode() for machine in machines]
    assert [machine.returncode for machine in machines] == [0] * N_MACHINES, said
    merge = [sys.executable, "-m", "zbuf_occlude", "merge", str(tmp_path / "out")]
    subprocess.run(merge, check=True, capture_output=True)
    assert len(list((tmp_path / "out" / "shards").iterdir())) == 2 * N_MACHINES
    assert contents(tmp_path / "out") == contents(tmp_path / "alone")


def contents(out: Path) -> dict[str, object]:
    """Every file of a dataset, but the sidecars of shards; the manifest without its times."""
    found: dict[str, object] = {
        str(path.relative_to(out)): path.read_bytes()
        for path in out.rglob("*")
        if path.is_file() and path.parent.name != "shards"
    }
    manifest = json.loads((out / "manifest.json").read_text())
    return found | {"manifest.json": {key: value for key, value in manifest.items() if key != "seconds"}}
