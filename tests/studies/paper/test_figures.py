"""The paper's figures: their measures against closed forms; each can be drawn."""

import numpy as np
import pytest

from tests.scenes import box, sphere
from zbuf_occlude import Mesh, SurfacePoints, Views
from zbuf_occlude.studies.paper.figures import FIGURES, Exhibit, cells_as_mesh, make_mask, projected_areas


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
def test_each_figure_is_drawn(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("zbuf_occlude.drawing.pictures.MESH_PIXELS", 150)  # a coarse picture has the same marks
    mesh = Mesh(sphere(6).vertices * [0.5, 0.4, 0.3], sphere(6).faces)
    figure = FIGURES[name].draw(Exhibit(mesh, make_mask("embree", {})))
    figure.canvas.draw()
    image = np.asarray(figure.canvas.buffer_rgba())  # type: ignore[attr-defined]
    assert (image[..., :3].min(axis=2) < 200).mean() > 0.005, "something is on the paper"


def test_a_real_scan_is_figure_7s_last_row() -> None:
    mesh = box((1.0, 0.5, 0.25)).normalized()
    scan = np.random.default_rng(0).uniform(-1, 1, (300, 3)) * [2, 1, 0.7] + [12, -3, 0]
    figure = FIGURES["fig7"].draw(Exhibit(mesh, make_mask("oracle", {}), scan=scan))
    titles = [axes.get_title() for axes in figure.axes]
    assert titles[6:] == [
        "(G) real scan, 300 points, from the scanner",
        "(H) real scan, 300 points, from its right",
        "(I) real scan, 300 points, from behind",
    ]
    x, y = np.asarray(figure.axes[6].collections[0].get_offsets()).T
    assert np.ptp(x) < np.ptp(y) * 3, "the scanner looks along the box's length"


@pytest.mark.parametrize("name", [name for name, figure in FIGURES.items() if figure.masked])
def test_cameras_stand_at_the_distance_asked_for(name: str) -> None:
    mesh, lengths = Mesh(sphere(6).vertices * [0.5, 0.4, 0.3], sphere(6).faces), []

    def mask(mesh: Mesh, points: SurfacePoints, eyes: np.ndarray) -> np.ndarray:
        lengths.extend(np.linalg.norm(eyes, axis=1))
        return np.ones((len(eyes), len(points)), dtype=bool)

    FIGURES[name].draw(Exhibit(mesh, mask, distance=2.5))
    assert np.allclose(lengths, 2.5)
    assert lengths
