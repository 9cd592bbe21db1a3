"""The contract: one suite that every row of the table of methods goes through. A new method needs nothing here but,
if it is not exact, its row in AGREEMENT."""

import re
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.needs import need
from tests.scenes import SQUARE, box, sphere, stacked, together, wrong
from zbuf_occlude.visibility import METHODS, find_method
from zbuf_occlude.visibility.interface import Method, VisibilityQuery

Prepare = Callable[..., VisibilityQuery]

AGREEMENT = {
    # method: least fraction of answers equal to the oracle's on SCENE from EYES, and from WITHIN
    "embree": (0.9999, 0.9999),
    "exact_hsr": (0.9999, 0.9999),
    "depth_buffer": (0.97, 0.95),
    "pyrender": (0.98, 0.98),
    "vertex_hsr": (0.85, 0.85),
    "vertex_hsr_culled": (0.85, 0.85),
    "occupancy_grid": (0.85, 0.88),
    "hidden_point_removal": (0.85, 0.45),
}

CLOSED = r"This visibility query is closed\. Call prepare\(\) again\."


def scene() -> zo.Mesh:
    """A ball half in a box under a plate that touches it, a plate with an edge in another's middle, a copied sheet."""
    ball = sphere(14)
    crate = box((1.6, 1.4, 1.0)).transformed(1.0, (0.3, 0.0, -1.0))
    sheets = stacked(
        (SQUARE - [0.5, 0.5, 0]) * [2.4, 1.8, 1] + [0.0, 0.0, 1.0],
        (SQUARE - [0.5, 0.5, 0]) * [2.4, 1.8, 1] + [0.0, 0.0, 1.0],
        SQUARE[:, [2, 0, 1]] * [1, 1.1, 1.3] + [0.2, 0.0, 1.0],
    )
    return together(ball, crate, sheets)


SCENE = scene()
POINTS = zo.sample_surface(SCENE, n_points=1500, seed=0)
EYES = zo.views.paper100(4.0).around(SCENE.centre, SCENE.longest_side).eyes[5::16]
WITHIN = np.array([[0.9, 0.8, 0.6], [-1.05, -0.6, 0.7], [0.1, 0.05, 0.1]])  # under the plate, and in the ball
FREE = zo.SurfacePoints.free(
    np.concatenate([np.random.default_rng(1).uniform(-1.3, 1.3, (60, 3)), [[30.0, 20, 9], [-40, 0, 0.1], [0, 0, -90]]])
)


@pytest.fixture(scope="module", params=METHODS, ids=lambda method: method.name)
def method(request: pytest.FixtureRequest) -> Method:
    row: Method = request.param
    need(row.requires)
    return row


@pytest.fixture(scope="module")
def occluder(prepare: Prepare) -> Iterator[VisibilityQuery]:
    with prepare(SCENE) as opened:
        yield opened


@pytest.fixture(scope="module")
def answer(occluder: VisibilityQuery) -> np.ndarray:
    return occluder.visible(POINTS, EYES)


def disagreement(mesh: zo.Mesh, found: np.ndarray, points: zo.SurfacePoints, eyes: np.ndarray) -> float:
    """Fraction of answers that differ from the oracle's."""
    return wrong(mesh, found, points, eyes) / found.size


def test_every_approximate_method_states_its_bound() -> None:
    missing = [m.name for m in METHODS if not m.exact and m.name not in AGREEMENT]
    assert not missing, f"AGREEMENT must have a row for each method that is not exact; it lacks {missing}. Add them."


def test_the_mask(method: Method, answer: np.ndarray) -> None:
    assert isinstance(answer, np.ndarray)
    assert answer.shape == (len(EYES), len(POINTS))
    assert answer.dtype == np.bool_
    assert 0.1 < answer.mean() < 0.9


def test_agreement_with_the_oracle(method: Method, answer: np.ndarray) -> None:
    allowed = 0.0 if method.exact else 1 - AGREEMENT[method.name][0]
    assert disagreement(SCENE, answer, POINTS, EYES) <= allowed


def test_eyes_within_the_bounding_sphere(method: Method, occluder: VisibilityQuery) -> None:
    allowed = 0.0 if method.exact else 1 - AGREEMENT[method.name][1]
    assert disagreement(SCENE, occluder.visible(POINTS, WITHIN), POINTS, WITHIN) <= allowed


def test_eyes_on_the_surface_are_answered(method: Method, occluder: VisibilityQuery) -> None:
    """What is visible from there is not defined (docs/conventions.md), but a user's eye may lie there: no crash."""
    corners = SCENE.corners[:: len(SCENE.faces) // 3]
    eyes = np.concatenate([POINTS.positions[::500], corners[:, 0], corners[:, :2].mean(axis=1), corners.mean(axis=1)])
    assert occluder.visible(POINTS, eyes).shape == (len(eyes), len(POINTS))
    if not method.ray_casting_unsupported_reason:
        assert len(occluder.first_hits(eyes, np.ones_like(eyes)).face_ids) == len(eyes)


def test_far_eyes(method: Method, occluder: VisibilityQuery) -> None:
    eyes = EYES * 250.0  # a thousand sizes away
    allowed = 0.0 if method.exact else 1 - AGREEMENT[method.name][0]
    assert disagreement(SCENE, occluder.visible(POINTS, eyes), POINTS, eyes) <= allowed


def test_free_points(method: Method, occluder: VisibilityQuery) -> None:
    eyes = np.concatenate([EYES, WITHIN])
    found = occluder.visible(FREE, eyes)
    assert found.shape == (len(eyes), len(FREE))
    if method.exact:
        assert wrong(SCENE, found, FREE, eyes) == 0


def test_free_and_surface_points_together(method: Method, occluder: VisibilityQuery, answer: np.ndarray) -> None:
    """A free point hides none, so the others' answers stay (but for a method that sees points and not faces)."""
    half = POINTS.select(np.arange(0, len(POINTS), 2))
    mixed = zo.SurfacePoints(
        np.concatenate([FREE.positions, half.positions]),
        np.concatenate([FREE.face_ids, half.face_ids]),
        np.concatenate([FREE.normals, half.normals]),
    )
    found = occluder.visible(mixed, EYES)[:, len(FREE) :]
    if method.name != "hidden_point_removal":
        assert (found == answer[:, ::2]).all()


def test_one_point_and_one_eye(method: Method, occluder: VisibilityQuery, answer: np.ndarray) -> None:
    for i in (0, 700, 1499):
        found = occluder.visible(POINTS.select([i]), EYES[2:3])
        assert found.shape == (1, 1)
        if method.name != "hidden_point_removal":  # one point has no hull
            assert found.item() == answer[2, i]


@pytest.mark.parametrize("n_points", [1, 3, 300])
def test_free_points_where_the_eye_is(occluder: VisibilityQuery, n_points: int) -> None:
    eye = np.array([[1.9, -2.3, 2.1]])
    assert occluder.visible(zo.SurfacePoints.free(np.repeat(eye, n_points, axis=0)), eye).all()


def test_each_eye_answers_for_itself(occluder: VisibilityQuery, answer: np.ndarray) -> None:
    """However views are batched, the answers are the same; of one eye (3,) a row."""
    assert occluder.visible(POINTS, EYES).tobytes() == answer.tobytes()
    assert (occluder.visible(POINTS, EYES[::-1]) == answer[::-1]).all()
    assert (occluder.visible(POINTS, EYES[3:4]) == answer[3:4]).all()
    assert np.array_equal(occluder.visible(POINTS, EYES[3]), answer[3])


def test_no_points_and_no_eyes(occluder: VisibilityQuery) -> None:
    none = zo.SurfacePoints.free(np.empty((0, 3)))
    for points, eyes in ((none, EYES), (POINTS, np.empty((0, 3))), (none, np.empty((0, 3)))):
        found = occluder.visible(points, eyes)
        assert found.shape == (len(eyes), len(points))
        assert found.dtype == np.bool_


def test_what_is_given_is_not_changed(occluder: VisibilityQuery) -> None:
    eyes = EYES.copy()
    given = [eyes, POINTS.positions, POINTS.face_ids, POINTS.normals, SCENE.vertices, SCENE.faces]
    before = [array.tobytes() for array in given]
    found = occluder.visible(POINTS, eyes)
    assert [array.tobytes() for array in given] == before
    found[:] = True  # nor is the answer somebody else's memory
    assert not occluder.visible(POINTS, eyes).all()


def test_eyes_of_other_types_and_orders(occluder: VisibilityQuery) -> None:
    eyes = np.round(EYES * 1024) / 1024  # the same in float32
    expected = occluder.visible(POINTS, eyes)
    for other in (eyes.tolist(), eyes.astype(np.float32), np.asfortranarray(eyes)):
        assert (occluder.visible(POINTS, other) == expected).all()


@pytest.mark.parametrize("scale", [2.0**-10, 2.0**12])
def test_scaling_by_a_power_of_two_changes_nothing(prepare: Prepare, answer: np.ndarray, scale: float) -> None:
    with prepare(SCENE.transformed(scale)) as occluder:
        assert (occluder.visible(POINTS.transformed(scale), EYES * scale) == answer).all()


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_scale_and_place_do_not_matter(method: Method, prepare: Prepare, answer: np.ndarray, scale: float) -> None:
    shift = scale * np.array([3.0, -7.0, 11.0])
    mesh, points, eyes = SCENE.transformed(scale, shift), POINTS.transformed(scale, shift), EYES * scale + shift
    with prepare(mesh) as occluder:
        found = occluder.visible(points, eyes)
    if method.exact:
        assert wrong(mesh, found, points, eyes) == 0
    else:
        assert (found != answer).mean() <= 1e-3


def test_vertices_that_no_face_uses_change_nothing(prepare: Prepare, answer: np.ndarray) -> None:
    more = zo.Mesh(np.concatenate([SCENE.vertices, [[1e6, 0, 0], [0.1, 0.2, 2.0], EYES[0]]]), SCENE.faces)
    with prepare(more) as occluder:
        assert (occluder.visible(POINTS, EYES) == answer).all()


def test_a_mesh_of_one_face(method: Method, prepare: Prepare) -> None:
    mesh = zo.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    points = zo.sample_surface(mesh, n_points=50, seed=0)
    eyes = [[0.2, 0.3, 3.0], [1.0, 2.0, -0.7]]
    with prepare(mesh) as occluder:
        visible = occluder.visible(points, eyes)
    if method.exact or method.name.startswith("vertex_hsr"):
        assert visible.all()  # nothing is there that could hide a point, and the own face never does
    with pytest.raises(zo.ArgumentError, match=CLOSED):
        occluder.visible(points, eyes)


def test_options_that_are_none(method: Method, prepare: Prepare) -> None:
    with pytest.raises(zo.OptionError, match=rf"method '{method.name}' must be given one of .*; got 'nonsense'\."):
        prepare(SCENE, nonsense=1)
    for contact in (-1.0, 1.0, float("nan")) if "contact" in method.options() else ():
        with pytest.raises(zo.OptionError, match=r"contact must lie in \[0, 1\), a fraction of the mesh's diag"):
            prepare(SCENE, contact=contact)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("depth_buffer", {"resolution": 0}, "resolution must be an int in [16, 8192], pixels along a side; got 0."),
        ("depth_buffer", {"resolution": 10**6}, "resolution must be an int in"),
        ("depth_buffer", {"tolerance": -1.0}, "tolerance must lie in [0, 1)"),
        ("depth_buffer", {"slope_bias": -1.0}, "slope_bias must not be negative"),
        ("depth_buffer", {"refine": "magic"}, "refine must be one of witness, none; got 'magic'"),
        ("pyrender", {"resolution": 0}, "resolution must be an int in [1, 8192], pixels along a side; got 0."),
        ("pyrender", {"resolution": 1e3}, "resolution must be an int in [1, 8192], pixels along a side; got 1000.0."),
        ("pyrender", {"resolution": 9000}, "resolution must be an int in [1, 8192], pixels along a side; got 9000."),
        ("pyrender", {"tolerance": -1e-9}, "tolerance must lie in [0, 1), a fraction of the mesh's diagonal; got -1e"),
        ("pyrender", {"slope_bias": -1.0}, "slope_bias must not be negative and be finite, in pixels; got -1.0."),
        ("pyrender", {"slope_bias": np.inf}, "slope_bias must not be negative and be finite, in pixels; got inf."),
        ("vertex_hsr", {"divide": 0.0}, "divide must lie in (0, 1], a fraction of the mesh's area; got 0.0"),
        ("vertex_hsr", {"max_faces": 0}, "max_faces must be a positive int; got 0"),
        ("vertex_hsr_culled", {"suggestion": 3}, "suggestion must be 1 or 2, the paper's first or second"),
        ("vertex_hsr_culled", {"n_samples": -5}, "n_samples must be a positive int; got -5"),
        ("vertex_hsr_culled", {"seed": 0.5}, "seed must be an int from 0; got 0.5"),
        ("exact_hsr", {"cull": "third"}, "cull must be one of none, first, second; got 'third'"),
        ("exact_hsr", {"n_samples": 2.5}, "n_samples must be a positive int; got 2.5"),
        ("exact_hsr", {"seed": -1}, "seed must be an int from 0; got -1"),
        ("occupancy_grid", {"n": 1}, "n must be an int in [2, 512], cells along a side; got 1"),
        ("occupancy_grid", {"n": 32.0}, "n must be an int in [2, 512], cells along a side; got 32.0"),
        ("occupancy_grid", {"n": 5000}, "n must be an int in [2, 512]"),
        ("occupancy_grid", {"n_samples": 0}, "n_samples must be a positive int; got 0"),
        ("occupancy_grid", {"seed": -1}, "seed must be an int from 0; got -1"),
        *[
            (
                "hidden_point_removal",
                {"radius": radius},
                f"radius must be positive and finite, in diagonals of the mesh; got {radius}",
            )
            for radius in (0.0, -1.0, np.inf, np.nan)
        ],
    ],
)
def test_options_out_of_range(name: str, options: dict[str, object], message: str, request: Any) -> None:
    row = find_method(name)
    need(row.requires)
    shared = {"gl": request.getfixturevalue("gl")} if row.needs_gl else {}
    with pytest.raises(zo.OptionError, match=re.escape(message)):
        zo.prepare(SCENE, name, **shared, **options)


def test_options_can_be_typed_at_a_command_line(method: Method) -> None:
    for name, default in method.options().items():
        assert default is None or isinstance(default, (bool, int, float, str)), f"{name}={default!r}"


def test_an_error_inside_closes_too(prepare: Prepare, answer: np.ndarray) -> None:
    another = prepare(SCENE)
    assert isinstance(another, VisibilityQuery)
    assert another.mesh is SCENE
    assert another.visible(POINTS, EYES).tobytes() == answer.tobytes()
    with pytest.raises(KeyError), another:
        raise KeyError
    with pytest.raises(zo.ArgumentError, match=CLOSED):
        another.visible(POINTS, EYES)
    another.close()


def test_two_at_once(prepare: Prepare, answer: np.ndarray) -> None:
    """Occluders of two meshes do not disturb each other, in whatever order they are asked and closed."""
    other = box()
    points, eyes = zo.sample_surface(other, n_points=300, seed=0), np.array([[3.0, 2.0, 1.5]])
    two = prepare(other)
    expected = two.visible(points, eyes)
    one = prepare(SCENE)
    assert (one.visible(POINTS, EYES) == answer).all()
    assert (two.visible(points, eyes) == expected).all()
    one.close()
    assert (two.visible(points, eyes) == expected).all()
    two.close()


def test_threads_at_a_time_give_what_one_gives(method: Method, prepare: Prepare) -> None:
    """On one occluder and on two. Methods that render have their own story (test_gl_threads.py)."""
    if method.needs_gl or method.name == "pyrender":
        return
    asked = [
        [(zo.sample_surface(mesh, n_points=150 + 40 * i, seed=i), EYES[i : i + 2]) for i in range(6)]
        for mesh in (SCENE, sphere(8))
    ]
    with prepare(SCENE) as one, prepare(sphere(8)) as other, ThreadPoolExecutor(4) as pool:
        alone = [[occluder.visible(*each) for each in mine] for occluder, mine in zip((one, other), asked, strict=True)]

        def agree(occluder: VisibilityQuery, which: int, order: slice) -> bool:
            answers = zip(asked[which][order], alone[which][order], strict=True)
            return all(np.array_equal(occluder.visible(*question), answer) for question, answer in answers)

        running = [
            pool.submit(agree, occluder, which, slice(None, None, step))
            for which, occluder in enumerate((one, other))
            for step in (1, -1)
        ]
        assert all(future.result(timeout=300) for future in running)


def test_who_renders(method: Method, occluder: VisibilityQuery) -> None:
    assert occluder.renderer
    if method.needs_gl:
        assert occluder.renderer != "none"


@pytest.mark.parametrize(
    ("points", "eyes", "message"),
    [
        (POINTS, EYES.T, r"eyes must be \(n, 3\) float; got \(3, \d+\) float64\. Transpose it\?"),
        (POINTS, EYES[0, :2], r"eyes must be \(n, 3\) float; got \(2,\) float64"),
        (POINTS, [[0, 0, np.nan]], "eyes must be finite; row 0 is"),
        (POINTS.positions, EYES, r"points must be SurfacePoints; got ndarray\. Wrap free positions"),
        (
            zo.SurfacePoints([[0, 0, 0]], [10**6], [[0, 0, 0]]),
            EYES,
            "face_ids must index the mesh's .* faces; got 1000000",
        ),
    ],
    ids=["transposed", "two numbers", "nan", "bare array", "another mesh"],
)
def test_bad_arguments(occluder: VisibilityQuery, points: object, eyes: object, message: str) -> None:
    with pytest.raises(zo.ArgumentError, match=message):
        occluder.visible(points, eyes)  # type: ignore[arg-type]


def test_an_unknown_method_names_those_there_are() -> None:
    with pytest.raises(zo.OptionError, match=r"method must be one of .*oracle.*; got 'zbuffer'\."):
        find_method("zbuffer")
