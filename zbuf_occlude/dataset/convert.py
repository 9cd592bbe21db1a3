"""Convert a dataset: the same clouds in the same order in another format, or exported as a layout."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.export import export
from zbuf_occlude.dataset.folder import (
    CONTACT_SHEET,
    MANIFEST,
    checksums,
    claim,
    read_finished,
    read_manifest,
    remove_work,
)
from zbuf_occlude.dataset.formats import PACKED, find_format
from zbuf_occlude.dataset.manifest import write_names
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.sheet import write_contact_sheet
from zbuf_occlude.dataset.source import Source
from zbuf_occlude.errors import DatasetError

REMEDY = atomic.REMEDY


def open_dataset(folder: Path) -> Source:
    """Return the clouds of a complete dataset of a format that is read back.

    Raises
    ------
    DatasetError
        There is no complete dataset, it is damaged, or it is an export in a layout of others.
    """
    plan, manifest = read_finished(folder)
    row = find_format(plan.format)
    if row.exported_from:
        raise DatasetError(
            f"{folder} must be in a format that is read back; it is an export for the loaders of {plan.format}. "
            f"Make the {row.exported_from} dataset, and its export by `zbuf-occlude convert`."
        )
    source: Source = row.load().read(folder, plan, manifest["files"])
    if source.n_clouds != (expected := manifest["counts"]["clouds_by_split"]):
        raise DatasetError(
            f"{folder} must have the clouds that its manifest counts, {expected}; it has {source.n_clouds}. {REMEDY}"
        )
    return source


def convert(
    folder: Path, out: Path, format: str, *, progress: Callable[[int], None] = lambda clouds: None
) -> dict[str, Any]:
    """Write the clouds of a dataset in another format.

    Parameters
    ----------
    folder : Path
        A complete dataset.
    out : Path
        Made when missing; otherwise empty, or of this same conversion: files that are there are not written again.
    format : str
        Name in the table of formats.
    progress : callable
        Called with the number of clouds each time some were written.

    Returns
    -------
    dict
        The manifest of the new dataset; ``converted_from`` names the old one's format and fingerprint.

    Raises
    ------
    DatasetError
        There is no complete dataset, `out` holds something else, or the format needs what the dataset does not have.

    Notes
    -----
    From `packed` the clouds are drawn as `generate` would have drawn them for that format: the same points in the same
    order, rounded to the packed step.
    """
    old, manifest = read_finished(folder)
    row, plan = find_format(format), _plan_of(old, format)
    origin = {"format": old.format, "fingerprint": old.fingerprint}
    claim(plan, out)
    if (finished := read_manifest(out)) is not None and finished.get("converted_from") != origin:
        raise DatasetError(
            f"{out} must be empty or hold this same conversion; it holds a dataset of the same plan that was made "
            "otherwise. Choose another folder."
        )
    source = replace(open_dataset(folder), plan=plan)
    if old.format == PACKED:  # the draw follows the new format's recipe
        drawn = replace(plan, format=PACKED)
        source = replace(find_format(PACKED).load().read(folder, drawn, manifest["files"]), plan=plan)
    if finished is not None:
        progress(sum(source.n_clouds.values()))
        return finished
    about = {**manifest, "converted_from": origin}
    if row.exported_from:
        document = export(plan, source, out, about)
        progress(sum(source.n_clouds.values()))
        return document
    module, names = row.load(), {split: list[str]() for split in source.order}
    for split in source.order:
        for number, numbers in source.files(split):
            names[split].append(module.file_name(split, number))
            if not (out / names[split][-1]).exists():
                module.write(out / names[split][-1], source.take(numbers), plan, number)
            progress(len(numbers))
    write_names(plan, out)
    getattr(module, "finish", lambda *arguments: None)(out, plan, names)
    write_contact_sheet(out / CONTACT_SHEET, source)
    document = {
        **about,
        "fingerprint": plan.fingerprint,
        "format": format,
        "options": plan.document["recipe"],
        "files": names,
        "sha256": checksums(out, (name for of_split in names.values() for name in of_split)),
    }
    atomic.write_json(out / MANIFEST, document)
    remove_work(out, plan)
    return document


def _plan_of(old: Plan, format: str) -> Plan:
    """Return the plan of a dataset's clouds in another format, once that can hold them."""
    row, is_packed = find_format(format), old.format == PACKED
    if format == PACKED:
        raise DatasetError(
            f"a {format} dataset must be made of all points of its objects; {old.format} keeps those of each cloud. "
            f"Make it with `zbuf-occlude generate --format {format}`."
        )
    if (row.keeps_points or row.complete) and not is_packed:
        raise DatasetError(
            f"{format} must be made of all points of the objects, for it holds complete clouds; {old.format} keeps "
            f"only those drawn. Make it with `zbuf-occlude generate --format {format}`, or convert a packed dataset."
        )
    plan: Plan = replace(old, format=format)
    if is_packed:
        plan = replace(plan, recipe=row.redrawn(plan.recipe))
    row.check(replace(plan, meshes=row.select(plan.meshes)))
    return plan
