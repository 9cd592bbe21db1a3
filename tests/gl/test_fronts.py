"""Faces seen from before: those that NumPy finds, and the same picture as with all faces drawn."""

import numpy as np
import pytest

from zbuf_occlude import Mesh, views
from zbuf_occlude.gl import fronts
from zbuf_occlude.gl.buffers import Buffers
from zbuf_occlude.gl.context import GlContext
from zbuf_occlude.gl.depth_pass import MOST_TILES, DepthPass, mesh_buffers, vertices_of
from zbuf_occlude.gl.exact_data import Unit
from zbuf_occlude.gl.fronts import ClosedFaces, Fronts, find_fronts
from zbuf_occlude.gl.mesh_data import arrange_mesh
from zbuf_occlude.gl.tiles import TILE, arrange_tiles, single_pictures
from zbuf_occlude.meshes import shapes
from zbuf_occlude.solids import find_solids

BALL = shapes.solids.icosphere(3)
SHEET = Mesh([[2.0, -1.0, 0.0], [2.0, 1.0, 0.0], [2.0, 0.0, 2.0]], [[0, 1, 2]])
RESOLUTION = 128


def test_fronts_are_the_faces_that_look_to_the_eye() -> None:
    eyes = views.fibonacci(9, distance=3.0).eyes
    corners, indices = BALL.corners, np.arange(3 * len(BALL.faces), dtype=np.int32).reshape(-1, 3)
    normals = BALL.face_normals / np.linalg.norm(BALL.face_normals, axis=1, keepdims=True)
    heights = ((eyes[:, None] - corners[:, 0]) * normals).sum(axis=2)
    assert (np.abs(heights) > 2e-6).all()
    planes = np.concatenate([normals, (normals * corners[:, 0]).sum(axis=1, keepdims=True)], axis=1)
    found = np.empty((len(eyes), *indices.shape), dtype=np.int32)
    counts = find_fronts(planes, indices, eyes, found)
    for k in range(len(eyes)):
        np.testing.assert_array_equal(found[k, : counts[k]], indices[heights[k] > 0.0])
    assert counts.max() < 0.5 * len(indices)


@pytest.mark.parametrize("most_bytes", [fronts.MOST_BYTES, 1])
def test_the_picture_is_the_same(gl: GlContext, monkeypatch: pytest.MonkeyPatch, most_bytes: int) -> None:
    monkeypatch.setattr(fronts, "MOST_BYTES", most_bytes)  # all eyes at once, or one by one
    mesh = Mesh(
        np.concatenate([BALL.vertices, SHEET.vertices]), np.concatenate([BALL.faces, SHEET.faces + len(BALL.vertices)])
    )
    unit = Unit.of(mesh.centre, mesh.diagonal)
    arrays = arrange_mesh(mesh, unit, find_solids(mesh)[0])
    closed = ClosedFaces(
        arrays.positions[arrays.faces[: arrays.n_closed]], vertices_of(arrays.faces)[: arrays.n_closed]
    )
    assert arrays.n_closed == len(BALL.faces)
    eyes = unit.to(views.fibonacci(5, distance=8.0).eyes)
    _, pictures = single_pictures(eyes, arrays.positions, RESOLUTION)
    drawn = []
    with mesh_buffers(gl, arrays.positions, arrays.faces) as mesh_on_gpu:
        depth_pass = DepthPass(gl, mesh_on_gpu, RESOLUTION, ids=True, tiles_an_eye=1, closed=closed)
        try:
            tiles = np.zeros(MOST_TILES, dtype=TILE)
            tiles[:5] = arrange_tiles(pictures, RESOLUTION, depth_pass.atlas.columns, depth_pass.n_eyes)
            if depth_pass._fronts is None:  # a GPU
                depth_pass._fronts = Fronts(gl, mesh_on_gpu, depth_pass._program, closed, depth_pass.n_eyes)
            with Buffers(gl.ctx, tiles=tiles) as buffers:
                buffers.bind_uniforms("tiles", 0, offset=0, size=tiles.nbytes)
                depth_pass.draw(eyes)
                drawn.append([depth_pass.atlas.read(tile) for tile in range(5)])
                used, depth_pass._fronts = depth_pass._fronts, None
                depth_pass.draw(eyes)
                drawn.append([depth_pass.atlas.read(tile) for tile in range(5)])
                depth_pass._fronts = used
        finally:
            depth_pass.release()
    seen = np.unique([faces for _, faces in drawn[0]])
    assert seen[0] == -1
    assert seen[-1] == len(BALL.faces)
    for with_fronts, with_all in zip(*drawn, strict=True):
        np.testing.assert_array_equal(with_fronts[0], with_all[0])
        np.testing.assert_array_equal(with_fronts[1], with_all[1])
