"""Algorithms 1 and 2: counts, uniformity, determinism."""

import numpy as np
import pytest

from zbuf_occlude import ArgumentError, Mesh, SurfacePoints, sample_surface
from zbuf_occlude.meshes.sampling import curve_order, exact_counts

UNEQUAL = Mesh(
    [[0, 0, 0], [4, 0, 0], [0, 4, 0], [0, 0, 5], [1, 0, 5], [0, 1, 5]], [[0, 1, 2], [3, 4, 5]]
)  # areas 8 and 0.5


def test_exact_count_follows_area() -> None:
    points = sample_surface(UNEQUAL, n_points=20_000, seed=1)
    assert len(points) == 20_000
    share = (points.face_ids == 0).mean()
    assert abs(share - 8 / 8.5) < 4 * np.sqrt(8 / 8.5 * 0.5 / 8.5 / 20_000)


def test_algorithm_1_takes_a_fraction_of_a_point_with_that_probability() -> None:
    counts = np.array([len(sample_surface(UNEQUAL, density=0.5, seed=s)) for s in range(2000)])
    # A s = 4 and 0.25: always four points, and a fifth with probability 1/4
    assert set(counts) == {4, 5}
    assert abs((counts == 5).mean() - 0.25) < 4 * np.sqrt(0.25 * 0.75 / 2000)


def test_points_lie_in_their_triangle_and_uniformly() -> None:
    points = sample_surface(UNEQUAL, n_points=50_000, seed=2)
    big = points.positions[points.face_ids == 0]
    assert np.allclose(points.normals, [0, 0, 1])
    assert (big[:, :2] >= 0).all()
    assert (big[:, :2].sum(axis=1) <= 4 + 1e-12).all()
    # uniform over the triangle: the mean is the centroid, and the corner quarter holds a quarter of the points
    assert np.allclose(big.mean(axis=0), [4 / 3, 4 / 3, 0], atol=0.03)
    assert abs((big[:, :2].sum(axis=1) <= 2).mean() - 0.25) < 0.01


def test_same_seed_same_bytes() -> None:
    one, two = (sample_surface(UNEQUAL, n_points=1000, seed=5) for _ in range(2))
    assert one.positions.tobytes() == two.positions.tobytes()
    assert one.positions.tobytes() != sample_surface(UNEQUAL, n_points=1000, seed=6).positions.tobytes()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "give exactly one of n_points and density"),
        ({"n_points": 5, "density": 1.0}, "give exactly one of n_points and density"),
        ({"n_points": 0}, "n_points must be a positive int; got 0"),
        ({"density": -1.0}, "density must be positive and finite; got -1.0"),
        ({"density": 1e12}, "at most 2\\^31 - 1 can be made"),
    ],
)
def test_errors(arguments: dict[str, float], message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        sample_surface(UNEQUAL, **arguments)  # type: ignore[arg-type]


def test_selection_keeps_rows_together() -> None:
    points = sample_surface(UNEQUAL, n_points=50, seed=0)
    some = points.select(points.face_ids == 1)
    assert len(some) == (points.face_ids == 1).sum()
    assert (some.positions[:, 2] == 5).all()
    free = SurfacePoints.free([[0, 0, 1], [1, 2, 3]])
    assert free.face_ids.tolist() == [-1, -1]


@pytest.mark.parametrize("n_points", [0, 1, 40, 5000])
def test_the_curve_keeps_the_order_of_faces_and_of_equal_codes(n_points: int) -> None:
    rng = np.random.default_rng(n_points)
    face_ids = np.sort(rng.integers(0, 7, n_points)).astype(np.int32)
    positions = rng.integers(-1, 4, (n_points, 3)) / 3.0  # many share a cell, some lie outside the cube
    points = SurfacePoints(positions, face_ids, np.zeros_like(positions))
    cells = np.clip(positions * 65536, 0, 65535).astype(int)
    codes = [sum((x >> bit & 1) << 3 * bit + axis for axis, x in enumerate(c) for bit in range(16)) for c in cells]
    assert curve_order(points, np.zeros(3), 1.0).tolist() == np.lexsort((codes, face_ids)).tolist()
    assert curve_order(points, np.zeros(3), 0.0).tolist() == list(range(n_points))


def test_counts_are_those_of_a_search_for_every_draw() -> None:
    rng = np.random.default_rng(5)
    with np.errstate(over="ignore"), pytest.raises(ArgumentError, match="area of the mesh overflows"):
        exact_counts(np.array([1e308, 1e308]), 5, rng)
    for areas in (rng.random(300) ** 8, np.array([0.0, 1.0, 0.0, 2.0, 0.0]), np.array([1e-320]), np.full(7, 1e300)):
        edges, draws = np.cumsum(areas), np.random.default_rng(1).random(2000)
        faces = np.minimum(np.searchsorted(edges, draws * edges[-1], side="right"), len(areas) - 1)
        expected = np.bincount(faces, minlength=len(areas))
        assert exact_counts(areas, 2000, np.random.default_rng(1)).tolist() == expected.tolist()
