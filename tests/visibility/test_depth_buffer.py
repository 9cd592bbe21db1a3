"""`depth_buffer`: against NumPy twins and the oracle; limits, errors."""

from typing import Any, NamedTuple

import numpy as np
import pytest

from tests.visibility.witness_twin import witness_test
from zbuf_occlude import Mesh, SurfacePoints, prepare, sample_surface, views
from zbuf_occlude.base.errors import GlError
from zbuf_occlude.engines.gl.buffers import Buffers
from zbuf_occlude.engines.gl.context import GlContext
from zbuf_occlude.engines.gl.depth_pass import Atlas
from zbuf_occlude.engines.gl.tiles import single_pictures
from zbuf_occlude.geometry.camera import Frusta
from zbuf_occlude.meshes import shapes
from zbuf_occlude.visibility.methods import depth_buffer
from zbuf_occlude.visibility.methods.pyrender import depth_test, window_coordinates

CHAIR = shapes.make("chair", 3).normalized()
EYES = views.fibonacci(5).eyes


def points_on(mesh: Mesh, n_points: int = 4000) -> SurfacePoints:
    return sample_surface(mesh, n_points=n_points, seed=1)


class Drawn(NamedTuple):
    """What was drawn for one eye, read back, as the NumPy twin wants it; unit space."""

    depths: np.ndarray
    seen: np.ndarray
    view: np.ndarray
    frustum: Frusta
    points: SurfacePoints
    corners: np.ndarray
    diagonal: float

    def undecided(self, resolution: int) -> np.ndarray:
        """Points so near a pixel's border, or the middle of one, that float32 may put them on its other side."""
        x, y, _ = window_coordinates(self.view, self.frustum, self.points.positions, (resolution, resolution))
        return np.asarray(np.min([np.abs(2 * v - np.round(2 * v)) for v in (x, y)], axis=0) < 2e-3)


def draw(
    occluder: Any, mesh: Mesh, points: SurfacePoints, eye: np.ndarray, resolution: int
) -> tuple[Drawn, np.ndarray]:
    answer = occluder.visible(points, eye[None])[0]
    depths, drawn = occluder._pass(1).atlas.read(0)
    faces = np.append(np.argsort(occluder._arrays.ranks), -1)  # of the mesh, in drawing order
    unit = occluder._unit
    fits, pictures = single_pictures(unit.to(eye[None]), unit.to(mesh.vertices[np.unique(mesh.faces)]), resolution)
    assert fits.all()
    near, far = pictures.frusta.near[0], pictures.frusta.far[0]
    with np.errstate(divide="ignore"):  # reversed depth to eye depth
        image = np.where(depths > 0, pictures.gains[0] / (depths.astype(float) + near / (far - near)), np.inf)
    local = SurfacePoints(unit.to(points.positions), points.face_ids, points.normals)
    frustum = Frusta(*(bound[0] for bound in pictures.frusta))
    corners, diagonal = unit.to(mesh.corners.reshape(-1, 3)).reshape(-1, 3, 3), mesh.diagonal * unit.scale
    return Drawn(image, faces[drawn], pictures.views[0], frustum, local, corners, diagonal), answer


@pytest.mark.parametrize("resolution", [64, 256])
def test_the_plain_test_is_that_of_the_numpy_twin(gl: GlContext, resolution: int) -> None:
    points, tolerance, slope_bias = points_on(CHAIR), 1e-3, 0.7
    options = {"resolution": resolution, "tolerance": tolerance, "slope_bias": slope_bias, "refine": "none"}
    for eye in EYES:
        with prepare(CHAIR, "depth_buffer", gl=gl, **options) as occluder:
            drawn, answer = draw(occluder, CHAIR, points, eye, resolution)
        twin = [
            depth_test(
                drawn.depths,
                drawn.view,
                drawn.frustum,
                drawn.points,
                tolerance=f * tolerance * drawn.diagonal,
                slope_bias=f * slope_bias,
            )
            for f in (0.9, 1.0, 1.1)
        ]
        # the GPU compares inverse depths, in which an allowance is worth what it is at the point's own depth: equal to
        # first order: steep planes have allowances of some % of the distance
        decided = (twin[0] == twin[2]) & ~drawn.undecided(resolution)
        assert decided.mean() > 0.93
        assert (answer == twin[1])[decided].all()


@pytest.mark.parametrize("free", [False, True])
@pytest.mark.parametrize("mesh", [CHAIR, shapes.make("lamp", 2).normalized()], ids=["chair", "lamp"])
@pytest.mark.parametrize("resolution", [64, 256])
def test_votes_and_witnesses_are_those_of_the_numpy_twin(
    gl: GlContext, resolution: int, mesh: Mesh, free: bool
) -> None:
    tolerance, points = 1e-3, points_on(mesh)
    points = SurfacePoints.free(points.positions) if free else points
    with prepare(mesh, "depth_buffer", gl=gl, resolution=resolution, tolerance=tolerance) as occluder:
        for eye in EYES:
            drawn, answer = draw(occluder, mesh, points, eye, resolution)
            image = drawn.depths, drawn.seen, drawn.view, drawn.frustum, drawn.points, drawn.corners
            twin = [
                witness_test(*image, tolerance=f * tolerance * drawn.diagonal, contact=f * 1e-5 * drawn.diagonal)
                for f in (0.98, 1.0, 1.02)
            ]
            decided = (twin[0] == twin[2]) & ~drawn.undecided(resolution)
            assert decided.mean() > 0.95
            assert (answer == twin[1])[decided].mean() > 0.9995


def wrong(gl: GlContext, **options: Any) -> float:
    """The share of answers about CHAIR that differ from the oracle's."""
    points = points_on(CHAIR)
    with prepare(CHAIR, "oracle") as oracle, prepare(CHAIR, "depth_buffer", gl=gl, **options) as occluder:
        return float((occluder.visible(points, EYES) != oracle.visible(points, EYES)).mean())


def test_it_agrees_with_the_oracle_and_the_refinement_pays(gl: GlContext) -> None:
    assert wrong(gl) < min(0.01, wrong(gl, refine="none") / 2)


def test_more_pixels_err_less(gl: GlContext) -> None:
    assert wrong(gl, resolution=64) > wrong(gl, resolution=256) > wrong(gl, resolution=1024)


@pytest.mark.parametrize("refine", ["none", "witness"])
def test_eyes_in_batches_that_do_not_fill_the_atlas(gl: GlContext, refine: str) -> None:
    points = points_on(CHAIR)
    for resolution, n_eyes in ((64, 50), (64, 100), (256, 48), (512, 20), (512, 64)):  # of llvmpipe, of a GPU
        eyes = views.fibonacci(n_eyes).eyes
        with prepare(CHAIR, "depth_buffer", gl=gl, resolution=resolution, refine=refine) as occluder:
            together, alone = occluder.visible(points, eyes), [occluder.visible(points, eye) for eye in eyes]
        # pixels lie elsewhere in the atlas, which float32 may round to the next one
        assert (together != alone).mean(axis=1).max() < 0.005


def test_rays_from_origins_in_batches_that_do_not_fill_the_atlas(gl: GlContext) -> None:
    for resolution, n in ((64, 60), (512, 20), (512, 64)):
        origins = views.fibonacci(n).eyes
        points = points_on(CHAIR, 40).positions
        with prepare(CHAIR, "depth_buffer", gl=gl, resolution=resolution) as occluder:
            alone = [occluder.first_hits(origin[None], points - origin).face_ids for origin in origins]
            rays = np.repeat(origins, 40, axis=0), (points - origins[:, None]).reshape(-1, 3)
            together = occluder.first_hits(*rays).face_ids.reshape(n, 40)
        assert (together != alone).mean(axis=1).max() < 0.2


def test_an_eye_within_the_mesh_looks_all_round(gl: GlContext) -> None:
    ball = shapes.solids.icosphere(3)
    points = points_on(ball, 2000)
    inside = np.array([[0.1, -0.2, 0.05]]) * ball.diagonal
    with prepare(ball, "depth_buffer", gl=gl) as occluder:
        assert occluder.visible(points, inside).mean() > 0.999, "from within a ball all of it is seen"
        assert occluder.visible(points, inside * 1000).mean() < 0.55


@pytest.mark.parametrize("refine", ["none", "witness"])
def test_free_points_about_the_mesh_and_behind_the_eye(gl: GlContext, refine: str) -> None:
    ball = shapes.solids.icosphere(3)
    off = np.random.default_rng(2).normal(size=(3000, 3))
    off = off[np.abs(np.linalg.norm(off, axis=1) - 1.0) > 0.05]
    behind = np.array([[0.0, -8.5, 0.0], [3.0, 3.0, 0.0], [0.0, -9.0, 3.0], [0.0, 40.0, 0.0], [9.0, 30.0, 0.0]])
    points, eyes = SurfacePoints.free(np.concatenate([off, behind])), np.array([[0.0, -8.0, 0.0], [5.0, 4.0, 3.0]])
    with prepare(ball, "oracle") as oracle, prepare(ball, "depth_buffer", gl=gl, refine=refine) as occluder:
        truth, answer = oracle.visible(points, eyes), occluder.visible(points, eyes)
    assert (answer[0, -5:] == [True, True, True, False, True]).all()
    assert (answer[0, -5:] == truth[0, -5:]).all()
    assert (answer == truth).mean() > 0.995


@pytest.mark.parametrize("refine", ["none", "witness"])
def test_a_surface_that_crosses_itself_is_answered_like_any_other(gl: GlContext, refine: str) -> None:
    ball = shapes.solids.icosphere(3)
    # mirrored below z = 0.3, where the map's determinant is negative
    vertices = ball.vertices * np.where([True, False, False], ball.vertices[:, 2:] - 0.3, 1.0)
    crossed = Mesh(vertices, ball.faces)
    points, eyes = sample_surface(crossed, n_points=3000, seed=4), views.fibonacci(9, distance=6.0).eyes
    with prepare(crossed, "oracle") as oracle, prepare(crossed, "depth_buffer", gl=gl, refine=refine) as occluder:
        agreement = (oracle.visible(points, eyes) == occluder.visible(points, eyes)).mean()
    assert agreement > (0.99 if refine == "witness" else 0.95)


def test_what_was_made_is_given_back_when_the_rest_cannot_be(gl: GlContext, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise GlError("no memory left")

    released = []
    monkeypatch.setattr(Buffers, "vertex_array", refuse)
    monkeypatch.setattr(Atlas, "release", lambda atlas: released.append(atlas))
    with prepare(CHAIR, "depth_buffer", gl=gl, resolution=16) as occluder:
        with pytest.raises(GlError, match="no memory left"):
            occluder.visible(points_on(CHAIR, 100), EYES)
        assert len(released) == 1
    monkeypatch.undo()
    released[0].release()


def test_the_same_points_are_put_on_the_gpu_once(gl: GlContext, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[int] = []
    upload = depth_buffer.UploadedPoints
    monkeypatch.setattr(depth_buffer, "UploadedPoints", lambda *a: (made.append(1), upload(*a))[1])
    points, others = points_on(CHAIR, 300), points_on(CHAIR, 400)
    with prepare(CHAIR, "depth_buffer", gl=gl) as occluder:
        first = occluder.visible(points, EYES)
        assert (occluder.visible(points, EYES[:3]) == first[:3]).all()
        assert len(made) == 1
        occluder.visible(others, EYES)
        assert (occluder.visible(points, EYES) == first).all()
        assert len(made) == 3


@pytest.mark.parametrize("resolution", [64, 2048])
def test_answers_that_do_not_fit_go_in_parts(gl: GlContext, resolution: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """With one eye per batch a thousand eyes' answers took a GiB, eight times what a buffer may have."""
    points, eyes = points_on(CHAIR, 700), views.fibonacci(21).eyes
    masks = []
    for limit in (1 << 27, 2048):
        monkeypatch.setattr(depth_buffer, "answer_limit", lambda gl, limit=limit: limit)
        with prepare(CHAIR, "depth_buffer", gl=gl, resolution=resolution) as occluder:
            masks.append(occluder.visible(points, eyes))
    assert (masks[0] == masks[1]).all()
    assert 0.05 < masks[0].mean() < 0.6


@pytest.mark.parametrize("place", [[0.3, -1.3, 0.4], [0.02, 0.01, 0.1]], ids=["outside", "within"])
def test_first_hits_of_one_sensor(gl: GlContext, place: list[float]) -> None:
    """All round, as a spinning sensor looks: 4,000 rays through one picture, or six."""
    turns, rises = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False), np.linspace(-0.9, 0.9, 20))
    directions = np.stack([np.cos(turns) * np.cos(rises), np.sin(turns) * np.cos(rises), np.sin(rises)], axis=-1)
    rays = [place], directions.reshape(-1, 3)
    with prepare(CHAIR, "oracle") as oracle, prepare(CHAIR, "depth_buffer", gl=gl, refine="none") as occluder:
        truth, found = oracle.first_hits(*rays), occluder.first_hits(*rays)
    hit = truth.face_ids >= 0
    assert 0.005 < hit.mean() < 1.0
    assert (found.face_ids == truth.face_ids).mean() > 0.995
    same = hit & (found.face_ids == truth.face_ids)
    assert np.allclose(found.distances[same], truth.distances[same], rtol=1e-12)
    assert np.isinf(found.distances[found.face_ids < 0]).all()
