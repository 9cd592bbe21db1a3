"""Which of a cloud's visible points are written: farthest points are the farthest, and the first n the farthest n."""

import numpy as np
import pytest

from tests.scenes import box
from zbuf_occlude import OptionError, sample_surface
from zbuf_occlude.dataset.clouds import farthest_points, gather_clouds
from zbuf_occlude.dataset.plan import Recipe
from zbuf_occlude.dataset.presets import PRESETS
from zbuf_occlude.views import ring

pytest.importorskip("fpsample", reason="the package fpsample is not installed")


@pytest.mark.parametrize("shift", [0.0, 1e4])
def test_each_point_is_the_farthest_from_those_before_it(shift: float) -> None:
    positions = np.random.default_rng(2).random((900, 3)) + shift
    found = farthest_points(positions, 300, np.random.default_rng(1))
    assert len(set(found.tolist())) == 300
    nearest = np.linalg.norm(positions - positions[found[0]], axis=1)
    for index in found[1:]:
        assert nearest[index] >= nearest.max() * (1 - 1e-3)
        nearest = np.minimum(nearest, np.linalg.norm(positions - positions[index], axis=1))


def test_clouds_of_farthest_points_are_spread_more_evenly_than_random_ones() -> None:
    mesh, views = box(), ring(2, 0.3)
    points = sample_surface(mesh, n_points=4_000, seed=1)
    mask = np.ones((2, 4_000), dtype=bool)
    mask[1, 50:] = False  # fewer than asked
    closest = {}
    for subset in ("random", "fps"):
        clouds = gather_clouds(points, mask, views, Recipe(subset=subset, sample_size=200), "key", 0)
        assert set(points.face_ids[:50]) >= set(clouds[1]["face_ids"]), "points repeat, none is made up"
        cloud = clouds[0]["data"].astype(float)
        apart = np.linalg.norm(cloud[:, None] - cloud, axis=2) + np.eye(200) * 9
        closest[subset] = apart.min()
        again = gather_clouds(points, mask, views, Recipe(subset=subset, sample_size=200), "key", 0)
        assert np.array_equal(again["data"], clouds["data"])
    assert closest["fps"] > 5 * closest["random"]


def test_another_word_is_refused() -> None:
    with pytest.raises(OptionError, match="subset must be one of random, fps; got 'first'"):
        Recipe(subset="first")


def test_presets_differ_by_name() -> None:
    assert len({row.name for row in PRESETS}) == len(PRESETS)
    assert all(row.n_objects > 0 for row in PRESETS)
