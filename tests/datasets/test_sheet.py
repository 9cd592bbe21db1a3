"""The contact sheet shows whole clouds, under names in any script."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.scenes import sphere
from zbuf_occlude import views
from zbuf_occlude.datasets import gallery
from zbuf_occlude.datasets.gallery import PANEL, TITLE, write_contact_sheet
from zbuf_occlude.datasets.generate import generate
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.datasets.source import open_dataset
from zbuf_occlude.geometry.camera import view_matrices
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry

CONFIG = DatasetConfig(method="exact")


def cloud_of(positions: np.ndarray, label: int = 0) -> np.ndarray:
    """A record, (1,)."""
    n = len(positions)
    view = views.ring(1, elevation=34)
    fields = {"data": (n, 3), "label": 1, "view": 3, "pose": (4, 4), "centre": 3, "factor": ()}
    cloud = np.zeros(1, [(field, "i8" if field == "label" else "f4", shape) for field, shape in fields.items()])
    cloud["data"], cloud["factor"], cloud["pose"] = positions, 1.0, view_matrices(view.eyes, np.zeros(3))
    cloud["label"] = label
    return cloud


def sheet_of(path: Path, positions: np.ndarray, name: str = "cube") -> np.ndarray:
    """The pixels of a sheet of one cloud, (h, w, 3)."""
    cloud = cloud_of(positions)
    plan = SimpleNamespace(classes=(name,), config=CONFIG)
    source: Any = SimpleNamespace(
        plan=plan, block=None, complete=None, order={"train": [0]}, batches=lambda split, n: iter([cloud])
    )
    assert write_contact_sheet(path, source)
    return np.asarray(Image.open(path))


def test_no_cloud_is_cut_off(tmp_path: Path) -> None:
    """The corners of a cube, the largest that a cloud with longest side 1 can be, stay within their panels."""
    image = sheet_of(tmp_path / "sheet.png", np.indices((2, 2, 2)).reshape(3, 8).T - 0.5)
    assert image.shape == (2 * (TITLE + PANEL), PANEL, 3)
    for row in range(2):
        top = TITLE + row * (TITLE + PANEL)
        panel = image[top : top + PANEL]
        marked = (panel < 250).any(axis=-1)
        n_blue = np.count_nonzero(marked)
        assert n_blue > 8 * 5, "eight marks, none of them on another's place"
        assert not marked[:3].any()
        assert not marked[-3:].any()
        assert not marked[:, [0, 1, 2, -3, -2, -1]].any()


def test_each_view_shows_what_is_near_in_front(tmp_path: Path) -> None:
    """A cloud with one more point far below it is drawn smaller, and that point at the bottom of both pictures."""
    ball = np.random.default_rng(0).normal(size=(500, 3))
    ball *= 0.1 / np.linalg.norm(ball, axis=1, keepdims=True)
    image = sheet_of(tmp_path / "sheet.png", np.concatenate([ball, [[0, 0, -0.9]]]))
    for row in range(2):
        top = TITLE + row * (TITLE + PANEL)
        marked = np.argwhere((image[top : top + PANEL] < 250).any(axis=-1))
        rows, counts = np.unique(marked[:, 0] // (PANEL // 2), return_counts=True)
        assert rows.tolist() == [0, 1]
        assert counts[0] > 10 * counts[1]


def test_names_in_any_script(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In letters where a font has them, else as Python escapes them; however long, within the picture."""

    def written(name: str) -> bytes:
        title = sheet_of(tmp_path / "sheet.png", np.eye(3), name)[:TITLE]
        assert (title[:, [0, 1, 2, -3, -2, -1]] == 255).all()
        return title.tobytes()

    assert len({written(name) for name in ("Стул $x$ é", "Стол $x$ é", "???? $x$ é")}) == 3
    written("a_class_whose_name_is_of_a_sentence")
    monkeypatch.setattr("zbuf_occlude.drawing.pictures.font_file_for", lambda text: None)
    assert written("椅子 <b>") == written(r"\u6905\u5b50 <b>")


def test_without_pillow_there_is_no_sheet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gallery, "find_spec", lambda name: None)
    assert not write_contact_sheet(tmp_path / "sheet.png", None)  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())


def test_classes_that_the_first_split_lacks_are_shown_too(tmp_path: Path) -> None:
    clouds = {"train": cloud_of(np.eye(3), 1), "val": np.empty(0), "test": cloud_of(np.eye(3), 0)}
    plan = SimpleNamespace(classes=("a", "b"), config=CONFIG)
    source: Any = SimpleNamespace(
        plan=plan,
        block=None,
        complete=None,
        order=clouds,
        batches=lambda split, n: iter([clouds[split]] if len(clouds[split]) else []),
    )
    assert write_contact_sheet(tmp_path / "sheet.png", source)
    assert Image.open(tmp_path / "sheet.png").size == (2 * PANEL, 2 * (TITLE + PANEL))


def panels_of(path: Path, column: int = 0) -> list[np.ndarray]:
    """The pictures of a column, from top to bottom, as integers."""
    image = np.asarray(Image.open(path)).astype(int)[:, column * PANEL : (column + 1) * PANEL]
    return [image[top + TITLE : top + TITLE + PANEL] for top in range(0, len(image), TITLE + PANEL)]


def n_marked(panel: np.ndarray, *, pale: bool = False) -> int:
    """The number of pixels with a mark's colour, or of the pale marks of a complete cloud."""
    grey = np.ptp(panel, axis=-1) == 0
    return int(np.count_nonzero(grey & (panel[..., 0] > 200) & (panel[..., 0] < 240) if pale else ~grey))


def check_pairs(path: Path, column: int = 0) -> None:
    """Partial, complete, the one over the other, and the partial one from its camera; none is cut off."""
    partial, complete, both, camera = panels_of(path, column)
    for panel in (partial, complete, both, camera):
        assert n_marked(panel) > 300
        assert (panel[[0, -1]] == 255).all()
        assert (panel[:, [0, -1]] == 255).all()
    assert [n_marked(panel, pale=True) > 300 for panel in (partial, complete, both, camera)] == [
        False,
        False,
        True,
        False,
    ]
    seen = np.ptp(partial, axis=-1) > 20
    assert (np.ptp(both, axis=-1) > 20)[seen].mean() > 0.98, "the partial one is where it is alone"
    assert ((both < 250).any(axis=-1) | ~(complete < 235).any(axis=-1)).mean() > 0.99, "over the complete one"


def test_pairs_of_packed_are_partial_complete_and_both(tmp_path: Path) -> None:
    config = DatasetConfig(method="exact", views="ring:3@25", n_points=4000, sample_size=1500)
    plan = Plan(MeshCollection([MeshEntry("ball", "ball", "train", lambda: sphere(24))]), config, "packed")
    generate(plan, tmp_path / "packed")
    check_pairs(tmp_path / "packed" / "contact_sheet.png")


@pytest.mark.parametrize(("frame", "axes"), [("object", "opengl"), ("camera", "opengl"), ("camera", "opencv")])
def test_pairs_of_a_layout_are_shown_when_it_is_made_and_when_it_is_read_back(
    frame: str, axes: str, tmp_path: Path
) -> None:
    config = DatasetConfig(
        method="exact", views="ring:6@25", n_points=4000, sample_size=2048, scale="object", frame=frame, axes=axes
    )
    plan = Plan(MeshCollection([MeshEntry("ball", "ball", "train", lambda: sphere(24))]), config, "epn3d")
    generate(plan, tmp_path / "out")
    check_pairs(tmp_path / "out" / "contact_sheet.png")
    assert write_contact_sheet(tmp_path / "again.png", open_dataset(tmp_path / "out", to_show=True))
    check_pairs(tmp_path / "again.png")
