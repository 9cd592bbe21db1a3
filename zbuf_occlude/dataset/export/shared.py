"""What exports share: names of objects and classes, whole objects, and the file of what clouds hold besides points."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

import numpy as np

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.export import Exported
from zbuf_occlude.dataset.plan import Numbers, Plan
from zbuf_occlude.dataset.records import Records, record_type
from zbuf_occlude.dataset.source import Source
from zbuf_occlude.meshes.collection import SPLITS
from zbuf_occlude.meshes.load import SUFFIXES

LONGEST = 150
"""Characters of a name."""


class Layout(NamedTuple):
    """A layout in a module of several: what a module of one has as functions."""

    export: Callable[[Source, Path], Exported]
    check: Callable[[Plan], None] = lambda plan: None


class Names(NamedTuple):
    """What objects are called in a layout, by mesh index: only letters, digits and underscores.

    Parameters
    ----------
    classes : list of str
    taxonomies : list of str
        ShapeNet's synset where the key begins with one, else the class's name.
    objects : list of str
        The last part of the key without its ending; unique within its taxonomy and within its class.
    """

    classes: list[str]
    taxonomies: list[str]
    objects: list[str]


def names_of(plan: Plan) -> Names:
    """Return what the meshes of a plan are called; the same plan gives the same names."""
    taken, last = set[tuple[str, str]](), dict[tuple[str, str], int]()

    def free(name: str, *places: str) -> str:
        """Turn a name into a word that differs from all before in the same places."""
        word = found = re.sub(r"\W", "_", name, flags=re.ASCII)[:LONGEST] or "_"
        while any((place, found) in taken for place in places):
            number = last[places[0], word] = last.get((places[0], word), 1) + 1
            found = f"{word}_{number}"
        taken.update((place, found) for place in places)
        return found

    words = {label: free(label, "") for label in plan.meshes.classes}
    names = Names([words[entry.label] for entry in plan.meshes], [], [])
    for entry in plan.meshes:
        path = PurePosixPath(entry.key)
        synset = path.parts[0]
        taxonomy = synset if re.fullmatch(r"\d{8}", synset) and len(path.parts) > 1 else words[entry.label]
        names.taxonomies.append(taxonomy)
        name = path.stem if path.suffix.lower() in SUFFIXES else path.name
        names.objects.append(free(name, taxonomy, f"class {words[entry.label]}"))
    return names


def write_index(path: Path, plan: Plan, names: Names, mesh_ids: dict[str, list[int]]) -> None:
    """Write what the loaders of GRNet and its successors begin with: the objects of each taxonomy and split."""
    index: dict[str, dict[str, Any]] = {}
    for split, of_split in mesh_ids.items():
        for mesh_id in of_split:
            taxonomy, label = names.taxonomies[mesh_id], plan.meshes[mesh_id].label
            row = {"taxonomy_id": taxonomy, "taxonomy_name": label, **{other: [] for other in SPLITS}}
            index.setdefault(taxonomy, row)[split].append(names.objects[mesh_id])
    atomic.write_json(path, [index[taxonomy] for taxonomy in sorted(index)])


def write_synsets(folder: Path, plan: Plan, names: Names) -> None:
    """Write what each taxonomy is called; PoinTr's report of a test ends at one that its own list lacks."""
    called = {taxonomy: entry.label for taxonomy, entry in zip(names.taxonomies, plan.meshes, strict=True)}
    atomic.write_json(folder / "shapenet_synset_dict.json", called)


def whole_objects(source: Source, n_kept: int | None = None) -> dict[str, Numbers]:
    """Return the clouds of the objects that all their views see, (n objects, n_kept clouds) for each split.

    Objects are in the order of the plan, their clouds by variation and view, the first `n_kept` of each.
    """
    ids, per_object = source.ids(), source.plan.clouds_per_mesh
    found = {}
    for split, numbers in source.order.items():
        mine = ids[numbers]
        numbers = numbers[np.lexsort((mine["view_id"], mine["variation"], mine["mesh_id"]))]
        _, object_of, n_seeing = np.unique(ids[numbers]["mesh_id"], return_inverse=True, return_counts=True)
        found[split] = numbers[n_seeing[object_of] == per_object].reshape(-1, per_object)[:, :n_kept]
    return found


class Rest:
    """The file ``clouds_SPLIT.npy``: what records hold besides their points, row by row."""

    def __init__(self, folder: Path, split: str, plan: Plan, n_rows: int) -> None:
        self.name = f"clouds_{split}.npy"
        whole = record_type(plan.recipe)
        kind = np.dtype([(name, whole[name]) for name in whole.names or () if name != "data"])
        self._rows: Records | None = None
        if n_rows and not kind.hasobject:
            self._rows = np.lib.format.open_memmap(folder / self.name, "w+", kind, (n_rows,))

    def write(self, rows: slice | Numbers, records: Records) -> None:
        """Write the rows of some records."""
        if self._rows is not None:
            for name in self._rows.dtype.names or ():
                self._rows[name][rows] = records[name]

    def batches(self, source: Source, split: str) -> Iterator[tuple[slice, Records]]:
        """Yield the rows and records of a split; each is written here."""
        row = 0
        for records in source.batches(split):
            rows = slice(row, row := row + len(records))
            self.write(rows, records)
            yield rows, records
