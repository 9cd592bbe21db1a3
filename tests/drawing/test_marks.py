"""Marks: painted where they belong, the later over the earlier; what is outside a picture stays outside."""

import numpy as np

from zbuf_occlude.drawing.marks import area_of_mark, frame_of, marks_of, paint

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


def test_x_goes_right_and_y_down() -> None:
    image = painted([[7.0, 1.0]], 1.0, [[0, 0, 0]])
    assert np.argwhere(image.sum(axis=-1) == 0).tolist() == [[1, 7]]


def test_later_marks_cover_earlier_ones() -> None:
    for colours in ([[1, 0, 0], [0, 0, 1]], [[0, 0, 1], [1, 0, 0]]):
        assert (painted([[4, 4], [4, 4]], 5.0, colours)[4, 4] == np.multiply(colours[1], 255)).all()


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
    middle, half = frame_of(square, None)
    assert (middle == 1).all()
    assert half == 2 * 0.53
    assert frame_of(square, 3.0)[1] == 3.0
    assert frame_of(np.empty((0, 2)), None)[1] == frame_of(np.zeros((1, 2)), None)[1] == 1.0
    many = np.random.default_rng(0).uniform(-1, 1, (1000, 2))
    assert np.isclose(area_of_mark(many, 1.0, 50.0) * len(many), 2500, rtol=0.01), "together they cover the square"
