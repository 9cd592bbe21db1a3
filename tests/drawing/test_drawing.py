"""Drawing: where things land in the picture, and what covers what; what is packed for the interactive viewer."""

import base64
import json

import numpy as np
import pytest

from tests.scenes import SQUARE, stacked
from zbuf_occlude.base.errors import ArgumentError
from zbuf_occlude.drawing.marks import area_of_mark, marks_of, paint, picture_frame, project_to_picture
from zbuf_occlude.drawing.pages import json_for_page, pack_cloud
from zbuf_occlude.drawing.pictures import draw_cloud, draw_mesh, new_figure

RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def pixels_of(figure: object) -> np.ndarray:
    figure.canvas.draw()  # type: ignore[attr-defined]
    return np.asarray(figure.canvas.buffer_rgba())[..., :3].astype(int)  # type: ignore[attr-defined]


def middle(image: np.ndarray) -> np.ndarray:
    return image[image.shape[0] // 2, image.shape[1] // 2]


def test_perspective_keeps_sizes_at_the_target_and_shrinks_beyond() -> None:
    screen = project_to_picture([[0, 1, 0], [0, 0, 1], [-4, 1, 0], [5, 0, 0]], eye=[4, 0, 0], target=[0, 0, 0])
    assert np.allclose(screen[:3], [[1, 0, 4], [0, 1, 4], [0.5, 0, 8]])
    assert np.isnan(screen[3, :2]).all(), "what is behind the eye has no place"


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


def test_nearer_points_are_on_top_whatever_their_order() -> None:
    positions, values = np.array([[0.0, 0, 1], [0, 0, 0]]), np.array([RED, BLUE])
    for order in ([0, 1], [1, 0]):
        figure, axes = new_figure(1, 1)
        seen = {"eye": [0, 0, 4], "target": [0, 0, 0], "radius": 1.0, "size": 400.0}
        draw_cloud(axes[0, 0], positions[order], values=values[order], **seen)
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


def test_errors() -> None:
    with pytest.raises(ArgumentError, match="positions must be"):
        project_to_picture(np.zeros((3, 5)), eye=[0, 0, 4], target=[0, 0, 0])
    with pytest.raises(ArgumentError, match="coincides with its target"):
        project_to_picture([[0, 0, 0]], eye=[1, 1, 1], target=[1, 1, 1])


# ---- marks ----------------------------------------------------------------------------------------------------------

WHITE = 0xFFFFFFFF


def painted(places: list[list[float]], diameter: float, colours: list[list[float]], size: int = 9) -> np.ndarray:
    """RGB of a white picture of this size after painting."""
    picture = np.full((size, size), WHITE, dtype=np.uint32)
    paint(picture, np.array(places, dtype=float), diameter, np.array(colours, dtype=float))
    return picture.view(np.uint8).reshape(size, size, 4)[..., :3]


def test_a_mark_is_a_disc_in_its_colour() -> None:
    image = painted([[4.5, 4.5]], 5.0, [[1, 0, 0]])
    rows, columns = np.nonzero((image == (255, 0, 0)).all(axis=-1))
    distances = np.hypot(rows - 4, columns - 4)
    assert len(rows) == np.count_nonzero(np.hypot(*np.mgrid[-4:5, -4:5]) <= 2.5) == 21
    assert distances.max() <= 2.5
    assert (image[~(image == (255, 0, 0)).all(axis=-1)] == 255).all()


def test_what_is_outside_stays_outside() -> None:
    image = painted([[0, 4], [-20, 4], [100, 4]], 5.0, [[0, 0, 0]] * 3)
    assert (image[4, :3] == 0).all()
    assert (image[:, 3:] == 255).all(), "nothing comes in again on the other side"


def test_far_marks_come_first_and_are_paler() -> None:
    positions = np.array([[0.0, 0, 1], [0, 0, -1], [0, 0, 9]])
    places, colours = marks_of(positions, eye=[0, 0, 4], target=[0, 0, 0])
    assert len(places) == 2, "the last is behind the eye"
    assert (colours[0] > colours[1]).all()


def test_frames_and_areas() -> None:
    square = np.array([[0.0, 0], [2, 0], [2, 2], [0, 2]])
    middle, half = picture_frame(square, None)
    assert (middle == 1).all()
    assert half == 2 * 0.53
    assert picture_frame(square, 3.0)[1] == 3.0
    assert picture_frame(np.empty((0, 2)), None)[1] == picture_frame(np.zeros((1, 2)), None)[1] == 1.0
    many = np.random.default_rng(0).uniform(-1, 1, (1000, 2))
    assert np.isclose(area_of_mark(many, 1.0, 50.0) * len(many), 2500, rtol=0.01), "together they cover the square"


# ---- what is packed for the interactive viewer -----------------------------------------------------------------------


def test_positions_come_back_to_half_a_step() -> None:
    positions = np.random.default_rng(0).uniform(-3, 7, (50, 3))
    cloud = pack_cloud(positions, centre=[2, 2, 2], longest=10.0, codes=np.arange(50) % 4)
    shorts = np.frombuffer(base64.b64decode(cloud["positions"]), dtype="<i2").reshape(-1, 3)
    assert np.abs(shorts / 32767 * 10.0 + 2.0 - positions).max() <= 0.5 * 10.0 / 32767 + 1e-12
    assert np.frombuffer(base64.b64decode(cloud["codes"]), np.uint8).tolist() == [i % 4 for i in range(50)]
    assert cloud["normals"] is None
    assert cloud["n"] == 50


def test_json_for_a_page_cannot_end_its_script() -> None:
    text = json_for_page({"name": "</script><script>alert(1)"})
    assert "<" not in text
    assert json.loads(text) == {"name": "</script><script>alert(1)"}
