"""The paper's figures: what they measure against closed forms, and that each can be drawn."""

import numpy as np
import pytest

from tests.scenes import box, sphere
from zbuf_occlude import Mesh, Views
from zbuf_occlude.compare.figures import FIGURES, cells_as_mesh, make_mask, projected_areas


def test_projected_area_of_a_box_from_above_and_from_a_corner() -> None:
    mask = make_mask("oracle", {})
    views = Views(np.radians([0.0, 45.0]), np.radians([90.0, 35.0]), np.array([50.0, 50.0]))
    areas = projected_areas(box((1.0, 0.5, 0.25)), mask, views, seed=0, n_points=4000)
    sides = [0.5 * 0.25, 1.0 * 0.25, 1.0 * 0.5]
    assert np.allclose(areas[0], [0, 0, sides[2]], atol=0.02)
    assert np.allclose(areas[1], sides, atol=0.02), "three sides are seen, each across one axis"


def test_outside_of_cells() -> None:
    one = np.zeros((4, 4, 4), dtype=bool)
    one[1, 2, 3] = True
    mesh = cells_as_mesh(one)
    assert len(mesh.faces) == 12
    assert np.allclose(mesh.bounds, [[-0.25, 0.0, 0.25], [0.0, 0.25, 0.5]])
    full = cells_as_mesh(np.ones((4, 4, 4), dtype=bool))
    assert full.areas.sum() == pytest.approx(6.0), "inner walls are left out"


@pytest.mark.parametrize("name", FIGURES)
def test_each_figure_is_drawn(name: str) -> None:
    mesh = Mesh(sphere(6).vertices * [0.5, 0.4, 0.3], sphere(6).faces)
    figure = FIGURES[name].draw(mesh, make_mask("embree", {}), 0)
    figure.canvas.draw()
    image = np.asarray(figure.canvas.buffer_rgba())  # type: ignore[attr-defined]
    assert (image[..., :3].min(axis=2) < 200).mean() > 0.005, "something is on the paper"
