"""Ranges of scans: uniform in range, or in area, by their closed forms."""

from functools import partial
from typing import Any

import numpy as np
import pytest

from zbuf_occlude import OptionError, views
from zbuf_occlude.sensors import make
from zbuf_occlude.sensors.capture import sensor_views
from zbuf_occlude.sensors.scan_config import ScanConfig

SENSOR = make("vlp-16")


def ranges(n: int, **given: Any) -> np.ndarray:
    seeds = partial(lambda what, view: np.random.SeedSequence([1, *what.encode(), view]))
    return np.sort(sensor_views(views.ring(n, elevation=0), 2.0, 0.0, ScanConfig(SENSOR, **given), seeds).distance)


@pytest.mark.parametrize(("span", "power"), [("5..50", 1), ("5..50@range", 1), ("5..50@area", 2)])
def test_ranges_have_the_distribution_of_their_law(span: str, power: int) -> None:
    """Kolmogorov's and Smirnov's distance from (r^p - A^p) / (B^p - A^p); above 2.23 in one of 10,000 samples."""
    drawn = ranges(4_000, range=span)
    expected, steps = (drawn**power - 5.0**power) / (50.0**power - 5.0**power), np.arange(4_000) / 4_000
    distance = max((steps + 1 / 4_000 - expected).max(), (expected - steps).max())
    assert distance * np.sqrt(4_000) < 2.23
    median = 27.5 if power == 1 else np.sqrt((25 + 2500) / 2)
    assert abs(np.median(drawn) - median) < 2.0


def test_a_law_is_text_or_a_field() -> None:
    text, field = ScanConfig(SENSOR, range="5..50@area"), ScanConfig(SENSOR, range=(5, 50), range_law="area")
    assert (text.range, text.range_law) == (field.range, field.range_law) == ((5.0, 50.0), "area")
    assert ScanConfig.from_dict(text.to_dict()).to_dict() == text.to_dict()
    assert ScanConfig(SENSOR, range=7).range_law == "range"
    with pytest.raises(OptionError, match=r"range law must be one of range, area; got 'disc'"):
        ScanConfig(SENSOR, range="5..50@disc")


def test_an_area_of_one_range_is_that_range() -> None:
    assert np.allclose(ranges(3, range="7@area"), 7.0)
