"""The contact sheet shows whole clouds."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from zbuf_occlude import views
from zbuf_occlude.camera import view_matrices
from zbuf_occlude.dataset.sheet import write_contact_sheet


def test_no_cloud_is_cut_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The corners of a cube, the largest that a cloud with longest side 1 can be, stay within the axes."""
    corners = np.indices((2, 2, 2)).reshape(3, 8).T - 0.5
    view = views.ring(1, 0.6)
    fields = {"data": (8, 3), "label": 1, "view": 3, "pose": (4, 4), "centre": 3, "factor": ()}
    cloud = np.zeros(1, [(name, "i8" if name == "label" else "f4", shape) for name, shape in fields.items()])
    cloud["data"], cloud["factor"], cloud["pose"] = corners, 1.0, view_matrices(view.eyes, np.zeros(3))
    plan = SimpleNamespace(classes=("cube",), recipe=SimpleNamespace(frame="object"))
    source: Any = SimpleNamespace(plan=plan, order={"train": [0]}, batches=lambda split, n: iter([cloud]))
    drawn: list[Figure] = []
    save = Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda self, *a, **k: (drawn.append(self), save(self, *a, **k))[1])
    write_contact_sheet(tmp_path / "sheet.png", source)
    for axes in drawn[0].axes:
        marks = np.asarray(axes.collections[0].get_offsets())
        assert len(marks) == 8
        low, high = np.transpose([axes.get_xlim(), axes.get_ylim()])
        assert (marks > low).all()
        assert (marks < high).all()
