"""A stranger adds a method, a view specification and a format through the public tables only, and uses all three."""

import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import zbuf_occlude.datasets.formats as formats
import zbuf_occlude.views.positions as specs
import zbuf_occlude.visibility as visibility
from tests.scenes import box
from zbuf_occlude import Mesh
from zbuf_occlude.base.atomic import FileDigest, write_data
from zbuf_occlude.datasets.export import Exported
from zbuf_occlude.datasets.formats import Format
from zbuf_occlude.datasets.generate import generate
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.datasets.source import CloudReader, kept, open_dataset, source_of_files
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry
from zbuf_occlude.sensors import SENSORS, make
from zbuf_occlude.sensors.catalog import SensorRow
from zbuf_occlude.views import Specification, Views
from zbuf_occlude.visibility.interface import Method, VisibilityQuery

ARCHITECTURE = Path(__file__).parents[1] / "docs" / "architecture.md"


class Near(VisibilityQuery):
    """A toy: a point is visible from an eye on its own side of the origin."""

    def _visible(self, points: Any, eyes: Any) -> Any:
        return eyes @ points.positions.T > 0


def prepare(mesh: Mesh) -> Near:
    """Prepare a mesh, as the row of the method says."""
    return Near(mesh)


def file_name(split: str, number: int) -> str:
    """Name a file of the toy format."""
    return f"toy_{split}{number}.npy"


def write(path: Path, records: Any, plan: Plan, number: int = 0) -> FileDigest:
    """Write the toy format: records in .npy files."""
    return write_data(path, lambda file: np.save(file, records))


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> CloudReader:
    """Read them back."""
    return source_of_files(plan, out, files, lambda path: len(np.load(path)), kept(np.load))


def export(source: CloudReader, out: Path) -> Exported:
    """Write the toy layout: a text file for each split, a line for each cloud's class and first point."""
    for split, numbers in source.order.items():
        lines = [f"{source.plan.classes[int(r['label'][0])]} {r['data'][0]}" for r in source.take(numbers)]
        (out / f"{split}.txt").write_text("\n".join(lines))
    return Exported({split: [f"{split}.txt"] for split in source.order}, source.n_clouds)


@pytest.fixture
def toys(monkeypatch: pytest.MonkeyPatch) -> None:
    """One row in each table."""
    near = Method("near", "what is on the eye's side of the origin")
    method = ModuleType(near.module)
    method.prepare = prepare  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, near.module, method)
    monkeypatch.setattr(visibility, "METHODS", (*visibility.METHODS, near))
    corners = Specification(
        "corners",
        "corners",
        lambda found, distance, seed: Views(np.radians([45.0, 225.0]), np.radians([35.0, -35.0]), np.array(distance)),
    )
    monkeypatch.setattr(specs, "SPECIFICATIONS", (*specs.SPECIFICATIONS, corners))
    module = ModuleType("zbuf_occlude.datasets.formats.toy")
    module.file_name, module.write, module.read = file_name, write, read  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, module.__name__, module)
    layout = ModuleType("zbuf_occlude.datasets.export.lines")
    layout.export = export  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, layout.__name__, layout)
    rows = (Format("toy", "records in .npy files"), Format("lines", "a line for each cloud", "toy"))
    monkeypatch.setattr(formats, "FORMATS", (*formats.FORMATS, *rows))
    camera = SensorRow(
        "toy-camera", "pinhole", "two by two", {"width": (2, "a toy"), "height": (2, "a toy"), "fov": (60, "")}
    )
    monkeypatch.setitem(SENSORS, camera.name, camera.sensor())


@pytest.mark.usefixtures("toys")
def test_a_dataset_by_three_toys(tmp_path: Path) -> None:
    meshes = MeshCollection([MeshEntry("a/box.off", "a", "train", box)])
    config = DatasetConfig(method="near", views="corners", n_points=600, sample_size=100, scale="mesh")
    manifest = generate(Plan(meshes, config, "toy"), tmp_path / "out")
    assert manifest["counts"]["clouds"] == 2
    source = open_dataset(tmp_path / "out")
    clouds = source.take(source.order["train"])
    assert sorted(np.degrees(clouds["view"][:, 0]).round().tolist()) == [45, 225]
    for cloud in clouds:
        eye = -cloud["pose"][:3, :3].T @ cloud["pose"][:3, 3]
        assert (cloud["data"] @ eye > 0).all()
    generate(Plan(meshes, config, "lines"), tmp_path / "lines")
    lines = (tmp_path / "lines" / "train.txt").read_text().split("\n")
    assert [line.split()[0] for line in lines] == ["a", "a"]
    assert len(make("toy-camera").rays()) == 4


def test_the_page_names_the_files_to_open() -> None:
    page = " ".join(ARCHITECTURE.read_text().split())
    for what, names in {
        "a method": ("visibility/", "METHODS"),
        "a view specification": ("views/positions.py", "SPECIFICATIONS"),
        "a format": ("datasets/formats/", "FORMATS"),
        "an export": ("datasets/export/", "FORMATS"),
        "a layout": ("meshes/layouts", "LAYOUTS"),
    }.items():
        paragraph = re.search(rf"\*\*To add {what}\*\*[^*]*", page)
        assert paragraph is not None, what
        assert all(name in paragraph[0] for name in names), what
