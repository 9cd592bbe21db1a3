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
    ("text", "typed", "lacking"),
    [
        ("points: 300", "--density 50", "points"),
        ("density: 50", "--points 300", "density"),
        ("shapes: road-users", "meshes", "shapes"),
        ("meshes: [meshes]\nup: y\nunit: mm", "--shapes formulas", "meshes, unit, up"),
        ("method: occupancy_grid\nset: {n: 8}", "--method oracle", "set"),
        ("complete: true", "--method oracle", "complete"),
        ("method: oracle", "--complete", "method"),
        (
            "sensor: vlp-16\nsize: 2\nrange: 5..9\nscene: street\nhidden: 0..0.5\nkeep: all",
            "--complete",
            "hidden, keep",
        ),
        ("method: exact\nset: {contact: 0.001}\npoints: 9", "--sensor vlp-16", "points, set"),
        ("sensor: hdl-64e\nset-sensor: {columns: 90}", "--sensor vlp-16", "set-sensor"),
        (
            "sensor: vlp-16\nrange: 5..9\nsize: 2\nscene: street\nhidden: 0..0.5\nkeep: all\nleast-points: 3",
            "--sensor surface",
            "hidden, keep, least-points, range, scene, size",
        ),
        ("frame: camera\naxes: opencv", "--frame object", "axes"),
        ("format: pairs\noverlap: 0.3..0.7", "--format hdf5", "overlap"),
    ],
)
@pytest.mark.usefixtures("modelnet")
def test_typed_options_replace_those_that_they_exclude(
    run: Run, tmp_path: Path, text: str, typed: str, lacking: str
) -> None:
    """The names left out are said; the command runs as if the file did not have them."""
    (tmp_path / "job.yaml").write_text(text + "\n")
    small = "--views ring:2@20 --sample-size 16 --limit 1 --workers 1 --dry-run --out out"
    assert f"job.yaml: {lacking} left out" in run(f"generate --config job.yaml {small} {typed}").err


def test_settings_of_the_method_that_the_file_has_too_stay(run: Run, modelnet: Path, tmp_path: Path) -> None:
    (tmp_path / "job.yaml").write_text(f"meshes: [{modelnet}]\nmethod: occupancy_grid\nset: {{n: 8}}\nlimit: 1\n")
    run("generate --config job.yaml --method occupancy_grid --views ring:2@20 --workers 1 --points 60 --out out")
    assert json.loads((tmp_path / "out/manifest.json").read_text())["options"]["method_options"] == {"n": 8}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("veiws: paper100", "'veiws'"),
        ("- views", "options by name"),
        ("views: [", "must be YAML"),
        ("complete: perhaps", "must be true or false"),
        ("config: other.yaml", "cannot name another"),
        ("views: null", "views must have a value"),
        ("seed:", "seed must have a value"),
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
