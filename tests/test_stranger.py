"""A stranger adds a method, a view specification and a format through the public tables only, and uses all three."""

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import zbuf_occlude.dataset.formats as formats
import zbuf_occlude.views.specs as specs
import zbuf_occlude.visibility as visibility
from tests.scenes import box
from zbuf_occlude import Mesh
from zbuf_occlude.dataset.convert import open_dataset
from zbuf_occlude.dataset.formats import Format
from zbuf_occlude.dataset.generate import generate
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.dataset.source import Content, Source, kept, source_of_files
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry
from zbuf_occlude.views import Specification, Views
from zbuf_occlude.visibility.interface import Method, Occluder

ARCHITECTURE = Path(__file__).parents[1] / "docs" / "architecture.md"


class Near(Occluder):
    """A toy: a point is visible from an eye on its own side of the origin."""

    def _visible(self, points: Any, eyes: Any) -> Any:
        return eyes @ points.positions.T > 0


def prepare(mesh: Mesh) -> Near:
    """Prepare a mesh, as the row of the method says."""
    return Near(mesh)


def names(plan: Plan) -> Iterator[str]:
    """Name the toy format's files."""
    return (f"toy_{part.split}{part.number}.npy" for part in plan.parts)


def write_part(content: Content, out: Path) -> list[str]:
    """A toy format: records in .npy files."""
    name = f"toy_{content.split}{content.number}.npy"
    np.save(out / name, content.records)
    return [name]


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Read them back."""
    paths = {split: [out / name for name in names] for split, names in files.items()}
    return source_of_files(plan, paths, lambda path: len(np.load(path)), kept(np.load))


@pytest.fixture
def toys(monkeypatch: pytest.MonkeyPatch) -> None:
    """One row in each table."""
    near = Method("near", "what is on the eye's side of the origin", f"{__name__}:prepare")
    monkeypatch.setattr(visibility, "METHODS", (*visibility.METHODS, near))
    corners = Specification(
        "corners",
        "corners",
        lambda found, distance, seed: Views(np.radians([45.0, 225.0]), np.radians([35.0, -35.0]), np.array(distance)),
    )
    monkeypatch.setattr(specs, "SPECIFICATIONS", (*specs.SPECIFICATIONS, corners))
    module = ModuleType("zbuf_occlude.dataset.formats.toy")
    module.names, module.write_part, module.read = names, write_part, read  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr(formats, "FORMATS", (*formats.FORMATS, Format("toy", "records in .npy files")))


@pytest.mark.usefixtures("toys")
def test_a_dataset_by_three_toys(tmp_path: Path) -> None:
    meshes = MeshCollection([MeshEntry("a/box.off", "a", "train", box)])
    recipe = Recipe(method="near", views="corners", n_points=600, sample_size=100, scale="mesh")
    manifest = generate(Plan(meshes, recipe, "toy"), tmp_path / "out")
    assert manifest["counts"]["clouds"] == 2
    source = open_dataset(tmp_path / "out")
    clouds = source.take(source.order["train"])
    assert sorted(np.degrees(clouds["view"][:, 0]).round().tolist()) == [45, 225]
    for cloud in clouds:
        eye = -cloud["pose"][:3, :3].T @ cloud["pose"][:3, 3]
        assert (cloud["data"] @ eye > 0).all()


def test_the_page_names_the_files_to_open() -> None:
    page = " ".join(ARCHITECTURE.read_text().split())
    for what, names in {
        "a method": ("visibility/", "METHODS"),
        "a view specification": ("views/specs.py", "SPECIFICATIONS"),
        "a format": ("dataset/formats/", "FORMATS"),
        "a layout": ("meshes/layouts/", "LAYOUTS"),
    }.items():
        paragraph = re.search(rf"\*\*To add {what}\*\*[^*]*", page)
        assert paragraph is not None, what
        assert all(name in paragraph[0] for name in names), what
