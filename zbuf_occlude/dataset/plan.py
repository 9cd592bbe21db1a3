"""The plan of a dataset: meshes x views x variations, in groups, batches and files. The same input, the same plan."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property, partial
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset.classes import CLASSES_OF
from zbuf_occlude.dataset.placement import CLOUDS_PER_FILE, Batches, Files, MeshIds, Placement, deal
from zbuf_occlude.errors import MeshError, OptionError, UnavailableError, check_word
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.sampling import MAX_POINTS
from zbuf_occlude.meshes.collection import SPLITS, MeshCollection, MeshEntry
from zbuf_occlude.provenance import seed_of
from zbuf_occlude.scenes.contents import Pool
from zbuf_occlude.sensors.setup import Setup
from zbuf_occlude.views import PAPER_DISTANCE, Views, is_drawn
from zbuf_occlude.views import parse as parse_views

SCALES = ("cloud", "object", "mesh")
FRAMES = ("object", "z-up", "camera")
SUBSETS = ("random", "fps")
ATTRIBUTES = ("normals", "colors")
"""What points may have besides their positions."""
MAX_SAMPLE_SIZE = 100_000_000
"""NumPy's records end at 2 GB."""
DATA_VERSION = 8
"""Raised whenever the same plan gives other files than before, so that unfinished work of before is not resumed."""
CLOUDS_PER_GROUP = 4 * CLOUDS_PER_FILE
"""Clouds of a group, about: its files are written, and shared among machines, together."""
CLOUDS_PER_BATCH, FEWEST_PER_BATCH, BATCHES = 500, 125, 32
"""Clouds of a batch in a large dataset: seconds of work. A small one has `BATCHES` batches, if that many have the
fewest clouds, so that workers end together."""

PAIRS_CHECKED = 37_000
"""Pairs of view and point of a dataset that are asked again of the oracle: where none of as many is wrong, fewer than
0.01 % of all are, with 95 % confidence (`dataset/confidence.py`)."""


@dataclass(frozen=True)
class Recipe:
    """Everything that decides the numbers in a dataset, apart from the meshes.

    Parameters
    ----------
    method : str
        Name in the table of methods.
    method_options : mapping
        The method's own options.
    reason : str
        Why this method, where it was not a person who chose it (`auto`).
    views : str
        A specification of `zbuf_occlude.views.parse`.
    distance : float
        Of the camera, in longest sides of the object (the paper's 4.1: 4).
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
        Which of a cloud's visible points are written: "random", or "fps": farthest-point sampling.
    scale : str
        "cloud": each cloud is centred and its longest side becomes 1 (paper 3.4); "object": all clouds of a sampling of
        the object are moved and scaled alike, so that the whole of it is centred and its longest side 1; "mesh": the
        object's own coordinates.
    frame : str
        "object": the mesh's axes, which a layout turns as its original has them; "z-up": they stay, z up, in every
        layout; "camera": eye space (x right, y up, the camera looks along -z).
    attributes : sequence of str
        What points have besides their positions: "normals", of their faces, and "colors", of meshes loaded with them.
    complete : bool
        Keep the hidden points too: clouds of whole surfaces, as the paper's original samples (4.3). No method is asked.
    scanning : mapping or None
        The fields of a `zbuf_occlude.sensors.setup.Setup`: a sensor's first hits instead of points on the surface.
    seed : int

    Raises
    ------
    OptionError
        A value out of range or not one of those there are.
    UnavailableError
        `subset` needs a package that is missing.
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
    attributes: Sequence[str] = ()
    complete: bool = False
    scanning: Mapping[str, Any] | None = None
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
        check_word("scale", self.scale, SCALES)
        check_word("frame", self.frame, FRAMES)
        check_word("subset", self.subset, SUBSETS)
        if self.subset == "fps" and self.sample_size is None:
            raise OptionError("subset fps must have a number of points to choose; got sample size all. Give a number.")
        if self.subset == "fps" and find_spec("fpsample") is None:
            raise UnavailableError(
                "subset fps needs the package fpsample; it is missing. pip install zbuf-occlude[fps]"
            )
        for name in self.attributes:
            check_word("attribute", name, ATTRIBUTES)
        if "colors" in self.attributes and find_spec("PIL") is None:
            raise UnavailableError("colors need the package Pillow; it is missing. pip install zbuf-occlude[report]")
        if self.seed < 0:
            raise OptionError(f"seed must not be negative; got {self.seed}.")
        object.__setattr__(self, "method_options", dict(self.method_options or {}))
        object.__setattr__(self, "attributes", [name for name in ATTRIBUTES if name in self.attributes])

    def make_views(self, key: str = "") -> Views:
        """Return the views of a mesh, distances in longest sides, about the origin; draws are by its key."""
        seed = seed_of(self.seed, key + "/views")
        return parse_views(self.views, distance=self.distance, seed=seed, farthest=self.farthest)

    @property
    def equal_size(self) -> int:
        """Points of each cloud, where all have as many."""
        assert self.sample_size is not None  # formats that hold clouds of one size refuse others
        return self.sample_size

    @property
    def draws_views(self) -> bool:
        """Whether each mesh has views of its own."""
        return self.farthest is not None or is_drawn(self.views)

    @cached_property
    def setup(self) -> Setup | None:
        """How scans are made; None where points are sampled on the surface."""
        return None if self.scanning is None else Setup(**self.scanning)


@dataclass(frozen=True, eq=False)
class Plan:
    """Meshes x views x variations, dealt to groups of files.

    Parameters
    ----------
    meshes : MeshCollection
        In the order in which they are worked on.
    recipe : Recipe
    format : str
        Name of the format or layout of the files.
    views : Views, optional
        Distances in longest sides, about the origin; the recipe's by default. Where each mesh has its own (`views_of`),
        these only say how many.
    """

    meshes: MeshCollection
    recipe: Recipe
    format: str = "hdf5"
    views: Views = None  # type: ignore[assignment]  # set below; every Plan has views

    def __post_init__(self) -> None:
        if self.views is None:
            object.__setattr__(self, "views", self.recipe.make_views())

    def __getstate__(self) -> dict[str, Any]:
        """Return what workers are sent: the fields, and what is costly to compute again; no document of all meshes."""
        computed = ("classes", "fingerprint", "split_of", "groups", "batches", "files")
        return {name: getattr(self, name) for name in ("meshes", "recipe", "format", "views", *computed)}

    @cached_property
    def classes(self) -> list[str]:
        """Names of the classes, a published list where the format has one; the index in here is a cloud's label."""
        return list(CLASSES_OF.get(self.format, ())) or self.meshes.classes

    def views_of(self, key: str) -> Views:
        """Return the views of the mesh of a key, distances in longest sides, about the origin."""
        return self.recipe.make_views(key) if self.recipe.draws_views else self.views

    @property
    def clouds_per_mesh(self) -> int:
        """Clouds made of each mesh."""
        return len(self.views) * self.recipe.variations

    @property
    def n_clouds(self) -> int:
        """Clouds in the whole dataset when every mesh succeeds and sees something from everywhere."""
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
        """Pairs of view and point of each sampling of a mesh that are asked again of the oracle."""
        return -(-PAIRS_CHECKED // (len(self.meshes) * self.recipe.variations))

    @cached_property
    def clouds_per_group(self) -> int:
        """Clouds of a group, about."""
        return CLOUDS_PER_GROUP

    @cached_property
    def clouds_per_batch(self) -> int:
        """Clouds of a batch, about."""
        return min(CLOUDS_PER_BATCH, max(FEWEST_PER_BATCH, self.n_clouds // BATCHES))

    @cached_property
    def groups(self) -> list[MeshIds]:
        """Mesh indices of each group, ascending: the clouds of a group are mixed, and written into files of its own."""
        n_groups = max(1, min(round(self.n_clouds / self.clouds_per_group), len(self.meshes)))
        return deal(len(self.meshes), n_groups, seed_of(self.recipe.seed, "groups"))

    @cached_property
    def batches(self) -> Batches:
        """Mesh indices of each batch, group by group; the number of workers does not matter."""
        return Batches(self.groups, max(1, self.clouds_per_batch // self.clouds_per_mesh))

    @cached_property
    def files(self) -> Files:
        """The files, group by group."""
        n_meshes = np.array([np.bincount(self.split_of[ids], minlength=len(SPLITS)) for ids in self.groups])
        return Files(-(-n_meshes * self.clouds_per_mesh // CLOUDS_PER_FILE))

    @cached_property
    def placement(self) -> Placement:
        """The file and row of every cloud."""
        n_variations, n_views = self.recipe.variations, len(self.views)
        return Placement(self.groups, self.split_of, self.files, n_variations, n_views, self.recipe.seed)

    @cached_property
    def pool(self) -> Pool:
        """Objects that scenes are filled with; the same in every worker."""
        setup = self.recipe.setup
        sizes, scene = ({}, "none") if setup is None else (setup.size, setup.scene)
        return Pool(self.meshes, sizes, scene, seed_of(self.recipe.seed, "pool"))

    @cached_property
    def document(self) -> dict[str, Any]:
        """The plan as plain data, for plan.json: the recipe, the positions and every mesh."""
        return {
            "recipe": asdict(self.recipe),
            "format": self.format,
            "views": self.views.table.tolist(),
            "classes": self.classes,
            "meshes": [[entry.key, entry.label, entry.split, entry.up] for entry in self.meshes],
            "clouds_per_batch": self.clouds_per_batch,
            "clouds_per_group": self.clouds_per_group,
            "data_version": DATA_VERSION,
        }

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> "Plan":
        """Read a plan back from its document, without its meshes: enough to read, count and check, not to generate."""
        entries = [
            MeshEntry(key, label, split, partial(_not_loadable, key), up=up[0] if up else "")
            for key, label, split, *up in document["meshes"]
        ]
        views = Views.from_table(document["views"])
        plan = cls(MeshCollection(entries), Recipe(**document["recipe"]), document["format"], views)
        stored = {name: value for name, value in document.items() if name != "fingerprint"}
        plan.__dict__["document"] = stored  # its identity, whatever a later version would write
        plan.__dict__["clouds_per_batch"] = stored.get("clouds_per_batch") or stored["clouds_per_shard"]
        plan.__dict__["clouds_per_group"] = stored["clouds_per_group"]
        plan.__dict__["classes"] = stored["classes"]
        return plan

    def differences(self, document: Mapping[str, Any]) -> list[str]:
        """Say in words in what another plan's document differs from this one's."""
        return list(_differences(document, self.document))

    @cached_property
    def fingerprint(self) -> str:
        """A hash of `document`, the reason left out: two runs with one fingerprint make the same dataset."""
        decisive = self.document | {"recipe": self.document["recipe"] | {"reason": ""}}
        return hashlib.sha256(json.dumps(decisive, sort_keys=True).encode()).hexdigest()[:16]


def _changed(name: str, then: Any, now: Any) -> Iterator[str]:
    """Say what became of a value; of a mapping, what became of each of its own."""
    if isinstance(then, Mapping) and isinstance(now, Mapping):
        for key in sorted(then.keys() | now.keys()):
            yield from _changed(f"{name}.{key}", then.get(key), now.get(key))
    elif json.dumps(then) != json.dumps(now):  # a plan that was written down has lists where there were tuples
        yield f"{name} was {then!r:.60}, and is {now!r:.60}"


def _differences(theirs: Mapping[str, Any], mine: Mapping[str, Any]) -> Iterator[str]:
    for name in sorted(theirs["recipe"].keys() | mine["recipe"].keys()):
        then, now = (document["recipe"].get(name) for document in (theirs, mine))
        if name != "reason":
            yield from _changed(name, then, now)
    meshes = {row[0]: row[1:] for row in theirs["meshes"]}, {row[0]: row[1:] for row in mine["meshes"]}
    for here, there, what in ((*meshes, "is not among the meshes now"), (*meshes[::-1], "was not among the meshes")):
        if gone := [key for key in here if key not in there]:
            yield f"{gone[0]} {what}" + (f", nor are {len(gone) - 1} more" if len(gone) > 1 else "")
    for key in meshes[0].keys() & meshes[1].keys():
        for what, then, now in zip(("class", "split", "up"), meshes[0][key], meshes[1][key], strict=False):
            if then != now:
                yield f"{what} of {key} was {then!r}, and is {now!r}"
    for name, what in (
        ("format", "format"),
        ("clouds_per_batch", "clouds of a batch"),
        ("clouds_per_group", "clouds of a group"),
        ("data_version", "data version"),
    ):
        if theirs.get(name) != mine.get(name):
            yield f"{what} was {theirs.get(name)!r}, and is {mine.get(name)!r}"


def _not_loadable(key: str) -> Mesh:
    raise MeshError(f"{key} must be loaded from where it came; a plan read back only knows its name.")
