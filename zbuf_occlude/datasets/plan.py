"""The plan of a dataset: meshes x views x variations, and the file and row of every cloud before it is made.

The meshes of each split are permuted at random and dealt to shards. A *shard* is a set of whole meshes and the final
files of their clouds. A worker makes a shard at a time, and machines share shards. The clouds of a shard are permuted
at random. A view that sees nothing, or a mesh that fails, leaves its rows empty and moves no other cloud. The same
input therefore gives the same plan, and the same plan the same files.
"""

import hashlib
import json
import math
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache, partial
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import MeshError, OptionError, UnavailableError, check_choice
from zbuf_occlude.base.extras import missing
from zbuf_occlude.base.provenance import seed_of
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.collection import SPLITS, MeshCollection, MeshEntry
from zbuf_occlude.meshes.sampling import MAX_POINTS
from zbuf_occlude.sensors.scan_config import ScanConfig
from zbuf_occlude.sensors.scenes.contents import Pool, surroundings
from zbuf_occlude.views import PAPER_DISTANCE, Views, is_random
from zbuf_occlude.views import parse as parse_views
from zbuf_occlude.views.model import AXES, with_axes

Numbers = NDArray[np.intp]

SCALES = ("cloud", "object", "metres", "mesh")
FRAMES = ("object", "z-up", "camera")
SUBSETS = ("random", "fps")
ATTRIBUTES = ("normals", "colors")
"""Attributes that points may have besides their positions."""
BOXES = "boxes"
"""Attribute of scans: the boxes of objects in the picture of a car's camera (`zbuf_occlude.sensors.boxes`)."""
MAX_SAMPLE_SIZE = 100_000_000
"""Maximum number of points of a cloud; NumPy's records end at 2 GB."""
DATA_VERSION = 1
"""Version of the data. It is raised whenever the same plan gives other files than before."""
CLOUDS_PER_FILE, FILES_PER_SHARD = 2048, 4
"""Maximum number of clouds of a file, and of full files of a shard."""
MIN_SHARDS, MIN_PER_SHARD = 64, 256
"""Minimum number of shards of a dataset, unless its shards would have fewer clouds than the second number."""
SHARD_BYTES = 512 * 2**20
"""Maximum estimated size of a shard, which is made in memory."""
POINT_BYTES, RETURN_BYTES = 32, 80
"""Estimated bytes of a point on a surface, and of a return of a sensor, with all their fields."""
WHOLE_POINT_BYTES, ATTRIBUTE_BYTES, WHOLE_RETURN_BYTES = 10, {"normals": 12, "colors": 3}, 104
"""Bytes of a point, of its attributes and of a return where whole objects are kept (`zbuf_occlude.datasets.packed`)."""
AREA = 6.0
"""Estimated area of an object whose longest side is 1: that of a cube."""
PAIRS_CHECKED = 37_000
"""Number of pairs of view and point of a dataset that are checked by the oracle. If none of these is wrong, fewer than
0.01 % of all are, with 95 % confidence (`datasets/counts.py`)."""

MODELNET40 = (
    "airplane", "bathtub", "bed", "bench", "bookshelf", "bottle", "bowl", "car", "chair", "cone", "cup", "curtain",
    "desk", "door", "dresser", "flower_pot", "glass_box", "guitar", "keyboard", "lamp", "laptop", "mantel", "monitor",
    "night_stand", "person", "piano", "plant", "radio", "range_hood", "sink", "sofa", "stairs", "stool", "table",
    "tent", "toilet", "tv_stand", "vase", "wardrobe", "xbox",
)  # fmt: skip
"""Alphabetical; `shape_names.txt` of modelnet40_ply_hdf5_2048."""
SCANOBJECTNN = (
    "bag", "bin", "box", "cabinet", "chair", "desk", "display", "door", "shelf", "table", "bed", "pillow", "sink",
    "sofa", "toilet",
)  # fmt: skip
"""`training_data/shape_names_ext.txt` of hkust-vgd/scanobjectnn."""
MVP = (
    "airplane", "cabinet", "car", "chair", "lamp", "sofa", "table", "watercraft", "bed", "bench", "bookshelf", "bus",
    "guitar", "motorbike", "pistol", "skateboard",
)  # fmt: skip
"""`cat_name` in test.py of paul007pl/VRCNet."""
CLASSES_OF = {
    "modelnet40-c": MODELNET40,
    "modelnet-o": MODELNET40,
    "modelnet40-normal": MODELNET40,
    "scanobjectnn": SCANOBJECTNN,
    "mvp": MVP,
}
"""Published lists of classes of formats whose labels are indices into them; other formats number the classes given."""


@dataclass(frozen=True)
class DatasetConfig:
    """Settings that decide the numbers in a dataset, apart from the meshes.

    Parameters
    ----------
    method : str
        Name in the table of methods.
    method_options : mapping
        The method's own options.
    reason : str
        Reason for the method, where `auto` chose it.
    views : str
        A specification of `zbuf_occlude.views.parse`.
    distance : float
        Distance of the camera, in longest sides of the object (the paper's 4.1: 4).
    farthest : float or None
        Distances are drawn for each object and view, uniformly between `distance` and this one.
    n_points : int or None
        Points sampled on each object before HSR; exactly one of `n_points` and `density` is given.
    density : float or None
        Points per area, the object's longest side taken as 1 (the paper's Algorithm 1).
    variations : int
        Independent samplings of each object (the paper's 4.1: 10).
    sample_size : int or None
        Points of each cloud written; None: all visible ones, as many as there are.
    subset : str
        Choice of the visible points that are written: "random", or "fps", farthest-point sampling.
    scale : str
        "cloud": each cloud is centred and its longest side becomes 1 (paper 3.4); "object": all clouds of an object are
        moved and scaled alike, so that its box is centred and its longest side 1; "metres": each cloud is centred and
        keeps its size, in the unit of the mesh, which of scans is metres; "mesh": the object's own coordinates.
    frame : str
        "object": the mesh's axes, which a layout turns as its original has them; "z-up": they stay, z up, in every
        layout; "camera": the camera's frame, its axes by `axes`.
    axes : str
        Axes of the camera's frame: "opengl" (x right, y up, the camera looks along -z) or "opencv" (x right, y down, it
        looks along z).
    attributes : sequence of str
        Values of points besides their positions: "normals", of their faces, and "colors", of meshes loaded with them.
        Whole scans of level LiDARs may have "boxes", for the formats hdf5 and kitti.
    complete : bool
        Keep the hidden points too: clouds of whole surfaces, as the paper's original samples (4.3). No method is asked,
        and no sensor scans: with `scan` the whole object stands before the sensor, in metres.
    scan : ScanConfig or None
        A sensor's first hits instead of points on the surface.
    split : (float, float, float) or None
        Shares by which the meshes were divided into train, val and test (`MeshCollection.divided`), for the record.
        None: they have the collection's own splits.
    overlap : (float, float) or None
        Bounds of the overlap of two views, for the format pairs: the share of what one sees that the other sees too.
    depth_unit : float or None
        Metres per step of the depth images of frames and bop; None: the finest power of ten for each object or image.
    seed : int

    Raises
    ------
    OptionError
        A value out of range, or an unknown name.
    UnavailableError
        The attribute colors, without Pillow.
    """

    method: str = "depth_buffer"
    method_options: Mapping[str, Any] | None = None
    reason: str = ""
    views: str = "modelnet8"
    distance: float = PAPER_DISTANCE
    farthest: float | None = None
    n_points: int | None = 20_000
    density: float | None = None
    variations: int = 1
    sample_size: int | None = 2048
    subset: str = "random"
    scale: str = "cloud"
    frame: str = "object"
    axes: str = "opengl"
    attributes: Sequence[str] = ()
    complete: bool = False
    scan: ScanConfig | None = None
    split: Sequence[float] | None = None
    overlap: Sequence[float] | None = None
    depth_unit: float | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if (self.n_points is None) == (self.density is None):
            raise OptionError(f"give points or density, not both; got {self.n_points} and {self.density}.")
        for name, value, most in (
            ("points", self.n_points, MAX_POINTS),
            ("density", self.density, MAX_POINTS),
            ("variations", self.variations, MAX_POINTS),
            ("sample size", self.sample_size, MAX_SAMPLE_SIZE),
            ("distance", self.distance, np.finfo(np.float64).max),
            ("distance", self.farthest, np.finfo(np.float64).max),
        ):
            if value is not None and not value > 0:
                raise OptionError(f"{name} must be positive; got {value}.")
            if value is not None and value > most:
                raise OptionError(f"{name} must be at most {most:,}; got {value}.")
        check_choice("scale", self.scale, SCALES)
        check_choice("frame", self.frame, FRAMES)
        check_choice("axes", self.axes, AXES)
        if self.axes != "opengl" and self.frame != "camera":
            raise OptionError(f"axes {self.axes} must be of the camera's frame; got --frame {self.frame}. Give camera.")
        check_choice("subset", self.subset, SUBSETS)
        if self.subset == "fps" and self.sample_size is None:
            raise OptionError("subset fps must have a number of points to choose; got sample size all. Give a number.")
        for name in self.attributes:
            check_choice("attribute", name, (*ATTRIBUTES, BOXES))
        if BOXES in self.attributes:
            self._check_boxes()
        if "colors" in self.attributes and (lacking := missing("PIL")):
            raise UnavailableError(f"the attribute colors {lacking}")
        if self.overlap is not None and not 0.0 < self.overlap[0] <= self.overlap[1] <= 1.0:
            low, high = self.overlap
            raise OptionError(f"overlap must be shares above 0 and up to 1, A..B with A <= B; got {low:g}..{high:g}.")
        if self.depth_unit is not None and not 0.0 < self.depth_unit < np.inf:
            raise OptionError(f"--depth-unit must be metres above 0; got {self.depth_unit:g}.")
        if self.seed < 0:
            raise OptionError(f"seed must not be negative; got {self.seed}.")
        object.__setattr__(self, "method_options", dict(self.method_options or {}))
        object.__setattr__(self, "attributes", [name for name in (*ATTRIBUTES, BOXES) if name in self.attributes])

    def _check_boxes(self) -> None:
        if self.complete:
            raise OptionError(f"{BOXES} must be of scans; complete clouds are not scanned. Leave --complete out.")
        scan = self.scan
        if not (scan and scan.is_level and scan.keep == "all"):
            given = f"--sensor {scan.sensor.name} --scene {scan.scene} --keep {scan.keep}" if scan else "no --sensor"
            raise OptionError(
                f"{BOXES} must be of a spinning LiDAR over a ground whose whole scans are kept; got {given}. Give "
                "--sensor hdl-64e --scene street --keep all."
            )
        if scan.motion and not scan.motion.deskew:
            raise OptionError(f"{BOXES} of a sensor that moves must be where its points are. Give --deskew.")

    def make_views(self, key: str = "") -> Views:
        """Return the views of a mesh, distances in longest sides, about the origin; draws are by its key."""
        seed = seed_of(self.seed, key + "/views")
        return parse_views(self.views, distance=self.distance, seed=seed, farthest=self.farthest)

    def poses_of(self, views: Views) -> FloatArray:
        """Return the matrices (k, 4, 4) from world space to the cameras' frames, with its axes."""
        return with_axes(views.poses, self.axes)

    @property
    def equal_size(self) -> int:
        """Points of each cloud, where all have as many."""
        assert self.sample_size is not None  # formats that hold clouds of one size refuse others
        return self.sample_size

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain data."""
        scan = None if self.scan is None else self.scan.to_dict()
        return {each.name: getattr(self, each.name) for each in fields(self)} | {"scan": scan}

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> "DatasetConfig":
        """Return the configuration that `to_dict` described."""
        scan = None if document["scan"] is None else ScanConfig.from_dict(document["scan"])
        return cls(**{**document, "scan": scan})


class PlannedFile(NamedTuple):
    """File `number` of a split, with clouds of one shard."""

    shard: int
    split: str
    number: int


@dataclass(frozen=True, eq=False)
class Plan:
    """Meshes x views x variations, dealt to shards.

    Parameters
    ----------
    meshes : MeshCollection
        In the order in which they are worked on.
    config : DatasetConfig
    format : str
        Name of the format or layout of the files.
    views : Views, optional
        Distances in longest sides, about the origin; `config.make_views()` by default. Where each mesh has its own
        (`views_of`), these only give their number.
    version : int
        The version of the data.
    converted_from : mapping or None
        Format and fingerprint of the dataset whose clouds are converted to the format, where they are.
    """

    meshes: MeshCollection
    config: DatasetConfig
    format: str = "hdf5"
    views: Views = None  # type: ignore[assignment]  # set below; every Plan has views
    version: int = DATA_VERSION
    converted_from: Mapping[str, str] | None = None

    def __post_init__(self) -> None:
        if self.views is None:
            object.__setattr__(self, "views", self.config.make_views())

    def __getstate__(self) -> dict[str, Any]:
        """Return the state that workers are sent: the fields, and the properties that are costly to compute."""
        costly = ("classes", "fingerprint", "split_of", "shards")
        return {name: getattr(self, name) for name in (*(each.name for each in fields(self)), *costly)}

    @cached_property
    def classes(self) -> list[str]:
        """Names of the classes, a published list where the format has one; the index in here is a cloud's label."""
        return list(CLASSES_OF.get(self.format, ())) or self.meshes.classes

    def views_of(self, key: str) -> Views:
        """Return the views of the mesh of a key, distances in longest sides, about the origin."""
        differ = self.config.farthest is not None or is_random(self.config.views)
        return self.config.make_views(key) if differ else self.views

    @property
    def clouds_per_mesh(self) -> int:
        """Number of clouds of each mesh."""
        return len(self.views) * self.config.variations

    @property
    def n_clouds(self) -> int:
        """Number of clouds of the dataset where no mesh fails and every view sees something."""
        return len(self.meshes) * self.clouds_per_mesh

    @cached_property
    def split_of(self) -> NDArray[np.uint8]:
        """The split of each mesh, its index in `SPLITS`."""
        return np.fromiter((SPLITS.index(entry.split) for entry in self.meshes), np.uint8, len(self.meshes))

    @property
    def splits(self) -> list[str]:
        """The splits that have meshes."""
        return [SPLITS[split] for split in np.unique(self.split_of)]

    @property
    def n_checked(self) -> int:
        """Number of checked pairs of view and point of each sampling of a mesh."""
        return -(-PAIRS_CHECKED // (len(self.meshes) * self.config.variations))

    @cached_property
    def _cloud_bytes(self) -> int:
        """The estimated size of a cloud."""
        if self.config.scan is not None:
            return (self.config.sample_size or self._n_returns) * RETURN_BYTES
        return (self.config.sample_size or self._n_points) * POINT_BYTES

    @property
    def _n_points(self) -> int:
        """The estimated number of points sampled on a mesh."""
        return self.config.n_points or math.ceil(AREA * (self.config.density or 0.0))

    @cached_property
    def _n_returns(self) -> int:
        """The estimated number of returns of a scan: one of each ray; of an object alone as many as points."""
        scan, sizes = self.config.scan, self.views.sizes
        if scan is None or scan.keep != "all":
            return self._n_points
        return len(scan.sensor.rays()) if sizes is None else int(sizes.prod(axis=1).max())

    @cached_property
    def _mesh_bytes(self) -> int:
        """The estimated size of all clouds of a mesh in memory."""
        from zbuf_occlude.datasets.formats import find_format  # late: its rows check plans

        if not find_format(self.format).keeps_points:
            return self.clouds_per_mesh * self._cloud_bytes
        point = WHOLE_POINT_BYTES + sum(ATTRIBUTE_BYTES.get(name, 0) for name in self.config.attributes)
        view = -(-self._n_points // 8) if self.config.scan is None else self._n_returns * WHOLE_RETURN_BYTES
        return self.config.variations * (self._n_points * point + len(self.views) * view)

    @property
    def clouds_per_file(self) -> int:
        """The maximum number of clouds of a file."""
        return max(1, min(CLOUDS_PER_FILE, SHARD_BYTES // self._cloud_bytes))

    @property
    def meshes_per_shard(self) -> int:
        """The maximum number of meshes of a shard; the number of workers does not matter."""
        wanted = max(MIN_PER_SHARD, self.n_clouds // MIN_SHARDS)
        n_clouds = min(wanted, FILES_PER_SHARD * CLOUDS_PER_FILE)
        return max(1, min(n_clouds // self.clouds_per_mesh, SHARD_BYTES // self._mesh_bytes))

    @cached_property
    def shards(self) -> list[NDArray[np.int32]]:
        """Mesh indices of each shard, all of one split."""
        found: list[NDArray[np.int32]] = []
        for split in np.unique(self.split_of).tolist():
            rng = np.random.default_rng(seed_of(self.config.seed, "shards/" + SPLITS[split]))
            mesh_ids = rng.permutation(np.flatnonzero(self.split_of == split).astype(np.int32))
            found += np.array_split(mesh_ids, -(-len(mesh_ids) // self.meshes_per_shard))
        return found

    def shard_of(self, mesh_id: int) -> int:
        """Return the shard of a mesh."""
        return int(self._ranks[0][mesh_id])

    def split_of_shard(self, shard: int) -> str:
        """Return the split of a shard's meshes."""
        return SPLITS[self.split_of[self.shards[shard][0]]]

    @cached_property
    def files(self) -> list[PlannedFile]:
        """All files, shard by shard; of a shard as equal in size as can be."""
        found, n_before = list[PlannedFile](), Counter[str]()
        for shard, mesh_ids in enumerate(self.shards):
            split, n_files = (
                self.split_of_shard(shard),
                -(-len(mesh_ids) * self.clouds_per_mesh // self.clouds_per_file),
            )
            found += [PlannedFile(shard, split, n_before[split] + i) for i in range(n_files)]
            n_before[split] += n_files
        return found

    def files_of(self, shard: int) -> range:
        """Return the indices of the files of a shard."""
        first, end = (bisect_left(self.files, number, key=attrgetter("shard")) for number in (shard, shard + 1))
        return range(first, end)

    def places(self, mesh_ids: Numbers, variations: Numbers, view_ids: Numbers) -> tuple[Numbers, Numbers]:
        """Return the files of clouds (n,), as indices into `files`, and their rows there."""
        files, rows = np.empty(len(mesh_ids), int), np.empty(len(mesh_ids), int)
        shard_of, rank_of = self._ranks
        numbers = rank_of[mesh_ids].astype(int) * self.clouds_per_mesh + variations * len(self.views) + view_ids
        for shard in np.unique(shard_of[mesh_ids]).tolist():
            mine, of_shard = shard_of[mesh_ids] == shard, self.files_of(shard)
            n_clouds = len(self.shards[shard]) * self.clouds_per_mesh
            found, n_rows = _shuffled(self.config.seed, shard, n_clouds)[numbers[mine]], -(-n_clouds // len(of_shard))
            files[mine], rows[mine] = of_shard.start + found // n_rows, found % n_rows
        return files, rows

    @cached_property
    def _ranks(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """The shard of each mesh, and the rank of the mesh there."""
        shard_of, rank_of = np.empty(len(self.meshes), np.int32), np.empty(len(self.meshes), np.int32)
        for shard, mesh_ids in enumerate(self.shards):
            shard_of[mesh_ids], rank_of[mesh_ids] = shard, np.arange(len(mesh_ids))
        return shard_of, rank_of

    @cached_property
    def pool(self) -> Pool:
        """Objects that fill scenes; the same in every worker."""
        scan = self.config.scan
        given = ({}, "none", {}) if scan is None else (scan.size, scan.scene, scan.transparent)
        return Pool(surroundings(self.meshes, given[1]), *given[:2], seed_of(self.config.seed, "pool"), given[2])

    def to_dict(self) -> dict[str, Any]:
        """Return the plan as plain data, for plan.json: the configuration, the views and every mesh."""
        converted = {} if self.converted_from is None else {"converted_from": dict(self.converted_from)}
        return converted | {
            "config": self.config.to_dict(),
            "format": self.format,
            "views": self.views.to_rows().tolist(),
            "classes": self.classes,
            "meshes": [[entry.key, entry.label, entry.split, entry.up, entry.unit] for entry in self.meshes],
            "version": self.version,
        }

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> "Plan":
        """Read back what `to_dict` gave, without the meshes: enough to read, count and check, not to generate."""
        entries = [
            MeshEntry(key, label, split, partial(_not_loadable, key), None, up, unit)
            for key, label, split, up, unit in document["meshes"]
        ]
        views, config = Views.from_rows(document["views"]), DatasetConfig.from_dict(document["config"])
        converted_from = document.get("converted_from")
        return cls(MeshCollection(entries), config, document["format"], views, document["version"], converted_from)

    def differences(self, theirs: Mapping[str, Any]) -> Iterator[str]:
        """Yield the differences from another plan's document, in words."""
        mine = self.to_dict()
        for name in sorted(theirs["config"].keys() | mine["config"].keys()):
            then, now = (document["config"].get(name) for document in (theirs, mine))
            if name != "reason":
                yield from _changed(name, then, now)
        before, after = ({key: rest for key, *rest in document["meshes"]} for document in (theirs, mine))
        for here, there, what in (
            (before, after, "is not among the meshes now"),
            (after, before, "was not among the meshes"),
        ):
            if gone := [key for key in here if key not in there]:
                yield f"{gone[0]} {what}" + (f", nor are {len(gone) - 1} more" if len(gone) > 1 else "")
        for key in before.keys() & after.keys():
            for what, then, now in zip(("class", "split", "up", "unit"), before[key], after[key], strict=True):
                if then != now:
                    yield f"{what} of {key} was {then!r}, and is {now!r}"
        for name, what in (("format", "format"), ("version", "data version")):
            if theirs[name] != mine[name]:
                yield f"{what} was {theirs[name]!r}, and is {mine[name]!r}"
        then, now = (_made_of(document.get("converted_from")) for document in (theirs, mine))
        if then != now:
            yield f"clouds were made of {then}, and are made of {now}"

    @cached_property
    def fingerprint(self) -> str:
        """A hash of `to_dict`, the reason left out: two runs with one fingerprint make the same dataset."""
        document = self.to_dict()
        decisive = document | {"config": document["config"] | {"reason": ""}}
        return hashlib.sha256(json.dumps(decisive, sort_keys=True).encode()).hexdigest()[:16]


@lru_cache(maxsize=8)
def _shuffled(seed: int, shard: int, n_clouds: int) -> Numbers:
    """Return the place of each cloud of a shard: a random permutation."""
    return np.random.default_rng(seed_of(seed, "order", shard)).permutation(n_clouds)


def _changed(name: str, then: Any, now: Any) -> Iterator[str]:
    """Yield the change of a value in words; for a mapping, or a list of mappings, the change of each entry."""
    if all(isinstance(each, list | tuple) and all(isinstance(one, Mapping) for one in each) for each in (then, now)):
        then, now = ({str(number): one for number, one in enumerate(each)} for each in (then, now))
    if isinstance(then, Mapping) and isinstance(now, Mapping):
        for key in sorted(then.keys() | now.keys()):
            yield from _changed(f"{name}.{key}", then.get(key), now.get(key))
    elif json.dumps(then) != json.dumps(now):  # a plan read back has lists in place of tuples
        yield f"{name} was {then!r:.60}, and is {now!r:.60}"


def _made_of(converted_from: Mapping[str, str] | None) -> str:
    """Return the source of a dataset's clouds in words: meshes, or another dataset."""
    return "meshes" if converted_from is None else "the {format} dataset {fingerprint}".format(**converted_from)


def _not_loadable(key: str) -> Mesh:
    raise MeshError(f"the mesh {key} must be loaded from its collection; a plan read back has only its key.")
