"""The table of formats, and what each of them is: one file here, one row, written from a source and read as one.

A format's module has three functions:

    names(plan) -> iterator of str                        names of all files that it may write for a plan
    write_part(content, out) -> list of str               writes some clouds of a split (`source.Content`) into a
                                                          folder, each file whole or not at all; returns the names
    read(out, plan, files) -> Source                      reads them back, when and as far as they are asked for

and, where it has more than the clouds, its loaders have numbers in their code, or a package is needed, two more:

    finish(out, plan, names, n_clouds)                    writes lists and the like, given all names and the numbers of
        -> dict of split to file names                    clouds by split; returns the files that `read` is to have
    check(plan)                                           raises what says which plan it can hold, before work begins

Whoever is free writes the next part. What a part is, the row says: 2,048 clouds in the plan's mixed order; of formats
that want `whole_objects`, those of a few shards. Where files hold a split whole (`one_file`), every part writes its
rows of them (`shared.py`).
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.checks import find_row
from zbuf_occlude.dataset.classes import CLASSES_OF
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.dataset.source import Content, Source
from zbuf_occlude.errors import OptionError
from zbuf_occlude.meshes.collection import SPLITS, MeshCollection


class Module(Protocol):
    """What a format's module has."""

    def names(self, plan: Plan) -> Iterator[str]:
        """Yield the names of all files that there may be, lists of files left out; refuse those that cannot be."""

    def write_part(self, content: Content, out: Path) -> list[str]:
        """Write some clouds of a split; return the names of the files that they are in."""

    def read(self, out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
        """Return the clouds of these files."""


@dataclass(frozen=True)
class Format:
    """One row of the table of formats. Its module is imported when the format is used, not before.

    Parameters
    ----------
    name : str
        Also the name of its module.
    summary : str
        One line.
    all_points : bool
        Whether it keeps all points of the objects, and not only those that were drawn for each cloud.
    pairs : bool
        Whether it is written from all points of the objects, for it holds complete clouds too.
    complete : bool
        Whether it holds complete clouds alone.
    ragged : bool
        Whether its clouds may be of unequal size (`--sample-size all`).
    whole_objects : bool
        Whether it keeps all clouds of an object together, and leaves out objects with a view that sees nothing.
    one_file : bool
        Whether its files hold a split whole, so that nothing is written before all shards are done.
    fewer_views : mapping of split to int
        Views that it keeps of each object, the first; all of splits that are not named.
    least_tested : int
        Test clouds below which the loaders' own test ends in an error.
    axes : (str, str, str)
        The axes of its frame, by those of the recipe's frame "object", where z points up.
    longest_side : float
        In its frame, of what the recipe scales to 1.
    options : mapping
        What `generate` is to be told unless it is told otherwise, by the names of its command line's parameters.
    """

    name: str
    summary: str
    all_points: bool = False
    pairs: bool = False
    complete: bool = False
    ragged: bool = False
    whole_objects: bool = False
    one_file: bool = False
    fewer_views: Mapping[str, int] = field(default_factory=dict)
    least_tested: int = 0
    axes: tuple[str, str, str] = ("x", "y", "z")
    longest_side: float = 1.0
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def classes(self) -> tuple[str, ...]:
        """Names that its labels count; () where they count the classes at hand."""
        return CLASSES_OF.get(self.name, ())

    @property
    def keeps_points(self) -> bool:
        """Whether shards of it keep all points of the objects."""
        return self.all_points or self.pairs

    def load(self) -> Module:
        """Import the format's module."""
        module: Module = import_module(f"{__name__}.{self.name.replace('-', '_')}")
        return module

    def n_kept(self, split: str, n_views: int) -> int:
        """Return how many clouds it keeps of an object that has this many."""
        return min(self.fewer_views.get(split, n_views), n_views)

    def kept(self, records: NDArray[Any], split: str, n_views: int) -> NDArray[Any]:
        """Return those of some clouds of whole objects (`Content.records`) that it keeps; objects have `n_views`."""
        if not self.whole_objects:
            return records
        _, objects, n_seeing = np.unique(records["mesh_id"], return_inverse=True, return_counts=True)
        whole = records[n_seeing[objects] == n_views]
        return whole.reshape(-1, n_views)[:, : self.n_kept(split, n_views)].reshape(-1)

    def select(self, meshes: MeshCollection) -> MeshCollection:
        """Return the meshes of its classes; a remark names the classes that are left out.

        Raises
        ------
        OptionError
            None is left.
        """
        outside = self._outside(meshes)
        if not outside:
            return meshes
        found = [entry for entry in meshes if entry.label in self.classes]
        if not found:
            raise OptionError(
                f"{self.name} must have meshes of its {len(self.classes)} classes, {', '.join(self.classes)}; got "
                f"{outside}. Name them so by --labels FILE."
            )
        left_out = f"{len(meshes) - len(found):,} of {len(meshes):,} meshes are left out"
        return MeshCollection(found, (*meshes.remarks, f"{self.name} has no class {outside}: {left_out}"))

    def _outside(self, meshes: MeshCollection) -> str:
        """Name the classes that its labels do not count, or nothing."""
        outside = [label for label in meshes.classes if label not in self.classes] if self.classes else []
        return ", ".join(outside[:10]) + (f" and {len(outside) - 10} more" if len(outside) > 10 else "")

    def axes_in(self, frame: str) -> tuple[str, str, str]:
        """Return the axes of its clouds, by those of the recipe's frame: its own, or those where these were chosen."""
        return self.axes if frame == "object" else ("x", "y", "z")

    def to_frame(self, recipe: Recipe) -> NDArray[np.float32]:
        """Return the matrix (3, 3) from a recipe's frame to its own; chosen axes and a mesh's scale stay."""
        axes = self.axes_in(recipe.frame)
        turned = np.array([np.eye(3)["xyz".index(axis[-1])] * (-1 if axis[0] == "-" else 1) for axis in axes])
        return (turned * (1.0 if recipe.scale == "mesh" else self.longest_side)).astype(np.float32)

    def finish(
        self, out: Path, plan: Plan, names: dict[str, list[str]], n_clouds: dict[str, int]
    ) -> dict[str, list[str]]:
        """Write what comes beside the clouds, when all parts are written; return the names of each split's files."""
        finish: Callable[..., dict[str, list[str]]] = getattr(self.load(), "finish", lambda out, plan, names, _: names)
        return finish(out, plan, names, n_clouds)

    def check(self, plan: Plan) -> None:
        """Raise OptionError or UnavailableError unless a plan can be written so."""
        if plan.recipe.sample_size is None and not self.ragged:
            raise OptionError(
                f"--format {self.name} holds clouds of one size; got --sample-size all. Give a number of points, or "
                f"choose {', '.join(row.name for row in FORMATS if row.ragged)}."
            )
        if outside := self._outside(plan.meshes):
            raise OptionError(f"{self.name} must have meshes of its classes alone; got {outside}. Leave them out.")
        getattr(self.load(), "check", lambda plan: None)(plan)

    def redrawn(self, recipe: Recipe) -> Recipe:
        """Return a recipe of all points of objects so changed that the clouds drawn of them fit this format."""
        drawn = {name: value for name, value in self.options.items() if name in ("sample_size", "scale")}
        if recipe.scale != "cloud":
            drawn.pop("scale", None)
        return replace(recipe, complete=self.complete or recipe.complete, **drawn)


Y_UP = ("x", "z", "-y")
FORMATS: tuple[Format, ...] = (
    Format("hdf5", "the PointNet layout: data (n, size, 3) and label, 2,048 clouds per file", ragged=True),
    Format(
        "packed",
        "all points of the objects and a bit for each point and view: some fifty times as many clouds in a megabyte",
        all_points=True,
        ragged=True,
    ),
    Format("webdataset", "tar shards for streaming", ragged=True),
    Format("npz", "NumPy archives of 2,048 clouds", ragged=True),
    Format("ply", "a file for each cloud, to look at", ragged=True),
    Format("huggingface", "Parquet shards and a card, for datasets.load_dataset", ragged=True),
    Format("scanobjectnn", "data, label, mask; 15 classes", one_file=True, axes=Y_UP),
    Format(
        "modelnet40-c",
        "data_occlusion_VIEW.npy, label.npy; 40 classes",
        whole_objects=True,
        one_file=True,
        axes=("-x", "z", "y"),
        longest_side=2.0,
    ),
    Format("modelnet-o", "CLASS/{train,test}/OBJECT_NUMBER.xyz; 40 classes", options={"scale": "object"}),
    Format("modelnet40-normal", "CLASS/CLASS_NUMBER.txt: x,y,z[,nx,ny,nz]; 40 classes", axes=("-x", "z", "y")),
    Format(
        "pcn",
        "pairs as PCD files, 16,384 complete points, 8 views",
        pairs=True,
        whole_objects=True,
        fewer_views={"val": 1, "test": 1},
        least_tested=10,
        axes=Y_UP,
        options={"views": "fibonacci:8", "scale": "object"},
    ),
    Format(
        "completion3d",
        "pairs as HDF5 files, 2,048 points, 1 view",
        pairs=True,
        whole_objects=True,
        least_tested=10,
        axes=Y_UP,
        options={"views": "random:1", "scale": "object", "sample_size": 2_048},
    ),
    Format(
        "mvp",
        "pairs in HDF5, 2,048 points, 26 views; 16 classes",
        pairs=True,
        whole_objects=True,
        one_file=True,
        axes=Y_UP,
        options={"views": "fibonacci:26", "scale": "object", "sample_size": 2_048},
    ),
    Format(
        "projected-shapenet",
        "pairs as PCD files and arrays, 8,192 complete points, 16 views",
        pairs=True,
        whole_objects=True,
        axes=Y_UP,
        options={"views": "fibonacci:16", "scale": "object"},
    ),
    Format(
        "shapenet55",
        "complete clouds of 8,192 points",
        complete=True,
        whole_objects=True,
        fewer_views=dict.fromkeys(SPLITS, 1),
        least_tested=10,
        axes=Y_UP,
        options={"views": "ring:1@0", "scale": "object", "sample_size": 8_192},
    ),
)


def find_format(name: str) -> Format:
    """Return the row of a name.

    Raises
    ------
    OptionError
        No such format; the message lists those there are.
    """
    return find_row("format", name, FORMATS)
