"""Scans on the fly: a transform that makes another scan of a mesh each time, by a sensor, alone or in a scene."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import torch
from torch.utils.data import get_worker_info

from zbuf_occlude.dataset.clouds import draw, fit
from zbuf_occlude.errors import ArgumentError, MeshError, check_int, check_word
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.jit.threads import use_threads
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.scenes.contents import Pool
from zbuf_occlude.sensors import make
from zbuf_occlude.sensors.capture import captures, in_metres, sensor_places
from zbuf_occlude.sensors.scanning import default_caster
from zbuf_occlude.sensors.setup import Setup
from zbuf_occlude.views import Views

ROUNDS = 8
"""So often another place is tried before a mesh is given up that no ray meets."""
SCALES = ("cloud", "mesh")


class OnTheFlyScan:
    """A mesh in, a scan of it out: another azimuth, range and scene each time.

    Parameters
    ----------
    n_points : int
        Points of each cloud; a scan of fewer repeats some.
    sensor : str
        As `zbuf_occlude.sensors.make` takes it.
    numbers : mapping, optional
        Of the sensor to be changed, such as ``{"noise": 0}``.
    surroundings : MeshCollection, optional
        What scenes are filled with; crates without it.
    scale : {"cloud", "mesh"}
        "cloud": centred, longest side 1; "mesh": metres about the middle of the object's box.
    **setup
        `range`, `size`, `scene`, `hidden`, `keep`, `sensor_height`, `method` of `zbuf_occlude.sensors.setup.Setup`.

    Raises
    ------
    OptionError
        A value out of range.
    ArgumentError
        `surroundings` that are no collection.

    Notes
    -----
    Called with a `Mesh` or a ``trimesh.Trimesh`` and its class, from which its size comes; returns an (n_points, 3)
    float32 tensor. Randomness comes from torch's default generator. In a worker one thread is used. A scene may hide
    all but a point of an object; `hidden` says how much it may hide.
    """

    def __init__(
        self,
        n_points: int = 1024,
        *,
        sensor: str = "vlp-32c",
        numbers: dict[str, Any] | None = None,
        surroundings: MeshCollection | None = None,
        scale: str = "cloud",
        **setup: Any,
    ) -> None:
        check_int("n_points", n_points, 1)
        check_word("scale", scale, SCALES)
        self.n_points, self.scale = n_points, scale
        given = {"method": default_caster(), "range": (5.0, 50.0), **setup}
        self.setup = Setup(make(sensor, **(numbers or {})).document, **given)
        if not isinstance(surroundings, MeshCollection | None):
            raise ArgumentError(
                f"surroundings must be a MeshCollection; got {type(surroundings).__name__}. "
                "Make one: MeshCollection.from_paths([folder])."
            )
        entries: Sequence[Any] = surroundings if surroundings is not None else ()
        self._pool = Pool(entries, self.setup.size, self.setup.scene, np.random.SeedSequence(0))

    def __repr__(self) -> str:
        return f"OnTheFlyScan({self.n_points}, {asdict(self.setup)['sensor']['name']}, scene={self.setup.scene})"

    def __call__(self, mesh: Any, label: str = "object") -> torch.Tensor:
        """Return a scan's points.

        Raises
        ------
        ArgumentError
            Not a mesh.
        MeshError
            No ray met it from any of some places.
        OptionError
            A class without a size.
        """
        if not (hasattr(mesh, "vertices") and hasattr(mesh, "faces")):
            raise ArgumentError(f"a mesh must have vertices and faces; got {type(mesh).__name__}. Keep the faces.")
        if not isinstance(mesh, Mesh):
            mesh = Mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces)).cleaned()
        if get_worker_info() is not None:
            use_threads(1)
        standing, size = in_metres(mesh, label, self.setup)
        floor = float(standing.bounds[0, 2])
        for _ in range(ROUNDS):
            rng = np.random.default_rng(int(torch.randint(2**62, ())))
            views = Views(rng.uniform(0.0, 2.0 * np.pi, 1), np.zeros(1), np.array([4.0]))
            seeds = _Seeds(int(rng.integers(2**62)))
            places = sensor_places(views, size, floor, self.setup, seeds)
            (capture,) = captures(standing, self.setup, places, floor, seeds, self._pool)
            seen = np.arange(len(capture.scan))
            if len(seen):
                positions = capture.scan.positions[draw(seen, self.n_points, rng)]
                if self.scale == "cloud":
                    centre, factor = fit(positions)
                    positions = (positions - centre) * factor
                return torch.from_numpy(positions.astype(np.float32))
        raise MeshError(f"a mesh must be met by a ray; none met {mesh.name} from {ROUNDS} places. Lower the range.")


class _Seeds:
    """Seeds of one scan's draws, from one number."""

    def __init__(self, seed: int) -> None:
        self._seed = seed

    def __call__(self, what: str, view: int) -> np.random.SeedSequence:
        return np.random.SeedSequence([self._seed, *what.encode(), view])
