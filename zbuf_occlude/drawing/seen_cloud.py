"""The cloud that a camera or sensor sees of a mesh while it moves: prepared once, asked at each move."""

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.geometry.cloud import Cloud
from zbuf_occlude.geometry.colors import Bytes
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import SurfacePoints, sample_surface
from zbuf_occlude.sensors import Sensor, scan
from zbuf_occlude.visibility import prepare

METHOD, SEED = "exact", 0


@dataclass(frozen=True, eq=False)
class SurfaceCloud(Cloud):
    """Points (n, 3) sampled on a surface, with unit normals (n, 3) turned towards a camera."""

    points: FloatArray
    normals: FloatArray
    colors: Bytes | None = None


class SeenCloud(NamedTuple):
    """The answer at one pose.

    cloud : Cloud, the visible points of the surface, or the returns of a sensor
    hidden : (m, 3) float, the sampled points that are not visible from the pose's position
    n_sampled : int, the number of points sampled on the surface
    """

    cloud: Cloud
    hidden: FloatArray
    n_sampled: int


class MovingCamera:
    """A mesh before a camera or sensor that moves. Use it as a context manager, or call `close`.

    Parameters
    ----------
    mesh : Mesh
        In metres, if a sensor is to see it.

    Raises
    ------
    MeshError
        As `prepare`.
    """

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self._query = prepare(mesh, METHOD, warn=False)
        self._samples: SurfacePoints | None = None

    def see(
        self, pose: FloatArray, n_points: int, sensor: Sensor | None = None, *, has_noise: bool = True
    ) -> SeenCloud:
        """Return the cloud at one pose.

        Parameters
        ----------
        pose : (4, 4) float
            Transform from the sensor's frame (x forward, y left, z up) to the mesh's coordinates, as of `look_at`.
            Without a sensor only the position counts: the camera sees in all directions.
        n_points : int
            Number of points sampled on the surface: the same ones at every pose.
        sensor : Sensor, optional
            The cloud is then this sensor's scan.
        has_noise : bool
            False: without the noise and losses of the sensor (``noise=0``).

        Raises
        ------
        ArgumentError
            A position too far from the mesh, or a pose that is no rigid transform.
        MeshError
            The mesh has no area.
        """
        if self._samples is None or len(self._samples) != n_points:
            self._samples = sample_surface(self.mesh, n_points=n_points, seed=SEED)
        samples, eye = self._samples, pose[:3, 3]
        mask = self._query.visible(samples, eye)
        hidden = samples.positions[~mask]
        if sensor is None:
            seen = samples.select(mask)
            return SeenCloud(SurfaceCloud(seen.positions, seen.normals_towards(eye)), hidden, n_points)
        model = sensor if has_noise else _without_noise(sensor)
        returns = scan(self.mesh, model, pose, seed=SEED, method=METHOD, occluder=self._query, towards=self.mesh.bounds)
        return SeenCloud(returns, hidden, n_points)

    def close(self) -> None:
        """Release the prepared mesh."""
        self._query.close()

    def __enter__(self) -> "MovingCamera":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


@cache  # a copy would compute its rays again at every move
def _without_noise(sensor: Sensor) -> Sensor:
    return sensor.with_numbers(noise=0.0)


def spacing(mesh: Mesh, n_points: int) -> float:
    """Return the mean distance of neighbouring points of a sample, in the mesh's unit."""
    return float(np.sqrt(mesh.areas.sum() / n_points))
