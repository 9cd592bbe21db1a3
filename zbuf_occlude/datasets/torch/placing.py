"""Placing of clouds made on the fly: the views that they are drawn from, and the frame and scale that they get."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from zbuf_occlude.base.arrays import FloatArray, as_number, float32_fault
from zbuf_occlude.base.errors import ArgumentError, OptionError, check_choice, shown
from zbuf_occlude.datasets.records import unit_box_transform
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.sensors.scan_config import span_of
from zbuf_occlude.views import Views
from zbuf_occlude.views import parse as parse_views
from zbuf_occlude.views import random as random_views
from zbuf_occlude.views.model import AXES, with_axes

SCALES, FRAMES = ("cloud", "metres", "mesh"), ("object", "camera")
Span = float | str | Sequence[float]
"""A number, or two as a pair or as ``A..B``."""


class Drawn(NamedTuple):
    """A cloud of a mesh before it is placed.

    `rows` (n, 3, 6 or 9) are positions, in the coordinates of `mesh`, and attributes; `pose` (4, 4) is the view matrix.
    """

    rows: FloatArray
    pose: FloatArray
    mesh: Mesh


@dataclass(frozen=True)
class CloudFrame:
    """The frame and the scale of clouds, as given by users and checked."""

    scale: str = "cloud"
    frame: str = "object"
    axes: str = "opengl"

    def __post_init__(self) -> None:
        check_choice("scale", self.scale, SCALES)
        check_choice("frame", self.frame, FRAMES)
        check_choice("axes", self.axes, AXES)
        if self.axes != "opengl" and self.frame != "camera":
            raise OptionError(f"axes {self.axes} must be of frame 'camera'; got frame {self.frame!r}.")

    def check(self, mesh: Mesh) -> None:
        """Raise ArgumentError where float32 cannot hold clouds of a mesh in this frame and scale."""
        if self.scale == "mesh" and self.frame == "object" and (reason := float32_fault(mesh.bounds)):
            raise ArgumentError(
                f"points in the unit of the mesh must suit float32; their {reason}. Take scale='cloud'."
            )

    def place(self, cloud: Drawn, *, has_normals: bool = False) -> FloatArray:
        """Return the rows of a cloud in this frame and scale."""
        rows, pose = np.array(cloud.rows), with_axes(cloud.pose, self.axes)
        if self.frame == "camera":
            rows[:, :3] = rows[:, :3] @ pose[:3, :3].T + pose[:3, 3]
            if has_normals:
                rows[:, 3:6] = rows[:, 3:6] @ pose[:3, :3].T
        if self.scale != "mesh":
            centre, factor = unit_box_transform(rows[:, :3])
            rows[:, :3] = (rows[:, :3] - centre) * (factor if self.scale == "cloud" else 1.0)
        return rows

    def place_pair(self, cloud: Drawn, complete: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return a cloud and the complete one (m, 3) of its mesh in one frame, and the pose of `CompletionPairs`."""
        pose, centre, factor = with_axes(cloud.pose, self.axes), np.zeros(3), 1.0
        if self.scale == "cloud":  # a pair is placed by its whole object
            centre, factor = cloud.mesh.centre, 1.0 / cloud.mesh.longest_side
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = pose[:3, :3], (pose[:3, 3] + pose[:3, :3] @ centre) * factor
        pair = [(positions - centre) * factor for positions in (cloud.rows[:, :3], complete)]
        if self.frame == "camera":
            shift = np.zeros(3) if self.scale == "cloud" else matrix[:3, 3]
            pair = [positions @ pose[:3, :3].T + shift for positions in pair]
        return pair[0], pair[1], matrix


@dataclass(frozen=True)
class RandomViews:
    """Views of which one is drawn at random each time, distances in longest sides of the object.

    Parameters
    ----------
    elevation : (float, float)
        Degrees; the views are uniform over the sphere between these two.
    distance : float
    given : Views or str, optional
        Views of which one is chosen instead; random views of a specification are drawn again each time.
    """

    elevation: tuple[float, float]
    distance: float
    given: Views | str | None = None

    @classmethod
    def of_arguments(cls, elevation: Span, distance: float, views: Any) -> "RandomViews":
        """Check arguments: `views` are a specification of `zbuf_occlude.views.parse`, Views, or None."""
        distance = as_number(distance, "distance", "a positive number", lambda number: number > 0.0)
        if not isinstance(views, Views | str | None):
            raise ArgumentError(f"views must be Views or a specification, such as 'fibonacci:24'; got {shown(views)}.")
        found = cls(span_of("elevation", elevation), distance, views)
        found.draw(1, 0)  # for its error
        return found

    def draw(self, n_views: int, seed: int) -> Views:
        """Return some views about the origin."""
        if self.given is None:
            return random_views(n_views, elevation=self.elevation, distance=self.distance, seed=seed)
        views = self.given
        if isinstance(views, str):
            views = parse_views(views, distance=self.distance, seed=seed)
        return views.select(np.random.default_rng(seed).integers(len(views), size=n_views))
