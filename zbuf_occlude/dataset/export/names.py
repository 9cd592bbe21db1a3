"""Names of classes and objects in layouts of others, and the lists that their loaders begin with."""

import re
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.meshes.collection import SPLITS
from zbuf_occlude.meshes.load import SUFFIXES

SYNSETS = "shapenet_synset_dict.json"
"""As PoinTr calls it."""
LONGEST = 150
"""Characters of a name."""


class Names(NamedTuple):
    """What objects are called in a layout, by mesh index.

    Parameters
    ----------
    classes : list of str
    taxonomies : list of str
        ShapeNet's synset where the key begins with one, else the class's name.
    objects : list of str
        The last part of the key without its ending; unique within its taxonomy.

    Notes
    -----
    Only letters, digits and underscores: loaders split at "-" and ".".
    """

    classes: list[str]
    taxonomies: list[str]
    objects: list[str]


def names_of(plan: Plan) -> Names:
    """Return what the meshes of a plan are called; the same plan gives the same names."""
    taxonomies, objects = [], []
    free = _Free()
    words = {label: free("", label) for label in plan.meshes.classes}
    for entry in plan.meshes:
        path = PurePosixPath(entry.key)
        synset = path.parts[0]
        taxonomy = synset if re.fullmatch(r"\d{8}", synset) and len(path.parts) > 1 else words[entry.label]
        stem = path.stem if path.suffix.lower() in SUFFIXES else path.name
        taxonomies.append(taxonomy)
        objects.append(free(taxonomy, stem))
    return Names([words[entry.label] for entry in plan.meshes], taxonomies, objects)


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
    atomic.write_json(folder / SYNSETS, called)


class _Free:
    """Turns names into words that differ from all given out before in the same place."""

    def __init__(self) -> None:
        self._taken: set[tuple[str, str]] = set()
        self._last: dict[tuple[str, str], int] = {}

    def __call__(self, place: str, name: str) -> str:
        word = free = re.sub(r"\W", "_", name, flags=re.ASCII)[:LONGEST] or "_"
        while (place, free) in self._taken:
            number = self._last[place, word] = self._last.get((place, word), 1) + 1
            free = f"{word}_{number}"
        self._taken.add((place, free))
        return free
