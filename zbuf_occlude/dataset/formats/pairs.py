"""Layouts with a file for each complete cloud and for each partial one of it: what their files are called, and hold."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.formats.published import (
    Names,
    Records,
    by_object,
    complete_cloud,
    names_of,
    read_cloud_files,
    rest_name,
    write_list,
    write_rest,
)
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Source
from zbuf_occlude.meshes.collection import SPLITS

MeshIds = dict[str, list[int]]
"""Of each split the objects that were written, in order."""


@dataclass(frozen=True)
class Pairs:
    """One such layout.

    Parameters
    ----------
    n_complete : int
        Points of a complete cloud.
    views : mapping of split to int
        Views of an object that there are files of.
    complete, partial : callable
        Return the names of an object's files: of a split, with these names, of this mesh index; and of this view.
    write_complete, write_partial : callable
        Write a record's points to a path whose folder is there.
    read_partial : callable
        Reads them back, (size, 3).
    """

    n_complete: int
    views: Mapping[str, int]
    complete: Callable[[str, Names, int], str]
    partial: Callable[[str, Names, int, int], str]
    write_complete: Callable[[Path, Any], None]
    write_partial: Callable[[Path, Any], None]
    read_partial: Callable[[Path], NDArray[Any]]

    def names(self, plan: Plan) -> Iterator[str]:
        """Yield the names of all files, lists apart."""
        names = names_of(plan)
        yield from map(rest_name, plan.splits)
        for mesh_id, entry in enumerate(plan.meshes):
            yield self.complete(entry.split, names, mesh_id)
            yield from (self.partial(entry.split, names, mesh_id, view) for view in range(self.views[entry.split]))

    def write(self, source: Source, out: Path) -> tuple[dict[str, list[str]], MeshIds]:
        """Write pairs; objects with a view that sees nothing are left out, for loaders count on every view.

        Returns
        -------
        files : dict of split to file names
        mesh_ids : dict of split to list of int
        """
        files: dict[str, list[str]] = {}
        mesh_ids: MeshIds = {}
        for split in source.order:
            mesh_ids[split], written = [], list[str]()
            pairs = self._written(source, out, split, mesh_ids[split], written)
            rest = write_rest(out, split, pairs, source.plan.recipe)
            files[split] = [rest, write_list(out, split, written)]
        return files, mesh_ids

    def read(self, out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
        """Return the partial clouds."""

        def name_of(split: str, names: Names, record: Any) -> str:
            return self.partial(split, names, int(record["mesh_id"]), int(record["view_id"]))

        return read_cloud_files(out, plan, files, self.read_partial, name_of)

    def _written(
        self, source: Source, out: Path, split: str, mesh_ids: list[int], written: list[str]
    ) -> Iterator[Records]:
        names = names_of(source.plan)
        for clouds in by_object(source, split):
            if len(clouds) < len(source.plan.views):
                continue
            mesh_ids.append(mesh_id := int(clouds["mesh_id"][0]))
            records = clouds[: self.views[split]]
            pair = [
                (self.complete(split, names, mesh_id), self.write_complete, self._whole(source, records)),
                *(
                    (self.partial(split, names, mesh_id, int(record["view_id"])), self.write_partial, record)
                    for record in records
                ),
            ]
            for name, write, record in pair:
                (out / name).parent.mkdir(parents=True, exist_ok=True)
                write(out / name, record)
                written.append(name)
            yield records

    def _whole(self, source: Source, records: Records) -> Any:
        return complete_cloud(source, records, self.n_complete)


def write_index(path: Path, plan: Plan, mesh_ids: MeshIds) -> None:
    """Write what the loaders of GRNet and its successors begin with: the objects of each taxonomy and split."""
    names = names_of(plan)
    index: dict[str, dict[str, Any]] = {}
    for split, of_split in mesh_ids.items():
        for mesh_id in of_split:
            taxonomy, label = names.taxonomies[mesh_id], plan.meshes[mesh_id].label
            row = {"taxonomy_id": taxonomy, "taxonomy_name": label, **{other: [] for other in SPLITS}}
            index.setdefault(taxonomy, row)[split].append(names.objects[mesh_id])
    atomic.write_json(path, [index[taxonomy] for taxonomy in sorted(index)])
