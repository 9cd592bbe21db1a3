"""Layouts with a file for each complete cloud and for each partial one of it: their objects, one after the other."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from zbuf_occlude.dataset.export import Exported, Rest, whole_objects
from zbuf_occlude.dataset.export.names import Names, names_of
from zbuf_occlude.dataset.source import Source

Write = Callable[[Path, Any], None]


@dataclass(frozen=True)
class Pairs:
    """One such layout.

    Parameters
    ----------
    n_complete : int
        Points of a complete cloud.
    complete, partial : callable
        Return the names of an object's files: of a split, with these names, of this mesh index; and of this view.
    write_complete, write_partial : callable
        Write a record's points to a path.
    n_tested : int, optional
        Views kept of each object in val and test; all by default.
    """

    n_complete: int
    complete: Callable[[str, Names, int], str]
    partial: Callable[[str, Names, int, int], str]
    write_complete: Write
    write_partial: Write
    n_tested: int | None = None

    def export(self, source: Source, out: Path) -> tuple[Exported, Names, dict[str, list[int]]]:
        """Write all pairs; return also the names, and the objects of each split."""
        assert source.complete is not None  # it is read from the format packed
        names, files, n_clouds, mesh_ids = names_of(source.plan), dict[str, list[str]](), dict[str, int](), {}
        with_normals = "normals" in source.plan.recipe.attributes  # of scans they are in each record
        for split in source.order:
            numbers = whole_objects(source, None if split == "train" else self.n_tested)[split]
            rest, written, objects = Rest(out, split, source.plan, numbers.size), list[str](), list[int]()
            for row, of_object in enumerate(numbers):
                records = source.take(of_object)
                rest.write(slice(row * len(of_object), (row + 1) * len(of_object)), records)
                mesh_id = int(records["mesh_id"][0])
                objects.append(mesh_id)
                fields = [name for name in records.dtype.names or () if name != "normal" or with_normals]
                whole = source.complete(mesh_id, self.n_complete)
                pairs = [(self.complete(split, names, mesh_id), self.write_complete, whole)]
                for record in records[fields]:
                    name = self.partial(split, names, mesh_id, int(record["view_id"]))
                    pairs.append((name, self.write_partial, record))
                for name, write, record in pairs:
                    (out / name).parent.mkdir(parents=True, exist_ok=True)
                    write(out / name, record)
                    written.append(name)
            files[split], n_clouds[split], mesh_ids[split] = [*written, rest.name], numbers.size, objects
        return Exported(files, n_clouds), names, mesh_ids
