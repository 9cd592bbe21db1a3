"""Layouts with a file for each complete cloud and for each partial one of it: what their files are called, and hold."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.formats.published import (
    Names,
    by_object,
    check_version,
    from_theirs,
    names_of,
    read_cloud_files,
    record_as_theirs,
    rest_names,
    write_rest,
)
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Content, Source
from zbuf_occlude.meshes.collection import SPLITS


@dataclass(frozen=True)
class Pairs:
    """One such layout.

    Parameters
    ----------
    name : str
        In the table of formats.
    n_complete : int
        Points of a complete cloud.
    complete, partial : callable
        Return the names of an object's files: of a split, with these names, of this mesh index; and of this view.
    write_complete, write_partial : callable
        Write a record's points to a path whose folder is there.
    read_partial : callable
        Reads them back, (size, 3).
    """

    name: str
    n_complete: int
    complete: Callable[[str, Names, int], str]
    partial: Callable[[str, Names, int, int], str]
    write_complete: Callable[[Path, Any], None]
    write_partial: Callable[[Path, Any], None]
    read_partial: Callable[[Path], NDArray[Any]]

    def names(self, plan: Plan) -> Iterator[str]:
        """Yield the names of all files, lists apart."""
        names = names_of(plan)
        yield from rest_names(plan)
        for mesh_id, entry in enumerate(plan.meshes):
            yield self.complete(entry.split, names, mesh_id)
            yield from (self.partial(entry.split, names, mesh_id, view) for view in range(len(plan.views)))

    def write_part(self, content: Content, out: Path) -> list[str]:
        """Write pairs."""
        assert content.complete is not None  # the table says that it is needed
        names, written = names_of(content.plan), list[str]()
        with_normals = "normals" in content.plan.recipe.attributes  # of scans they are in each record
        for clouds in by_object(content.records):
            fields = [name for name in clouds.dtype.names or () if name != "normal" or with_normals]
            mesh_id = int(clouds["mesh_id"][0])
            pair = [
                (
                    self.complete(content.split, names, mesh_id),
                    self.write_complete,
                    content.complete(mesh_id, self.n_complete),
                ),
                *(
                    (self.partial(content.split, names, mesh_id, int(record["view_id"])), self.write_partial, record)
                    for record in clouds[fields]
                ),
            ]
            for name, write, record in pair:
                (out / name).parent.mkdir(parents=True, exist_ok=True)
                write(out / name, record_as_theirs(record, content.plan, self.name))
                written.append(name)
        return [write_rest(out, content), *written]

    def read(self, out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
        """Return the partial clouds."""

        check_version(plan, since=8)

        def name_of(split: str, names: Names, record: Any) -> str:
            return self.partial(split, names, int(record["mesh_id"]), int(record["view_id"]))

        def load(path: Path) -> NDArray[Any]:
            return from_theirs(self.read_partial(path), plan.recipe, self.name)

        return read_cloud_files(out, plan, files, load, name_of)


def write_index(path: Path, plan: Plan, mesh_ids: dict[str, list[int]]) -> None:
    """Write what the loaders of GRNet and its successors begin with: the objects of each taxonomy and split."""
    names = names_of(plan)
    index: dict[str, dict[str, Any]] = {}
    for split, of_split in mesh_ids.items():
        for mesh_id in of_split:
            taxonomy, label = names.taxonomies[mesh_id], plan.meshes[mesh_id].label
            row = {"taxonomy_id": taxonomy, "taxonomy_name": label, **{other: [] for other in SPLITS}}
            index.setdefault(taxonomy, row)[split].append(names.objects[mesh_id])
    atomic.write_json(path, [index[taxonomy] for taxonomy in sorted(index)])
