"""Sheets nearer than a method's tolerance are counted: known spacings, random triangles against the oracle's rays."""

from typing import Any

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.scenes import soup
from zbuf_occlude.cli.messages import stacked
from zbuf_occlude.dataset.counts import QualityCounts, WorstMesh
from zbuf_occlude.dataset.pipeline import samplings
from zbuf_occlude.dataset.plan import DatasetConfig, Plan
from zbuf_occlude.dataset.stacked import count_coincident_surfaces
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry
from zbuf_occlude.visibility.interface import CONTACT

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
FACES = np.array([[0, 1, 2], [0, 2, 3]])
TOLERANCE = 1e-4  # fraction of the diagonal, as of depth_buffer


def two_sheets(gap: float) -> zo.Mesh:
    """A unit square, and a half of one, `gap` diagonals above it and turned over: 2/3 of the surface is of both."""
    half = (SQUARE * [0.5, 1.0, 1.0] + [0.0, 0.0, gap * np.sqrt(2)])[::-1]
    return zo.Mesh(np.concatenate([SQUARE, half]), np.concatenate([FACES, FACES + 4]), name="two sheets")


@pytest.mark.parametrize(
    ("gap", "share"), [(0.5e-5, 0.0), (1.2e-5, 2 / 3), (5e-5, 2 / 3), (0.98e-4, 2 / 3), (1.02e-4, 0.0), (1e-2, 0.0)]
)
@pytest.mark.parametrize("axes", [(0, 1, 2), (1, 2, 0), (2, 0, 1)])
def test_two_sheets_of_known_spacing(gap: float, share: float, axes: tuple[int, int, int]) -> None:
    """Nearer than the contact tolerance they touch, and hide nothing."""
    mesh = two_sheets(gap)
    mesh = zo.Mesh(mesh.vertices[:, axes], mesh.faces)
    counts = count_coincident_surfaces(
        mesh, zo.sample_surface(mesh, n_points=5000, seed=0), TOLERANCE * mesh.diagonal, "two"
    )
    assert counts.most_stacked == WorstMesh(counts.n_stacked / counts.n_looked_at, "two")
    assert counts.n_stacked / counts.n_looked_at == pytest.approx(share, abs=0.04 if share else 0.0)


@pytest.mark.parametrize("seed", range(3))
def test_what_is_stacked_is_what_the_oracle_meets_along_the_normals(seed: int) -> None:
    mesh = soup(60, seed=seed)
    points = zo.sample_surface(mesh, n_points=500, seed=seed)
    contact, tolerance = CONTACT * mesh.diagonal, 0.2 * mesh.diagonal
    with zo.prepare(mesh, "oracle") as oracle:
        met = [
            oracle.first_hits(points.positions + side * contact * points.normals, side * points.normals).distances
            for side in (1, -1)
        ]
    expected = int((np.minimum(*met) <= tolerance - contact).sum())
    assert 20 < expected < 480
    assert count_coincident_surfaces(mesh, points, tolerance, "soup").n_stacked == expected


def test_a_method_that_has_a_tolerance_is_said_to(gl: Any) -> None:
    mesh = two_sheets(5e-5)
    for method, options in (("depth_buffer", {}), ("depth_buffer", {"tolerance": 4e-5}), ("exact", {})):
        recipe = DatasetConfig(method=method, method_options=options, views="ring:2@40", n_points=2000, sample_size=16)
        meshes = MeshCollection([MeshEntry("two", "two", "train", lambda: mesh)])
        (sampling,) = samplings(Plan(meshes, recipe), mesh, 0, gl)
        found = sampling.counts.stacked
        if method == "exact":
            assert found is None
        else:
            assert found is not None
            assert found["share"] == pytest.approx(0.0 if options else 2 / 3, abs=0.05)


def test_the_summary_names_the_mesh() -> None:
    counts = QualityCounts(n_looked_at=1000, n_stacked=10, most_stacked=WorstMesh(0.01, "cup"))
    document: dict[str, Any] = {"options": {"method": "depth_buffer"}}
    assert stacked(document | {"stacked": counts.stacked}) == stacked(document) == []
    counts = (
        counts + QualityCounts(n_looked_at=1000, n_stacked=500, most_stacked=WorstMesh(0.5, "plate")) + QualityCounts()
    )
    assert QualityCounts.from_dict(counts.to_dict()) == counts
    (line,) = stacked(document | {"stacked": counts.stacked})
    assert line.startswith("warning: 50% of the surface of plate, and 25.5% of all, has another sheet nearer than the ")
    assert line.endswith("--method exact tells them apart.")
