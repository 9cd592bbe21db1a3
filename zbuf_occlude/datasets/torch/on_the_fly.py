"""Clouds of meshes on the fly: transforms that make another one each time, so that no dataset is stored."""

import copy
import os
from collections import OrderedDict
from collections.abc import Hashable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.utils.data import get_worker_info

from zbuf_occlude.base.arrays import BoolArray, FloatArray, as_number
from zbuf_occlude.base.errors import (
    ArgumentError,
    MeshError,
    OptionError,
    check_choice,
    check_fraction,
    check_int,
    shown,
)
from zbuf_occlude.base.jit.threads import use_threads
from zbuf_occlude.datasets.pipeline import count_distinct, why_no_cloud
from zbuf_occlude.datasets.plan import ATTRIBUTES
from zbuf_occlude.datasets.records import colors_of, draw_points
from zbuf_occlude.datasets.torch.placing import CloudFrame, Drawn, RandomViews, Span
from zbuf_occlude.datasets.torch.tensors import TensorMesh, is_dense, is_followed, place_of
from zbuf_occlude.geometry.colors import of_trimesh
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.meshes.sampling import SurfacePoints, sample_surface
from zbuf_occlude.sensors import Sensor, make
from zbuf_occlude.sensors.capture import captures, in_metres, sensor_views
from zbuf_occlude.sensors.scan_config import ScanConfig
from zbuf_occlude.sensors.scenes.contents import Pool
from zbuf_occlude.views import PAPER_DISTANCE, Views
from zbuf_occlude.visibility import find_method, prepare
from zbuf_occlude.visibility.interface import CONTACT

BYTES_PER_FACE = 1000
"""Approximate memory of a prepared mesh, bytes per face."""
ROUNDS = 8
"""Maximum number of rounds that sample more points, or try another eye, before visible points are repeated."""
TRIED_POINTS, TRIED_EYES = 256, 16
"""Number of eyes by which the sample count is estimated, so that three of four eyes see enough points."""


class OnTheFlyOcclusion:
    """Transform of a mesh into the cloud that a random eye sees, another eye each time.

    Parameters
    ----------
    n_points : int
        Points of each cloud.
    distance : float
        Distance of the eye from the mesh's centre, in longest sides.
    elevation : (float, float), float or str
        The eye is anywhere on the sphere between these elevations, degrees, uniformly by area; or at this elevation.
    views : Views or str, optional
        Views of which the eye is one, instead of a random one, such as ``"fibonacci:24"``; distances in longest sides.
    method : str, optional
        Method that needs no GL. Default: "exact", or with a device "warp".
    method_options : mapping, optional
    scale : {"cloud", "metres", "mesh"}
        As in `zbuf_occlude.datasets.plan.DatasetConfig`.
    frame : {"object", "camera"}
        Frame of positions and normals.
    axes : {"opengl", "opencv"}
        Axes of the camera: x right, y up, looking along -z; or x right, y down, looking along z.
    eyes_per_sampling : int
        Number of clouds, each of another eye, that share one sampling of the mesh's surface. 1: every cloud has points
        of its own.
    attributes : sequence of str
        "normals", of the faces and turned towards the eye, "colors" in [0, 1]: further columns of each cloud, in this
        order.
    cache_megabytes : float
        Maximum memory of prepared meshes in each worker; beyond it, the least recently used are dropped.
    device : str or torch.device, optional
        Device, such as "cuda", on which points are sampled, tested by `warp` and drawn, and on which clouds stay (extra
        ``warp``; untested on CUDA).

    Raises
    ------
    ArgumentError
        A value of another type, or a number out of range.
    OptionError
        An unknown word; a method that needs GL; with a device, another method than `warp`, or colours.
    UnavailableError
        A device without Warp.

    Notes
    -----
    Called with a `Mesh`, with a ``trimesh.Trimesh``, or with anything that has ``pos`` (v, 3) and ``face`` (3, f) such
    as a PyTorch Geometric ``Data``. Of the first two it returns an (n_points, 3, 6 or 9) float32 tensor; of the last a
    shallow copy whose ``pos`` are the positions and whose ``face`` is None, as PyTorch Geometric's own sampling
    transforms do, and whose ``normal`` and ``color`` are the attributes asked for. Colours are those of a `Mesh` that
    was loaded with them, or of a Trimesh's visual; else grey.

    Meshes are recognised by their content. A mesh met for the first time is cleaned and prepared, which costs several
    times what a cloud does. Randomness comes from torch's default generator: the same seed gives the same clouds in a
    new process; within one with ``eyes_per_sampling=1`` only, as clouds that are drawn already come first. In a worker,
    forked or spawned, one thread is used: the other cores belong to the other workers.

    With a device, tensors there (``pos``, ``face``) are recognised by their memory, as `visible` does it, and are not
    copied. Nothing waits for the device but the first call with a mesh. An eye that sees fewer than `n_points` of the
    sampled points repeats some. An eye that sees none has the cloud of another eye. The cloud is NaN where no eye sees
    a point.
    """

    def __init__(
        self,
        n_points: int = 1024,
        *,
        distance: float = PAPER_DISTANCE,
        elevation: Span = (-90.0, 90.0),
        views: Views | str | None = None,
        method: str | None = None,
        method_options: Mapping[str, Any] | None = None,
        scale: str = "cloud",
        frame: str = "object",
        axes: str = "opengl",
        eyes_per_sampling: int = 8,
        attributes: Sequence[str] = (),
        cache_megabytes: float = 500.0,
        device: str | torch.device | None = None,
    ) -> None:
        check_int("n_points", n_points, 1)
        check_int("eyes_per_sampling", eyes_per_sampling, 1)
        cache_megabytes = as_number(cache_megabytes, "cache_megabytes", "a number from 0", lambda number: number >= 0.0)
        self.views = RandomViews.of_arguments(elevation, distance, views)
        self.placement = CloudFrame(scale, frame, axes)
        if not isinstance(attributes, Sequence) or isinstance(attributes, str):
            raise ArgumentError(f"attributes must be a sequence of words; got {shown(attributes)}.")
        for name in attributes:
            check_choice("attribute", name, ATTRIBUTES)
        if not isinstance(method_options, Mapping | None):
            raise ArgumentError(f"method_options must be a mapping; got {shown(method_options)}.")
        self.attributes = tuple(name for name in ATTRIBUTES if name in attributes)
        self.device = None if device is None else _found(device)
        method = ("exact" if device is None else "warp") if method is None else method
        if device is not None:
            _check_on_device(method, attributes, frame, views)
            if "device" in (method_options or {}):
                raise OptionError(f"device must be said once; got {device!r} and method_options {method_options!r}.")
        if find_method(method).needs_gl:
            raise OptionError(f"method must need no GL to run in DataLoader workers; {method!r} does. Take 'exact'.")
        find_method(method).check_options(dict(method_options or {}))
        if device is not None:
            check_fraction("contact", (method_options or {}).get("contact", CONTACT))
        self.n_points, self.method, self.method_options = n_points, method, dict(method_options or {})
        self.eyes_per_sampling, self.cache_megabytes = eyes_per_sampling, cache_megabytes
        self._subjects: OrderedDict[Hashable, _Subject] = OrderedDict()
        self._process = -1

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_subjects": OrderedDict()}  # another process prepares its own

    def __call__(self, mesh: Any) -> Any:
        """Return the cloud that another eye sees of the mesh.

        Raises
        ------
        ArgumentError
            Not a mesh; one too far from the origin for float32, with scale "mesh".
        MeshError
            The mesh has no face of any area, or nothing of it was seen from any eye.
        """
        cloud = self._next(mesh)
        if isinstance(cloud, Drawn):
            placed = self.placement.place(cloud, has_normals="normals" in self.attributes)
            cloud = torch.from_numpy(placed.astype(np.float32))
        if not _is_data(mesh):
            return cloud
        data = copy.copy(mesh)
        data.pos, data.face = cloud[:, :3], None
        for column, name in enumerate(self.attributes, 1):
            setattr(data, name.removesuffix("s"), cloud[:, 3 * column : 3 * column + 3])
        return data

    def draw(self, mesh: Any, label: str = "") -> Drawn:
        """Return the cloud that another eye sees, before it is placed; not on a device. `label` is not needed."""
        return self._next(mesh)

    def _next(self, mesh: Any) -> Any:
        """Return the next cloud of a mesh: `Drawn`, or on a device a tensor."""
        vertices, faces = self._geometry(mesh)
        if self._process != os.getpid():
            self._process = os.getpid()
            for subject in self._subjects.values():
                subject.forget_clouds()  # drawn before a fork, so the sibling processes have them too
            if get_worker_info() is not None:
                use_threads(1)
        return self._subject(vertices, faces, mesh).next_cloud(self)

    def _geometry(self, mesh: Any) -> tuple[Any, Any]:
        """Return vertices (v, 3) and faces (f, 3) of a mesh: tensors that are on the device, else arrays."""
        if _is_data(mesh):
            there = all(is_dense(each) and each.device == self.device for each in (mesh.pos, mesh.face))
            pos, face = (mesh.pos, mesh.face) if there else (_array(mesh.pos), _array(mesh.face))
            return pos, face.T
        if hasattr(mesh, "vertices") and hasattr(mesh, "faces"):
            return np.asarray(mesh.vertices), np.asarray(mesh.faces)
        raise ArgumentError(
            f"a mesh must have vertices and faces, or pos and face; got {type(mesh).__name__}. "
            "Keep the faces: apply this transform before any that samples points."
        )

    def _subject(self, vertices: Any, faces: Any, mesh: Any) -> "_Subject":
        colors = None
        if "colors" in self.attributes:
            colors = mesh.colors if isinstance(mesh, Mesh) else of_trimesh(mesh) if hasattr(mesh, "visual") else None
        key: Hashable
        if isinstance(vertices, torch.Tensor):
            tensors = vertices, faces
            if not all(map(is_followed, tensors)):
                return _DeviceSubject(vertices, faces, self)
            # the keys keep the memory alive, so that no other tensor reuses it
            key = tuple((t.untyped_storage(), place_of(t), t._version) for t in tensors)
        else:
            key = hash((vertices.tobytes(), faces.tobytes(), None if colors is None else colors.digest))
        if key not in self._subjects:
            if self.device is None:
                self._subjects[key] = _Subject(Mesh(vertices, faces, colors=colors).cleaned(), self)
            else:
                self._subjects[key] = _DeviceSubject(vertices, faces, self)
            while len(self._subjects) > 1 and sum(s.megabytes for s in self._subjects.values()) > self.cache_megabytes:
                self._subjects.popitem(last=False)[1].close()
        self._subjects.move_to_end(key)
        return self._subjects[key]


class _Subject:
    """A prepared mesh, with the clouds of it that are drawn already."""

    def __init__(self, mesh: Mesh, settings: OnTheFlyOcclusion) -> None:
        settings.placement.check(mesh)
        self.mesh = mesh
        self.occluder = prepare(mesh, settings.method, **settings.method_options)
        self.megabytes = len(mesh.faces) * BYTES_PER_FACE / 1e6
        self._clouds: list[Any] = []
        self._visible_fraction = self._try(settings)

    def next_cloud(self, settings: OnTheFlyOcclusion) -> Any:
        """Return what another eye sees, not placed yet."""
        for _ in range(ROUNDS):
            if not self._clouds:
                self._draw(settings)
            if self._clouds:
                return self._clouds.pop()
        raise MeshError(f"a mesh must be seen from somewhere; {self.mesh.name} was not from {ROUNDS} samplings.")

    def forget_clouds(self) -> None:
        """Drop the clouds that are drawn already."""
        self._clouds.clear()

    def close(self) -> None:
        """Release the query."""
        self.occluder.close()

    def _try(self, settings: OnTheFlyOcclusion) -> float:
        """Return about the share of its points that three eyes of four see; earlier draws do not matter."""
        points = sample_surface(self.mesh, n_points=TRIED_POINTS, seed=0)
        views = settings.views.draw(TRIED_EYES, 0).around(self.mesh.centre, self.mesh.longest_side)
        mask = self.occluder.visible(points, views.eyes) & views.in_frustum(points.positions)
        return float(np.clip(np.quantile(mask.mean(axis=1), 0.25), 0.02, 1.0))

    def _draw(self, settings: OnTheFlyOcclusion) -> None:
        rng = np.random.default_rng(int(torch.randint(2**62, ())))
        mesh, wanted = self.mesh, settings.n_points
        n_eyes = settings.eyes_per_sampling
        views = settings.views.draw(n_eyes, int(rng.integers(2**62))).around(mesh.centre, mesh.longest_side)
        eyes = views.eyes
        found: list[list[FloatArray]] = [[] for _ in eyes]
        counts, lacking = np.zeros(n_eyes, dtype=int), np.arange(n_eyes)
        n_sampled = int(1.15 * wanted / self._visible_fraction)
        for _ in range(ROUNDS):
            points = sample_surface(mesh, n_points=n_sampled, seed=rng)
            mask = self.occluder.visible(points, eyes[lacking])
            mask &= views.select(lacking).in_frustum(points.positions)  # of cameras of a file
            for eye, seen in zip(lacking, mask, strict=True):
                found[eye].append(_rows(points, seen, eyes[eye], settings.attributes))
            counts[lacking] += mask.sum(axis=1)
            lacking = np.flatnonzero(counts < wanted)
            if not len(lacking):
                break
        for parts, pose in zip(found, views.poses, strict=True):
            rows = np.concatenate(parts)
            if len(rows) >= min(2, wanted):  # centred and scaled, one point would be the origin
                self._clouds.append(Drawn(rows[draw_points(np.arange(len(rows)), wanted, rng)], pose, mesh))


class _DeviceSubject(_Subject):
    """The same on a device, of tensors or arrays (v, 3) and (f, 3); `next_cloud` returns a float32 tensor, scaled."""

    def __init__(self, vertices: Any, faces: Any, settings: OnTheFlyOcclusion) -> None:
        if not isinstance(vertices, torch.Tensor):
            mesh = Mesh(vertices, faces)
            vertices, faces = (torch.tensor(each, device=settings.device) for each in (mesh.vertices, mesh.faces))
        self._mesh = TensorMesh(vertices, faces)
        self.megabytes = len(faces) * BYTES_PER_FACE / 1e6
        a, b, c = self._mesh.corners.unbind(dim=1)
        normals = torch.linalg.cross(b - a, c - a)
        areas = torch.linalg.vector_norm(normals, dim=1)
        self._normals, self._areas = torch.nn.functional.normalize(normals, eps=0.0), areas.cumsum(dim=0)
        if not self._areas[-1] > 0.0:
            raise MeshError(f"a mesh must have faces of some area; none of these {len(areas)} has.")
        self._clouds = []
        points, own = self._sample(TRIED_POINTS)
        mask = self._mesh.visible(points, own, self._eyes(TRIED_EYES, settings), self._contact(settings))
        shares = mask.double().mean(dim=1)
        if not shares.any():
            raise MeshError(f"a mesh must be seen from somewhere; this one was not from {TRIED_EYES} places.")
        self._visible_fraction = max(float(shares.min()), 0.02)

    def close(self) -> None:
        """Do nothing: the tensors own all memory."""

    def _contact(self, settings: OnTheFlyOcclusion) -> float:
        return float(settings.method_options.get("contact", CONTACT))

    def _random(self, *shape: int) -> torch.Tensor:
        return torch.rand(shape, dtype=torch.float64, device=self._areas.device)

    def _sample(self, n: int) -> tuple[torch.Tensor, torch.Tensor]:
        """Return points uniform over the surface, (n, 3), and their faces, (n,) int32."""
        own = torch.searchsorted(self._areas, self._random(n) * self._areas[-1:], right=True)
        own = own.clamp(max=len(self._areas) - 1)
        along, across = self._random(n, 1).sqrt(), self._random(n, 1)
        a, b, c = self._mesh.corners.index_select(0, own).unbind(dim=1)
        return torch.lerp(a, torch.lerp(b, c, across), along), own.int()

    def _eyes(self, n: int, settings: OnTheFlyOcclusion) -> torch.Tensor:
        """Return places uniform over the sphere's band, (n, 3)."""
        low, high = np.sin(np.radians(settings.views.elevation))
        heights, azimuths = low + (high - low) * self._random(n), 2.0 * np.pi * self._random(n)
        flat = (1.0 - heights * heights).clamp(min=0.0).sqrt()
        units = torch.stack([flat * azimuths.cos(), flat * azimuths.sin(), heights], dim=1)
        lower, upper = self._mesh.bounds
        return (lower + upper) / 2.0 + settings.views.distance * (upper - lower).amax() * units

    def _draw(self, settings: OnTheFlyOcclusion) -> None:
        n = settings.n_points
        points, own = self._sample(int(1.15 * n / self._visible_fraction))
        eyes = self._eyes(settings.eyes_per_sampling, settings)
        mask = self._mesh.visible(points, own, eyes, self._contact(settings))
        counts = mask.sum(dim=1, keepdim=True)
        shuffled = self._random(*mask.shape).masked_fill_(~mask, 2.0).argsort(dim=1)  # the visible first
        rows = shuffled.gather(1, torch.arange(n, device=mask.device) % counts.clamp(min=1))
        most = counts.argmax().reshape(1)
        rows = torch.where(counts > 0, rows, rows.index_select(0, most))
        eyes = torch.where(counts > 0, eyes, eyes.index_select(0, most))
        clouds = points[rows]
        columns = [clouds]
        if "normals" in settings.attributes:
            normals = self._normals[own.long()][rows]
            towards = ((eyes[:, None] - clouds) * normals).sum(dim=-1, keepdim=True)
            columns.append(torch.where(towards < 0.0, -normals, normals))
        if settings.placement.scale != "mesh":
            low, high = clouds.amin(dim=1, keepdim=True), clouds.amax(dim=1, keepdim=True)
            columns[0] = clouds - (low + high) / 2.0
        if settings.placement.scale == "cloud":
            longest = (high - low).amax(dim=-1, keepdim=True)
            columns[0] = columns[0] / torch.where(longest > 0.0, longest, 1.0)
        drawn = torch.cat(columns, dim=-1).masked_fill(counts.amax() == 0, torch.nan)
        self._clouds = list(drawn.float().unbind(dim=0))


def _found(device: str | torch.device) -> torch.device:
    """Return a device with its number; raise OptionError where PyTorch has none."""
    try:
        return torch.empty(0, device=device).device
    except (AssertionError, RuntimeError) as error:
        said = str(error).partition("\n")[0].rstrip(".")
        raise OptionError(f"device must be one that PyTorch finds here; got {device!r}: {said}.") from None


def _check_on_device(method: str, attributes: Sequence[str], frame: str, views: Views | str | None) -> None:
    """Raise OptionError where these settings are not of clouds on a device."""
    for is_wrong, what in (
        (method != "warp", f"method 'warp'; got {method!r}"),
        ("colors" in attributes, "no colors"),
        (frame != "object", f"frame 'object'; got {frame!r}"),
        (views is not None, "no views"),
    ):
        if is_wrong:
            raise OptionError(f"OnTheFlyOcclusion on a device must have {what}. Leave the device out?")


def _rows(points: SurfacePoints, seen: BoolArray, eye: FloatArray, attributes: Sequence[str]) -> FloatArray:
    """Return the columns of what an eye sees."""
    if not attributes:
        return np.asarray(points.positions[seen])
    points = points.select(seen)
    columns = [points.positions]
    if "normals" in attributes:
        columns.append(points.normals_towards(eye))
    if "colors" in attributes:
        columns.append(colors_of(points) / 255.0)
    return np.concatenate(columns, axis=1)


def _is_data(mesh: Any) -> bool:
    """Return True for a mesh that has `pos` and `face`, as PyTorch Geometric's."""
    return hasattr(mesh, "pos") and hasattr(mesh, "face")


def _array(values: Any) -> NDArray[Any]:
    """A tensor's values, wherever it is, or an array's."""
    if isinstance(values, torch.Tensor) and not is_dense(values):
        raise ArgumentError("pos and face must be dense tensors or arrays; got one that is sparse or nested.")
    return values.detach().cpu().numpy() if isinstance(values, torch.Tensor) else np.asarray(values)


class OnTheFlyScan:
    """Transform of a mesh into a scan, with another view, range and scene each time.

    Parameters
    ----------
    n_points : int
        Points of each cloud; a scan of fewer repeats some.
    sensor : str, Path or Sensor
        As `zbuf_occlude.sensors.make` takes it.
    numbers : mapping, optional
        Numbers of the sensor to change, such as ``{"noise": 0}``.
    surroundings : MeshCollection, optional
        Objects that fill scenes; built-in road users or furniture by default.
    elevation : (float, float), float or str
        Elevation of the sensor above the object's middle, degrees: uniform over the sphere between two, or one. Over a
        ground a LiDAR's follows from its height.
    views : Views or str, optional
        Instead of random azimuths and elevations: the sensor is at one of these views, such as ``"ring:8@20"``, or
        ``"drive:1"`` for road users; with ``range=None`` at their own distances, in longest sides.
    scale : {"cloud", "metres", "mesh"}
        "cloud": centred, longest side 1; "metres": centred, in metres; "mesh": metres about the middle of the object's
        box.
    frame : {"object", "camera"}
        Frame of the positions; the camera looks at the object.
    axes : {"opengl", "opencv"}
        Axes of the camera: x right, y up, looking along -z; or x right, y down, looking along z.
    **config
        `range`, `range_law`, `size`, `scene`, `hidden`, `keep`, `sensor_height`, `transparent`, `method` and
        `least_points` of `zbuf_occlude.sensors.scan_config.ScanConfig`.

    Raises
    ------
    OptionError
        A value out of range.
    ArgumentError
        `surroundings` that are no collection.

    Notes
    -----
    Called with a `Mesh` or a ``trimesh.Trimesh`` and its class, from which its size comes; returns an (n_points, 3)
    float32 tensor. Randomness comes from torch's default generator. In a worker one thread is used. A place from
    which a scan has fewer than `least_points` distinct points gives way to another one.
    """

    def __init__(
        self,
        n_points: int = 1024,
        *,
        sensor: str | Path | Sensor = "vlp-32c",
        numbers: dict[str, Any] | None = None,
        surroundings: MeshCollection | None = None,
        elevation: Span = 0.0,
        views: Views | str | None = None,
        scale: str = "cloud",
        frame: str = "object",
        axes: str = "opengl",
        **config: Any,
    ) -> None:
        check_int("n_points", n_points, 1)
        self.views = RandomViews.of_arguments(elevation, PAPER_DISTANCE, views)
        self.placement = CloudFrame(scale, frame, axes)
        if not isinstance(numbers, Mapping | None):
            raise ArgumentError(f"numbers must be a mapping; got {shown(numbers)}.")
        self.n_points = n_points
        given = {"range": (5.0, 50.0), **config}
        self.config = ScanConfig(make(sensor, **(numbers or {})), **given)
        if not isinstance(surroundings, MeshCollection | None):
            raise ArgumentError(
                f"surroundings must be a MeshCollection; got {type(surroundings).__name__}. "
                "Make one: MeshCollection.from_paths([folder])."
            )
        entries: Sequence[Any] = surroundings if surroundings is not None else ()
        self._pool = Pool(entries, self.config.size, self.config.scene, np.random.SeedSequence(0))

    def __repr__(self) -> str:
        return f"OnTheFlyScan({self.n_points}, {self.config.sensor.name}, scene={self.config.scene})"

    def __call__(self, mesh: Any, label: str = "object") -> torch.Tensor:
        """Return a scan's points.

        Raises
        ------
        ArgumentError, MeshError, OptionError
            As `draw`.
        """
        return torch.from_numpy(self.placement.place(self.draw(mesh, label)).astype(np.float32))

    def draw(self, mesh: Any, label: str = "object") -> Drawn:
        """Return a scan's points before they are placed.

        Raises
        ------
        ArgumentError
            Not a mesh.
        MeshError
            No ray met it from any of some places, or it lets all light pass.
        OptionError
            A class without a size.
        """
        if not (hasattr(mesh, "vertices") and hasattr(mesh, "faces")):
            raise ArgumentError(f"a mesh must have vertices and faces; got {type(mesh).__name__}. Keep the faces.")
        if not isinstance(mesh, Mesh):
            mesh = Mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces)).cleaned()
        if get_worker_info() is not None:
            use_threads(1)
        try:
            standing, size = in_metres(mesh, label, self.config)
        except OptionError:  # its message names the options of the command line
            raise OptionError(
                f"every class must have a size in metres; {label!r} has none. Give OnTheFlyScan "
                f"size={{{label!r}: METRES}}, or size=METRES for all, or size='file' where meshes are in metres."
            ) from None
        if standing.colors is not None and (standing.colors.transmittance == 1.0).all():
            raise MeshError(
                f"a mesh must send some light back to be scanned; every material of {mesh.name} lets all light pass. "
                "Give one a share below 1 in transparent."
            )
        floor = float(standing.bounds[0, 2])
        for _ in range(ROUNDS):
            rng = np.random.default_rng(int(torch.randint(2**62, ())))
            views = self.views.draw(1, int(rng.integers(2**62)))
            seeds = partial(_seed, int(rng.integers(2**62)))
            places = sensor_views(views, size, floor, self.config, seeds)
            (capture,) = captures(standing, self.config, places, floor, seeds, self._pool)
            seen = np.arange(len(capture.scan))
            n_distinct = count_distinct(capture.scan.positions, self.config.least_points)
            if n_distinct >= max(2, self.config.least_points):  # centred and scaled, one place would be the origin
                positions = capture.scan.positions[draw_points(seen, self.n_points, rng)]
                return Drawn(positions, places.poses[0], standing)
        why = why_no_cloud(capture, self.config, places, 0, n_distinct)
        raise MeshError(
            f"a mesh must give a cloud; {mesh.name} did not from {ROUNDS} places: {why}. Choose another range."
        )


def _seed(number: int, what: str, view: int) -> np.random.SeedSequence:
    """Return the seed of one of a scan's draws."""
    return np.random.SeedSequence([number, *what.encode(), view])
