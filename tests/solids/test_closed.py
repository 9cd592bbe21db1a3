"""Closed surfaces: which faces belong to one, and where outside is, against solids of which both are known."""

import numpy as np
import pytest
import trimesh

from tests.scenes import together
from zbuf_occlude import Mesh
from zbuf_occlude.meshes import shapes
from zbuf_occlude.solids.closed import closed_surfaces

BALL = shapes.solids.icosphere(2)
BOX = Mesh.from_trimesh(trimesh.creation.box((1.0, 2.0, 3.0)))


def turned(mesh: Mesh, seed: int = 0) -> tuple[Mesh, np.ndarray]:
    """Wind some faces, (f,) bool, the other way round."""
    some = np.random.default_rng(seed).random(len(mesh.faces)) < 0.5
    faces = mesh.faces.copy()
    faces[some] = faces[some][:, ::-1]
    return Mesh(mesh.vertices, faces), some


def soup(mesh: Mesh) -> Mesh:
    """Give each face vertices of its own."""
    return Mesh(mesh.corners.reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3))


@pytest.mark.parametrize("mesh", [BALL, BOX], ids=["ball", "box"])
def test_normals_times_outward_point_away_from_the_centre(mesh: Mesh) -> None:
    for case in (mesh, soup(mesh), soup(turned(mesh)[0]), turned(mesh)[0]):
        found = closed_surfaces(case)
        away = (case.face_normals * (case.corners.mean(axis=1) - mesh.centre)).sum(axis=1) > 0.0
        assert (found.outward == np.where(away, 1, -1)).all()
        assert (found.surfaces == 0).all()


def test_a_hole_opens_its_own_surface_only() -> None:
    holed = Mesh(BOX.vertices, BOX.faces[1:])
    found = closed_surfaces(together(holed, BALL.transformed(0.3)))
    n = len(holed.faces)
    assert (found.outward[:n] == 0).all()
    assert (found.outward[n:] == 1).all()
    assert set(found.surfaces[:n]) == {0}
    assert set(found.surfaces[n:]) == {1}


def test_without_opens_a_surface() -> None:
    found = closed_surfaces(together(BOX, BALL)).without(np.array([True, False]))
    assert (found.outward == np.repeat([0, 1], [len(BOX.faces), len(BALL.faces)])).all()


def test_an_edge_of_four_faces_is_no_edge_of_a_closed_surface() -> None:
    touching = together(BOX, BOX.transformed(1.0, [1.0, 2.0, 0.0]))
    # both boxes lose the edge that they share, so neither is closed
    assert (closed_surfaces(touching).outward == 0).all()


def test_a_surface_of_one_side_has_no_outside() -> None:
    # the projective plane of six vertices: every edge has two faces, and there is no outside
    faces = [
        [1, 2, 4],
        [2, 3, 5],
        [3, 4, 1],
        [4, 5, 2],
        [5, 1, 3],
        [0, 1, 2],
        [0, 2, 3],
        [0, 3, 4],
        [0, 4, 5],
        [0, 5, 1],
    ]
    mesh = Mesh(np.random.default_rng(3).normal(size=(6, 3)), np.array(faces))
    assert (closed_surfaces(mesh).outward == 0).all()


def test_a_sheet_that_is_folded_shut_encloses_nothing() -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    sheet = Mesh(corners, np.array([[0, 1, 2], [0, 2, 3], [1, 0, 3], [1, 3, 2]]))
    assert (closed_surfaces(sheet).outward == 0).all()


@pytest.mark.parametrize(("thickness", "closed"), [(1e-3, True), (1e-5, False), (1e-6, False)])
def test_a_plate_thinner_than_ten_contact_tolerances_counts_as_open(thickness: float, closed: bool) -> None:
    plate = Mesh.from_trimesh(trimesh.creation.box((1.0, 1.0, thickness * np.sqrt(2.0))))
    assert (closed_surfaces(plate).outward == int(closed)).all()


def test_minus_zero_is_zero() -> None:
    shifted = BOX.vertices - BOX.vertices[0]
    corners = shifted[BOX.faces].reshape(-1, 3)
    corners[::2] *= np.where(corners[::2] == 0.0, -1.0, 1.0)
    mesh = Mesh(corners, np.arange(len(corners)).reshape(-1, 3))
    assert (closed_surfaces(mesh).outward == 1).all()


@pytest.mark.parametrize("family", ["airplane", "bottle", "lamp", "table"])
def test_the_built_in_shapes_closed_parts_are_those_that_trimesh_finds(family: str) -> None:
    mesh = shapes.make(family, 5)
    found = closed_surfaces(mesh)
    whole = trimesh.Trimesh(*_merged(mesh), process=False)
    for part in trimesh.graph.connected_components(whole.face_adjacency, nodes=np.arange(len(mesh.faces)), min_len=1):
        piece = whole.submesh([part], append=True, repair=False)
        closed = piece.is_watertight and abs(piece.volume) > 1e-6 * piece.scale**3
        assert (np.abs(found.outward[part]) == closed).all()
        if closed and piece.is_winding_consistent:
            assert (found.outward[part] == np.sign(piece.volume)).all()


def _merged(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    positions, ids = np.unique(mesh.vertices + 0.0, axis=0, return_inverse=True)
    return positions, ids.reshape(-1)[mesh.faces]
