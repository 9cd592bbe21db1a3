"""Convert a dataset from one format to another, part by part, by all workers: the same clouds in the same order."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.claim import claim, own_names, remove_shards
from zbuf_occlude.dataset.damage import REMEDY
from zbuf_occlude.dataset.finish import files_of, write_names
from zbuf_occlude.dataset.folder import CONTACT_SHEET, MANIFEST, SHARDS, checksums, read_finished
from zbuf_occlude.dataset.formats import find_format
from zbuf_occlude.dataset.generate import finished_by_another, run_here
from zbuf_occlude.dataset.jobs import Run
from zbuf_occlude.dataset.manifest import frame_of
from zbuf_occlude.dataset.parts import Places, find_written, placed, write_contents
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.shard import sidecar_path
from zbuf_occlude.dataset.sheet import write_contact_sheet
from zbuf_occlude.dataset.source import IDS, Content, Numbers, Source
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.meshes.collection import SPLITS


def open_dataset(folder: Path) -> Source:
    """Return the clouds of a complete dataset, whatever its format.

    Raises
    ------
    DatasetError
        There is no complete dataset, or it is damaged.
    """
    plan, manifest = read_finished(folder)
    source = find_format(plan.format).load().read(folder, plan, manifest["files"])
    if source.n_clouds != (expected := manifest["counts"]["clouds_by_split"]):
        raise DatasetError(
            f"{folder} must have the clouds that its manifest counts, {expected}; it has {source.n_clouds}. {REMEDY}"
        )
    return source


Portions = Mapping[int, list[tuple[str, int, Numbers]]]
"""For each part its splits, its number in each, and its clouds."""

READ_AT_ONCE = 256


@dataclass(frozen=True)
class Copying:
    """The task of writing clouds of one dataset as another: the jobs are the parts of the new one.

    Parameters
    ----------
    folder : Path
        The old dataset.
    format, fingerprint : str
        Its format, and its plan's.
    files : mapping of split to list of file names
        As in its manifest.
    plan : Plan
        The new dataset's.
    out : Path
    portions : Portions
    places : Places or None
        Where files hold a split whole.
    """

    folder: Path
    format: str
    fingerprint: str
    files: dict[str, list[str]]
    plan: Plan
    out: Path
    portions: Portions
    places: Places | None
    _source: list[Source] = field(default_factory=list, init=False, repr=False)

    needs_gl = False

    def do(self, job: int, gl: Any = None, lost: Any = None, on_mesh: Any = None) -> int:
        """Write a part; return how many clouds were read."""
        if not self._source:
            plan = replace(self.plan, format=self.format) if self.renumbers else self.plan
            self._source.append(find_format(self.format).load().read(self.folder, plan, self.files))
        (source,) = self._source
        contents = [
            Content(self.plan, split, number, self._labelled(source.take(numbers)), source.complete)
            for split, number, numbers in self.portions[job]
        ]
        write_contents(self.plan, self.out, job, contents, self.places, self.fingerprint)
        return sum(len(content.records) for content in contents)

    @property
    def renumbers(self) -> bool:
        """Whether labels change: one of the formats counts the classes of a published list."""
        return bool(find_format(self.format).classes or find_format(self.plan.format).classes)

    def _labelled(self, records: NDArray[Any]) -> NDArray[Any]:
        """Return records with the new plan's labels."""
        if not self.renumbers:
            return records
        labels = [self.plan.classes.index(self.plan.meshes[mesh_id].label) for mesh_id in records["mesh_id"].tolist()]
        records["label"][:, 0] = labels
        return records


def portions_of(source: Source, plan: Plan) -> Portions:
    """Cut the clouds of a source into the parts of a dataset of this plan."""
    if not find_format(plan.format).whole_objects:
        part_of = {(part.split, part.number): i for i, part in enumerate(plan.parts)}
        files = [(split, number, some) for split in source.order for number, some in source.files(split)]
        return {part_of[split, number]: [(split, number, some)] for split, number, some in files}
    numbers = np.concatenate([np.empty(0, int), *source.order.values()])
    ids = _ids_of(source, numbers)
    numbers = numbers[in_order := np.lexsort((ids["view_id"], ids["variation"], ids["mesh_id"]))]
    mesh_ids = ids["mesh_id"][in_order]
    part_of_mesh = np.empty(len(plan.meshes), int)
    for shard, of_shard in enumerate(plan.shards):
        part_of_mesh[of_shard] = shard // plan.shards_per_part
    portions: dict[int, list[tuple[str, int, Numbers]]] = {}
    for split in source.order:
        mine = plan.split_of[mesh_ids] == SPLITS.index(split)
        parts = part_of_mesh[mesh_ids[mine]]
        by_part = np.argsort(parts, kind="stable")
        found, begins = np.unique(parts[by_part], return_index=True)
        for part, some in zip(found.tolist(), np.split(numbers[mine][by_part], begins[1:]), strict=True):
            portions.setdefault(part, []).append((split, part, some))
    return portions


def places_in(source: Source, plan: Plan, portions: Portions) -> Places | None:
    """Return where clouds are to be in files that hold a split whole; None where there are none such."""
    row = find_format(plan.format)
    if not row.one_file:
        return None
    counts: list[Mapping[str, int]] = []
    for part in range(max(portions) + 1):
        of_part = portions.get(part, [])
        if row.whole_objects:
            kept = [row.kept(_ids_of(source, some), split, plan.clouds_per_mesh) for split, _, some in of_part]
            counts.append({split: len(each) for (split, _, _), each in zip(of_part, kept, strict=True)})
        else:
            counts.append({split: len(some) for split, _, some in of_part})
    return placed(counts)


def _ids_of(source: Source, numbers: Numbers) -> Any:
    """Return what some clouds are of, reading them if need be."""
    if source.ids is not None:
        return source.ids[numbers]
    found = np.empty(len(numbers), IDS)
    for begin in range(0, len(numbers), READ_AT_ONCE):
        records = source.take(numbers[begin : begin + READ_AT_ONCE])
        for name in IDS.names or ():
            found[name][begin : begin + READ_AT_ONCE] = records[name]
    return found


def convert(
    folder: Path,
    out: Path,
    format: str,
    *,
    run: Run | None = None,
    progress: Callable[[int], None] = lambda clouds: None,
) -> dict[str, Any]:
    """Write the clouds of a dataset in another format.

    Parameters
    ----------
    folder : Path
        A complete dataset.
    out : Path
        Made when missing; otherwise empty, or of this same conversion, which goes on.
    format : str
        Name in the table of formats.
    run : callable, optional
        The engine; `run_here`, in this process, by default. The same bytes come of all.
    progress : callable
        Told the number of clouds each time some were written.

    Returns
    -------
    dict
        The manifest of the new dataset; ``converted_from`` names the old one's format and fingerprint.

    Raises
    ------
    DatasetError
        There is no complete dataset, `out` holds something else (a dataset of these clouds that `generate` made, too),
        or the format needs what the dataset no longer has.

    Notes
    -----
    From `packed` the clouds are drawn as `generate` would have drawn them for that format: the same points in the same
    order, rounded to the packed step.
    """
    old, manifest = read_finished(folder)
    source, plan = open_dataset(folder), _plan_of(old, format)
    source = _of_classes(source, plan)
    claim(plan, out)
    portions = portions_of(source, plan)
    about = {**manifest, "converted_from": {"format": old.format, "fingerprint": old.fingerprint}}
    n_clouds = sum(map(np.size, source.order.values()))

    def done(job: int, n_read: int) -> tuple[int, ...]:
        progress(n_read)
        return ()

    if (finished := finished_by_another(plan, out)) is None:
        if any(sidecar_path(out, shard).exists() for shard in range(len(plan.shards))):
            raise DatasetError(
                f"{out} must be empty or hold this same conversion; `generate` has begun the same plan there. "
                "Choose another folder, or finish it by that command."
            )
        try:
            left = sorted(portions.keys() - find_written(plan, out, old.fingerprint))
            progress(n_clouds - sum(len(some) for part in left for _, _, some in portions[part]))
            places = places_in(source, plan, portions)
            task = Copying(folder, old.format, old.fingerprint, manifest["files"], plan, out, portions, places)
            if left:
                (out / SHARDS).mkdir(exist_ok=True)
                (run or run_here)(task, left, done)
            return _finish(plan, out, portions, about)
        except (DatasetError, OSError):
            if (finished := finished_by_another(plan, out)) is None:
                raise
    else:
        progress(n_clouds)
    if finished.get("converted_from") != about["converted_from"]:
        raise DatasetError(
            f"{out} must be empty or hold this same conversion; it holds a dataset of the same plan that was made "
            "otherwise. Choose another folder."
        )
    return finished


def _plan_of(old: Plan, format: str) -> Plan:
    """Return the plan of a dataset's clouds in another format, once that can hold them."""
    row, kept_points = find_format(format), find_format(old.format).all_points
    if row.all_points:
        raise DatasetError(
            f"a {format} dataset must be made of all points of its objects; {old.format} is read cloud by cloud. "
            f"Make it with `zbuf-occlude generate --format {format}`."
        )
    if (row.pairs or row.complete) and not kept_points:
        raise DatasetError(
            f"{format} must be made of all points of the objects, for it holds complete clouds; {old.format} keeps "
            f"only those drawn. Make it with `zbuf-occlude generate --format {format}`, or convert a packed dataset."
        )
    plan: Plan = replace(old, format=format)
    if kept_points:
        plan = replace(plan, recipe=row.redrawn(plan.recipe))
    row.check(replace(plan, meshes=row.select(plan.meshes)))
    own_names(plan)  # a format that cannot write them says so
    return plan


def _of_classes(source: Source, plan: Plan) -> Source:
    """Return the clouds whose classes the plan's format has, cut into files as they were."""
    classes = find_format(plan.format).classes
    if not classes:
        return source
    has_class = np.array([entry.label in classes for entry in plan.meshes])
    order, sizes = dict[str, Numbers](), dict[str, list[int]]()
    for split, numbers in source.order.items():
        held = has_class[_ids_of(source, numbers)["mesh_id"]]
        if held.any():
            order[split] = numbers[held]
        if cut := source.sizes.get(split):
            sizes[split] = [int(some.sum()) for some in np.split(held, np.cumsum(cut)[:-1])]
    return replace(source, order=order, sizes=sizes)


def _finish(plan: Plan, out: Path, portions: Portions, about: Mapping[str, Any]) -> dict[str, Any]:
    """Write what belongs to the whole dataset, its manifest last; `about` says what is not of its files."""
    files = files_of(plan, out, sorted(portions))
    write_names(plan, out)
    write_contact_sheet(out / CONTACT_SHEET, find_format(plan.format).load().read(out, plan, files.shown))
    document = {
        **about,
        "classes": plan.classes,
        **frame_of(plan),
        "fingerprint": plan.fingerprint,
        "format": plan.format,
        "options": plan.document["recipe"],
        "counts": about["counts"] | {"clouds": sum(files.n_clouds.values()), "clouds_by_split": files.n_clouds},
        "files": files.names,
        "sha256": checksums(out, files.names, files.sha256),
    }
    atomic.write_json(out / MANIFEST, document)
    remove_shards(plan, out)
    return document
