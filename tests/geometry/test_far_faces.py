"""Faces far from all else: found, named by their numbers in the file, and what they do to the contact tolerance."""

import json
import re
import warnings
from pathlib import Path

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.cli.conftest import Run, run, write_off  # noqa: F401
from tests.scenes import box
from zbuf_occlude.geometry.far_faces import far_faces
from zbuf_occlude.meshes import shapes

CHAIR = shapes.make("chair", 3).normalized()


def with_stray(mesh: zo.Mesh, away: float, side: float = 0.05) -> zo.Mesh:
    """The mesh, and as its last face a triangle `away` along x."""
    corners = np.array([[away, 0.0, 0.0], [away, side, 0.0], [away, 0.0, side]])
    n = len(mesh.vertices)
    return zo.Mesh(
        np.concatenate([mesh.vertices, corners]), np.concatenate([mesh.faces, [[n, n + 1, n + 2]]]), "strayed"
    )


def test_a_far_triangle_is_found_and_named() -> None:
    mesh = with_stray(box(), 1000.0)
    far = far_faces(mesh)
    assert far is not None
    assert far.face_ids.tolist() == [12]
    assert far.size == pytest.approx(np.sqrt(3.0))
    assert far.distance == pytest.approx(1000.0, abs=0.6)
    assert "strayed" in far.summary(mesh)
    assert "face 12 " in far.summary(mesh)
    cut = zo.Mesh(mesh.vertices, mesh.faces, "cut", source_face_ids=np.arange(13, dtype=np.int32) + 100)
    assert "face 112 " in far_faces(cut).summary(cut)  # type: ignore[union-attr]


@pytest.mark.parametrize(("away", "side", "found"), [(172.0, 0.05, False), (175.0, 0.05, True), (1000.0, 0.4, False)])
def test_only_where_nearly_all_lies_within_a_hundredth_of_the_diagonal(away: float, side: float, found: bool) -> None:
    """A cube's diagonal is 1.73; a triangle of side 0.4 has more than a hundredth of the area."""
    assert (far_faces(with_stray(box(), away, side)) is not None) == found


def test_ordinary_meshes_have_none() -> None:
    made = [entry.load() for entry in shapes.collection(n_members=2)]
    made += [zo.Mesh([[0, 0, 0]] * 3, [[0, 1, 2]]), box((1.0, 1e-6, 1e-6)), box((1.0, 1.0, 0.0))]
    assert [mesh.name for mesh in made if far_faces(mesh) is not None] == []


def test_a_large_mesh_is_looked_at_in_part_and_then_closely() -> None:
    mesh = shapes.benchmark_mesh(120_000).normalized()
    assert far_faces(mesh) is None
    far = far_faces(with_stray(mesh, -3000.0))
    assert far is not None
    assert far.face_ids.tolist() == [len(mesh.faces)]


@pytest.mark.parametrize("away", [1000.0, 10_000.0])
def test_the_contact_that_the_warning_offers_gives_the_answers_without_it(away: float) -> None:
    """What is far away hides nothing from near eyes: the mesh alone is the truth."""
    points, eyes = zo.sample_surface(CHAIR, n_points=1500, seed=0), zo.views.for_mesh(CHAIR, "fibonacci:8").eyes
    with zo.prepare(CHAIR, "oracle") as alone:
        truth = alone.visible(points, eyes)
    mesh = with_stray(CHAIR, away)
    with zo.prepare(mesh, "exact") as occluder, pytest.warns(UserWarning, match="strayed.*face 1062 ") as said:
        assert (occluder.visible(points, eyes) != truth).mean() > 0.01
    offered = re.search(r"give contact=([-\de.]+) to", str(said[0].message))
    assert offered is not None
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for method in ("exact", "oracle"):
            with zo.prepare(mesh, method, contact=float(offered[1])) as occluder:
                assert (occluder.visible(points, eyes) != truth).mean() < 1e-4
        with zo.prepare(CHAIR, "exact") as occluder:
            occluder.visible(points, eyes)


def test_commands_warn_of_it(run: Run, tmp_path: Path) -> None:  # noqa: F811
    mesh = with_stray(CHAIR, 1000.0)
    write_off(tmp_path / "strayed.off", mesh.vertices, mesh.faces)
    line = "generate strayed.off --views ring:2@20 --points 500 --sample-size 16 --method exact --workers 1"
    outcome = run(f"{line} --out out", says="face 1062 ")
    assert "1 mesh has faces so far from most of the area that the contact tolerance is too large" in outcome.out
    assert json.loads((tmp_path / "out" / "manifest.json").read_text())["counts"]["meshes_with_far_faces"] == 1
    given = run(f"{line} --set contact=1e-8 --out given")
    assert "far" not in given.out + given.err
    for out in ("seen.ply", "seen.obj"):
        run(f"visible strayed.off --azimuth 10 --elevation 20 --out {out}", says="face 1062 ")
