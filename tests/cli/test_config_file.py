"""`generate --config`: a dataset is made again from its manifest; YAML; typed options go before; what is refused."""

import hashlib
import json
from pathlib import Path

import pytest

from tests.cli.conftest import Run

OPTIONS = "--views ring:3@20 --points 400 --sample-size 32 --method oracle --format npz --workers 1 --with normals"


def contents(out: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in out.rglob("*.npz")}


def test_a_manifest_makes_the_same_dataset_again(run: Run, modelnet: Path, tmp_path: Path) -> None:
    run(f"generate {OPTIONS} --out first", modelnet)
    command = json.loads((tmp_path / "first/manifest.json").read_text())["command"]
    assert command == {
        "meshes": [str(modelnet)], "views": "ring:3@20", "points": "400", "sample-size": "32", "method": "oracle",
        "format": "npz", "with": "normals",
    }  # fmt: skip
    run("generate --config first/manifest.json --workers 1 --out again")
    assert contents(tmp_path / "again") == contents(tmp_path / "first")
    run("generate --config first/manifest.json --workers 1 --seed 1 --out other")
    assert contents(tmp_path / "other") != contents(tmp_path / "first")
    manifest = json.loads((tmp_path / "other/manifest.json").read_text())
    assert (manifest["seed"], manifest["options"]["views"]) == (1, "ring:3@20")
    assert manifest["command"] == {**command, "seed": "1"}


def test_options_in_yaml(run: Run, modelnet: Path, tmp_path: Path) -> None:
    """Flags, lists and mappings as a person writes them; what is typed goes before."""
    (tmp_path / "job.yaml").write_text(
        f"meshes: [{modelnet}]\nviews: ring:5@20\npoints: 300\nsample-size: 16\nmethod: occupancy_grid\nset: {{n: 8}}\n"
        "complete: false\nwith: [normals]\n"
    )
    run("generate --config job.yaml --views ring:2@20 --workers 1 --out out")
    options = json.loads((tmp_path / "out/manifest.json").read_text())["options"]
    found = {name: options[name] for name in ("views", "n_points", "sample_size", "method_options", "attributes")}
    assert found == {
        "views": "ring:2@20", "n_points": 300, "sample_size": 16, "method_options": {"n": 8}, "attributes": ["normals"],
    }  # fmt: skip
    assert options["complete"] is False


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("veiws: paper100", "'veiws'"),
        ("- views", "options by name"),
        ("views: [", "must be YAML"),
        ("complete: perhaps", "must be true or false"),
        ("config: other.yaml", "'config'"),
        ("points: many", "--points"),
        ('{"fingerprint": "0"}', "command that made"),
    ],
)
def test_what_is_refused_is_named(run: Run, tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "job.yaml").write_text(text)
    run("generate --config job.yaml --out out", code=2, says=says)
    assert not (tmp_path / "out").exists()


def test_a_file_that_is_not_there(run: Run) -> None:
    run("generate --config none.yaml --out out", code=2, says="none.yaml")
