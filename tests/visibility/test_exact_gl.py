"""`exact_gl` equals the oracle on every pair of eye and point, whatever the mesh and wherever the eye."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import zbuf_occlude as zo
from tests.random_scenes import KINDS, triangles, wrong_answers
from tests.scenes import needles, row_in_a_plane, soup, sphere, together
from zbuf_occlude.engines.gl import exact_pass
from zbuf_occlude.engines.gl.context import GlContext
from zbuf_occlude.engines.gl.exact_pass import HARDWARE, SOFTWARE, WorkGroup, best_work_group
from zbuf_occlude.visibility.methods import exact_gl, oracle


def eyes_of(mesh: zo.Mesh, points: zo.SurfacePoints) -> np.ndarray:
    """Far, at the paper's distance, inside the bounding sphere, in the plane of faces, and a hair off the surface."""
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(8, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    distances = np.array([2.0, 2.5, 30.0, 1e4, 1e9, 0.1, 0.3, 0.0])
    around = mesh.centre + mesh.diagonal * distances[:, None] * directions
    axis = mesh.centre + mesh.diagonal * np.array([[0.0, 0.0, 2.0], [2.0, 0.0, 0.0]])
    near = points.positions[:3] + mesh.diagonal * np.array([[1e-2], [1e-4], [1e-6]]) * directions[:3]
    return np.concatenate([around, axis, near])


def differing(mesh: zo.Mesh, points: zo.SurfacePoints, eyes: np.ndarray, gl: GlContext, **options: float) -> int:
    """Count the pairs that differ from the oracle's."""
    with oracle.prepare(mesh, **options) as reference, exact_gl.prepare(mesh, gl=gl, **options) as occluder:
        return int((reference.visible(points, eyes) != occluder.visible(points, eyes)).sum())


@pytest.mark.parametrize("index", range(2 * len(KINDS)))
def test_random_scenes(index: int, gl: GlContext) -> None:
    assert wrong_answers(lambda mesh, contact: exact_gl.prepare(mesh, gl=gl, contact=contact), 3, index)[0] == 0


@pytest.mark.parametrize("kind", ["needles", "82,368 faces"])
def test_equals_the_oracle(kind: str, gl: GlContext) -> None:
    mesh = needles(400, 2) if kind == "needles" else sphere(144)
    points = zo.sample_surface(mesh, n_points=250, seed=1)
    assert differing(mesh, points, eyes_of(mesh, points), gl) == 0


def test_slivers_seen_from_beside_them(gl: GlContext) -> None:
    """Slivers 1e-12 to 1e-3 wide, and eyes above them, on the lines of their edges and almost in their planes."""
    rng = np.random.default_rng(0)
    base, along, aside = rng.normal(size=(3, 60, 3))
    third = base + rng.uniform(-0.2, 1.2, (60, 1)) * along + 10.0 ** rng.uniform(-12, -3, (60, 1)) * aside
    corners = np.stack([base, base + along, third], axis=1)
    normals = np.cross(along, third - base)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    above = corners.mean(axis=1) + 10.0 ** rng.uniform(-12, -3, (60, 1)) * normals
    in_plane = 2.0 * corners[:, 1] - third + 1e-8 * rng.normal(size=(60, 3))
    onto = np.einsum("fkc,fci->fki", rng.dirichlet([1, 1, 1], (60, 20)), corners).reshape(-1, 3)
    near = onto + 10.0 ** rng.uniform(-12, -1, (len(onto), 1)) * rng.normal(size=onto.shape)
    points, eyes = (
        zo.SurfacePoints.free(np.concatenate([onto, near])),
        np.concatenate([above, base + 3 * along, in_plane]),
    )
    assert differing(triangles(corners), points, eyes, gl, contact=0.0) == 0


def test_free_points_anywhere(gl: GlContext) -> None:
    """As far out as they may be, where float32 has no planes worth the name, and eyes too."""
    mesh = soup(200, 0.2)
    rng = np.random.default_rng(5)
    near, far = rng.normal(size=(300, 3)), rng.normal(size=(300, 3)) * 10.0 ** rng.uniform(1, 14, (300, 1))
    points = zo.SurfacePoints.free(np.concatenate([near, far, mesh.vertices[:200]]))
    assert differing(mesh, points, np.concatenate([eyes_of(mesh, points), [[1e14, 0.0, 1.0]]]), gl) == 0


def test_a_point_is_not_hidden_by_its_own_face_wherever_it_lies(gl: GlContext) -> None:
    mesh = sphere(6)
    points = zo.sample_surface(mesh, n_points=500, seed=1)
    shuffled = zo.SurfacePoints(points.positions * 0.5, points.face_ids[::-1].copy(), points.normals)
    assert differing(mesh, shuffled, eyes_of(mesh, points), gl) == 0


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    corners=arrays(np.float64, st.tuples(st.integers(1, 12), st.just(3), st.just(3)), elements=st.integers(-3, 3)),
    eyes=arrays(np.float64, (4, 3), elements=st.integers(-6, 6)),
    places=arrays(np.float64, (40, 3), elements=st.integers(-3, 3)),
)
def test_small_integers(corners: np.ndarray, eyes: np.ndarray, places: np.ndarray, gl: GlContext) -> None:
    """Degenerate faces, lines through edges and vertices, eyes in planes, eyes on points."""
    assert differing(triangles(corners), zo.SurfacePoints.free(places), eyes, gl) == 0


def test_splitting_changes_no_answer(gl: GlContext, monkeypatch: pytest.MonkeyPatch) -> None:
    """Faces, points and answers over the driver's limit of a storage block go in parts."""
    mesh = soup(700, 0.1)
    points = zo.sample_surface(mesh, n_points=1500, seed=1)
    eyes = eyes_of(mesh, points)
    with exact_gl.prepare(mesh, gl=gl) as whole:
        want = whole.visible(points, eyes)
    monkeypatch.setattr(exact_pass, "block_limit", lambda gl: 20_000)
    monkeypatch.setattr(exact_pass, "answer_limit", lambda gl: 3_000)
    with exact_gl.prepare(mesh, gl=gl) as split:
        assert (split.visible(points, eyes) == want).all()


@pytest.mark.parametrize("budget", [1, 40])
def test_cutting_work_changes_no_answer(budget: int, gl: GlContext, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work groups that give up at once, and that give up in the middle."""
    mesh = soup(700, 0.1)
    points = zo.sample_surface(mesh, n_points=500, seed=1)
    monkeypatch.setattr(exact_pass, "BUDGET", budget)
    assert differing(mesh, points, eyes_of(mesh, points), gl) == 0


ODD = WorkGroup(64, 1, 1, 8), WorkGroup(16, 31, 1, 40), WorkGroup(64, 3, 16, 8), WorkGroup(8, 1, 8, 8)


@pytest.mark.parametrize("shape", [*[shape for _, shape in HARDWARE], *ODD], ids=str)
def test_the_shape_of_the_work_changes_no_answer(
    shape: WorkGroup, gl: GlContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As it is cut for a GPU, in groups of several vectors, with as many points to a thread as there are bits."""
    mesh = soup(700, 0.1)
    points = zo.sample_surface(mesh, n_points=600, seed=1)
    monkeypatch.setattr(exact_pass, "SOFTWARE", ((0.0, shape),))
    assert differing(mesh, points, eyes_of(mesh, points), gl) == 0


@pytest.mark.parametrize("shapes", [SOFTWARE, HARDWARE])
def test_packets_are_smaller_where_points_are_sparse(shapes: tuple[tuple[float, WorkGroup], ...]) -> None:
    packets = [best_work_group(shapes, n_points, 1000).packet for n_points in (1, 300, 3000, 10**6)]
    assert packets == sorted(packets)
    assert packets[0] <= 8
    assert packets[-1] >= 64


def work_of(mesh: zo.Mesh, points: zo.SurfacePoints, gl: GlContext) -> exact_pass.WorkCounts:
    eyes = zo.views.paper100().eyes[::20] * mesh.diagonal + mesh.centre
    contact = 1e-5 * mesh.diagonal
    engine = exact_pass.ExactPass(gl, mesh, contact, counting=True)
    uploaded = engine.upload(points.positions, points.face_ids)
    engine.visible(uploaded, eyes)
    uploaded.release()
    engine.release()
    return engine.work


def test_little_is_left_to_float64(gl: GlContext) -> None:
    """A looser bound would be right, and slow: 0.1 to 0.4 % of the answers ask it on closed meshes."""
    mesh = sphere(35)
    points = zo.sample_surface(mesh, n_points=20_000, seed=1)
    work = work_of(mesh, points, gl)
    assert 0 < work.doubts < 0.01 * len(points) * 5


def test_a_huge_face_does_not_make_the_tiny_ones_dear(gl: GlContext) -> None:
    """Of 3,000 tiny faces a packet looks at a part, and still does with one beside them that is wider than all."""
    tiny = soup(3000, 2e-3)
    mixed = together(zo.Mesh([[-40.0, -40, 0], [40, -40, 0], [0, 60, 0]], [[0, 1, 2]]), tiny)
    points = zo.sample_surface(tiny, n_points=3000, seed=1)
    alone = work_of(tiny, points, gl)
    beside = work_of(mixed, zo.SurfacePoints(points.positions, points.face_ids + 1, points.normals), gl)
    assert alone.triangles / alone.groups < 1000
    assert beside.triangles / beside.groups < 1.2 * alone.triangles / alone.groups


@pytest.mark.parametrize("seed", range(5))
def test_no_face_hides_what_is_seen_past_it_in_its_own_plane(seed: int, gl: GlContext) -> None:
    mesh, points, eyes = row_in_a_plane(seed)
    with zo.prepare(mesh, "exact_gl", gl=gl) as occluder:
        assert occluder.visible(points, eyes).all()


def test_other_points_take_the_place_of_the_last(gl: GlContext) -> None:
    mesh = sphere(10)
    eyes = [[3.0, 1.0, 1.0]]
    some, others = (zo.sample_surface(mesh, n_points=300, seed=seed) for seed in (1, 2))
    with exact_gl.prepare(mesh, gl=gl) as occluder:
        first, second = occluder.visible(some, eyes), occluder.visible(others, eyes)
        assert (first != second).any()
        assert (occluder.visible(some, eyes) == first).all()
        assert (occluder.visible(some, eyes) == first).all()


def grazing(n: int = 6000) -> tuple[zo.Mesh, zo.SurfacePoints, np.ndarray]:
    """Free points behind edges of small triangles all over a box, a hair off the lines of sight; a far eye.

    The corners are as large as the box, and the distances as the triangles: what rounding the corners does is then
    most of the error, and the bound's least part.
    """
    rng = np.random.default_rng(3)
    size, n_triangles = 0.01, 40
    corners = rng.uniform(-0.5, 0.5, (n_triangles, 1, 3)) + size * rng.uniform(-1, 1, (n_triangles, 3, 3))
    eye = 1000.0 * np.array([[0.3, 0.2, 1.0]]) / np.sqrt(1.13)
    which, edge, along = rng.integers(0, n_triangles, n), rng.integers(0, 3, n), rng.random((n, 1))
    on_edge = corners[which, edge] * (1.0 - along) + corners[which, (edge + 1) % 3] * along
    onwards = (on_edge - eye) / np.linalg.norm(on_edge - eye, axis=1, keepdims=True)
    behind = on_edge + onwards * size * rng.uniform(1.5, 3.0, (n, 1))
    aside = rng.normal(size=(n, 3)) * 10.0 ** rng.uniform(-8.5, -8.0, (n, 1))
    return triangles(corners), zo.SurfacePoints.free(behind + aside), eye


def test_lines_that_graze_an_edge_are_right_and_with_a_smaller_bound_are_not(
    gl: GlContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The bound of rounding errors is needed: a 64th of it, and float32 decides what it cannot."""
    mesh, points, eye = grazing()
    assert differing(mesh, points, eye, gl) == 0
    monkeypatch.setattr(exact_pass, "EPSILON", exact_pass.EPSILON / 64.0)
    assert differing(mesh, points, eye, gl) > 10


def test_the_program_is_linked_once_per_context(gl: GlContext, monkeypatch: pytest.MonkeyPatch) -> None:
    points = zo.sample_surface(sphere(3), n_points=50, seed=1)
    for size in (3, 4):
        with exact_gl.prepare(sphere(size), gl=gl) as occluder:
            occluder.visible(points, [[3.0, 1.0, 1.0]])
        monkeypatch.setattr("zbuf_occlude.engines.gl.context.compile_program", None)  # not needed any more


def test_dispatches_are_as_long_as_they_should_be(gl: GlContext, monkeypatch: pytest.MonkeyPatch) -> None:
    """A thousand times shorter than the default, they are many; no answer depends on it."""
    mesh = sphere(10)
    points, eyes = zo.sample_surface(mesh, n_points=3000, seed=1), zo.views.fibonacci(40, distance=3.0).eyes
    counts, masks = [], []
    for seconds in (1000.0, 1e-4):
        monkeypatch.setattr(exact_pass, "DISPATCH_SECONDS", seconds)
        asked: list[int] = []
        ask = exact_pass.ExactPass._ask
        monkeypatch.setattr(exact_pass.ExactPass, "_ask", lambda *a, asked=asked, ask=ask: (asked.append(1), ask(*a)))
        with exact_gl.prepare(mesh, gl=gl) as occluder:
            masks += [occluder.visible(points, eyes), occluder.visible(points, eyes)]
        counts.append(len(asked))
        monkeypatch.setattr(exact_pass.ExactPass, "_ask", ask)
    assert counts[0] <= 4 < counts[1]
    assert all((mask == masks[0]).all() for mask in masks)
