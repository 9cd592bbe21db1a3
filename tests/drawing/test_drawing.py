"""Drawing: where things land in the picture, and what covers what."""

import numpy as np
import pytest

from tests.scenes import SQUARE, box, stacked
from zbuf_occlude.drawing.marks import project
from zbuf_occlude.drawing.pictures import draw_cloud, draw_mesh, new_figure
from zbuf_occlude.errors import ArgumentError

RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def pixels_of(figure: object) -> np.ndarray:
    figure.canvas.draw()  # type: ignore[attr-defined]
    return np.asarray(figure.canvas.buffer_rgba())[..., :3].astype(int)  # type: ignore[attr-defined]


def middle(image: np.ndarray) -> np.ndarray:
    return image[image.shape[0] // 2, image.shape[1] // 2]


def test_perspective_keeps_sizes_at_the_target_and_shrinks_beyond() -> None:
    screen = project([[0, 1, 0], [0, 0, 1], [-4, 1, 0], [5, 0, 0]], eye=[4, 0, 0], target=[0, 0, 0])
    assert np.allclose(screen[:3], [[1, 0, 4], [0, 1, 4], [0.5, 0, 8]])
    assert np.isnan(screen[3, :2]).all(), "what is behind the eye has no place"


def test_parallel_projection_does_not_shrink() -> None:
    screen = project([[-4, 1, 0], [5, 0, 2]], eye=[4, 0, 0], target=[0, 0, 0], perspective=False)
    assert np.allclose(screen, [[1, 0, 8], [0, 2, -1]])


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_nearer_face_covers_a_farther_one(order: tuple[int, int]) -> None:
    """Also where their centres lie the other way round: the near square is small, the far one runs up to the eye."""
    near = SQUARE - [0.5, 0.5, 0]
    far = (SQUARE - [0.5, 0.5, 0]) * 3 + [0, 0, -0.1]
    squares = [(near, RED), (far, BLUE)]
    mesh = stacked(*(squares[i][0] for i in order))
    colours = np.repeat([squares[i][1] for i in order], 2, axis=0)
    figure, axes = new_figure(1, 1)
    draw_mesh(axes[0, 0], mesh, eye=[0, 0.1, 4], target=[0, 0, 0], face_colours=colours, radius=2.0)
    image = pixels_of(figure)
    assert middle(image)[0] > middle(image)[2], "the near, red square is in the middle"
    side = image[image.shape[0] // 2, int(image.shape[1] * 0.75)]
    assert side[2] > side[0], "the far, blue one beside it"
    assert (image[2, 2] == 255).all(), "the ground stays white"


def test_edges_are_darker() -> None:
    plain, lined = new_figure(1, 1), new_figure(1, 1)
    for (_, axes), edges in ((plain, False), (lined, True)):
        draw_mesh(axes[0, 0], box(), eye=[3, 2, 2], target=[0, 0, 0], edges=edges)
    assert pixels_of(lined[0]).mean() < pixels_of(plain[0]).mean() - 0.2


def test_nearer_points_are_on_top_whatever_their_order() -> None:
    positions, values = np.array([[0.0, 0, 1], [0, 0, 0]]), np.array([RED, BLUE])
    for order in ([0, 1], [1, 0]):
        figure, axes = new_figure(1, 1)
        draw_cloud(
            axes[0, 0], positions[order], eye=[0, 0, 4], target=[0, 0, 0], values=values[order], radius=1.0, size=400.0
        )
        colour = middle(pixels_of(figure))
        assert colour[0] > colour[2]


def test_light_falls_on_both_sides() -> None:
    images = []
    for sign in (1.0, -1.0):
        figure, axes = new_figure(1, 1)
        normals = np.array([[0.0, 0.6, 0.8]]) * sign
        draw_cloud(axes[0, 0], [[0.0, 0, 0]], eye=[0, 0, 4], target=[0, 0, 0], normals=normals, size=900.0)
        images.append(pixels_of(figure))
    assert (images[0] == images[1]).all()


def test_an_empty_cloud_is_an_empty_picture() -> None:
    figure, axes = new_figure(1, 1)
    draw_cloud(axes[0, 0], np.empty((0, 3)), eye=[0, 0, 4], target=[0, 0, 0])
    assert (pixels_of(figure) == 255).all()


def test_errors() -> None:
    with pytest.raises(ArgumentError, match="positions must be"):
        project(np.zeros((3, 5)), eye=[0, 0, 4], target=[0, 0, 0])
    with pytest.raises(ArgumentError, match="an eye must not be at its target"):
        project([[0, 0, 0]], eye=[1, 1, 1], target=[1, 1, 1])
