"""Models of labelled boxes: the built-in road user that fills a box of a real drive."""

import zlib
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.base.errors import DatasetError
from zbuf_occlude.datasets.real.sweeps import LabelledBox
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.shapes import ROAD_USERS, road_user, traffic
from zbuf_occlude.meshes.shapes.road_users import RIDDEN_FROM
from zbuf_occlude.sensors.scenes.kinds import box_mesh, pole_mesh
from zbuf_occlude.sensors.scenes.scene import Placed, moved, upright_pose

KINDS = (
    *(("signaler", "pedestrian"), ("sign", "pole"), ("rack", "box"), ("pedestrian", "pedestrian")),
    *(("person", "pedestrian"), ("wheeled_rider", "pedestrian")),
    *(("motorcycl", "motorcycle"), ("cycl", "bicycle"), ("bus", "bus"), ("tram", "bus"), ("railed", "bus")),
    *(("trailer", "trailer"), ("large_vehicle", "bus"), ("truck_cab", "tractor"), ("truck", "truck")),
    *(("construction_veh", "truck"), ("vehicle.construction", "truck")),
    *(("car", "car"), ("van", "car"), ("vehicle", "car"), ("cone", "pole"), ("bollard", "pole"), ("pole", "pole")),
)
"""Kinds of models by words in labels: the first word that a label contains counts; without any it is a box."""
MODELS = 5
"""Built-in road users that fill a box in turn: what a labelled object is like in its box is not known."""
LIKELY = 40
"""Members among which the `MODELS` of a person are found, by the proportions of the box."""


@dataclass(frozen=True, eq=False)
class UprightBox:
    """A labelled box that stands upright, metres, in the frame of the sweep."""

    label: str
    sides: FloatArray  # (3,), length, width, height
    centre: FloatArray  # (3,)
    yaw: float  # radians
    n_points: int | None  # returns in it as the makers of the log counted them
    identity: int  # the same of the same object in all sweeps

    def is_inside(self, points: FloatArray, slack: float = 0.0) -> BoolArray:
        """Return which points (n, 3) are in the box, made wider by `slack` to each side and moved up by as much."""
        local = (points - self.centre) @ upright_pose(self.yaw)[:3, :3] - [0.0, 0.0, slack]
        return np.asarray((np.abs(local) <= self.sides / 2 + [slack, slack, 0.0]).all(axis=1))


def upright(box: LabelledBox, sweep: str, number: int) -> UprightBox:
    """Return a labelled box without its tilt; `number` is its place in its sweep, and names it without a track.

    Raises
    ------
    DatasetError
        A side is not above 0.
    """
    if not min(box.size) > 0.0:
        said = ", ".join(f"{side:g}" for side in box.size)
        raise DatasetError(f"sides of a box must be above 0; one of {box.label} in sweep {sweep} has {said}.")
    ahead = box.rotation[:, 0]
    identity = zlib.crc32((box.track or f"{(sweep, number)}").encode())
    return UprightBox(box.label, box.size, box.centre, float(np.arctan2(ahead[1], ahead[0])), box.n_points, identity)


def kind_of(label: str) -> str:
    """Return the kind of model that fills the boxes of a label."""
    return next((kind for word, kind in KINDS if word in label.lower()), "box")


def filled(given: UprightBox, number: int) -> Placed:
    """Return one of the `MODELS` as large as a box, at its place."""
    kind, sides = kind_of(given.label), given.sides[[1, 0, 2]]
    pose = moved(yaw=np.degrees(given.yaw) + 90.0, to=given.centre - [0.0, 0.0, sides[2] / 2])  # built-in ones face -y
    member = "van" if "van" in given.label.lower() else kind
    if kind in ("pedestrian", "bicycle") and given.sides[2] >= RIDDEN_FROM:
        mesh = _person("cyclist" if kind == "bicycle" else kind, tuple(sides), number)
    elif kind in ("car", "bus"):
        mesh = _stretched(traffic.make(member, (given.identity + number) % 1000), sides)
    elif kind in ROAD_USERS:
        mesh = road_user(kind, given.sides)
    else:
        mesh = _stretched(pole_mesh(0.5, 1.0) if kind == "pole" else box_mesh(1.0, 1.0, 1.0), sides)
    return Placed(mesh, given.label, pose)


def _stretched(mesh: Mesh, sides: FloatArray) -> Mesh:
    """Return a mesh as wide, long and high as `sides`, on z = 0."""
    mesh = mesh.transformed(1.0, -mesh.centre)
    scale = sides / np.ptp(mesh.bounds, axis=0)
    return replace(mesh, vertices=mesh.vertices * scale + [0.0, 0.0, sides[2] / 2])


@lru_cache(2)
def _proportions(label: str) -> FloatArray:
    """Return width and length over height of `LIKELY` members, (n, 2)."""
    sides = np.array([np.ptp(traffic.make(label, i).bounds, axis=0) for i in range(LIKELY)])
    return np.asarray(sides[:, :2] / sides[:, 2:])


@lru_cache(256)
def _person(label: str, sides: tuple[float, float, float], number: int) -> Mesh:
    """Return the member whose proportions are the `number`-th most like a box's, as high as the box."""
    away = np.linalg.norm(np.log(_proportions(label) / (np.array(sides[:2]) / sides[2])), axis=1)
    mesh = traffic.make(label, int(np.argsort(away)[number]))
    return mesh.transformed(sides[2] / float(np.ptp(mesh.bounds, axis=0)[2]))
