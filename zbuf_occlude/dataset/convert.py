"""Convert a dataset from one format to another: the same clouds in the same order."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.claim import claim, own_names
from zbuf_occlude.dataset.damage import REMEDY
from zbuf_occlude.dataset.finish import write_names
from zbuf_occlude.dataset.folder import CONTACT_SHEET, MANIFEST, checksums, read_finished, read_manifest
from zbuf_occlude.dataset.formats import find_format
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.sheet import write_contact_sheet
from zbuf_occlude.dataset.source import Numbers, Source
from zbuf_occlude.errors import DatasetError


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


def convert(
    folder: Path, out: Path, format: str, *, progress: Callable[[int], None] = lambda clouds: None
) -> dict[str, Any]:
    """Write the clouds of a dataset in another format.

    Parameters
    ----------
    folder : Path
        A complete dataset.
    out : Path
        Made when missing; otherwise empty, or of this same conversion.
    format : str
        Name in the table of formats.
    progress : callable
        Told the number of clouds each time some were taken.

    Returns
    -------
    dict
        The manifest of the new dataset; ``converted_from`` names the old one's format and fingerprint.

    Raises
    ------
    DatasetError
        There is no complete dataset, `out` holds something else, or the format needs what the dataset no longer has.

    Notes
    -----
    From `packed` the clouds are drawn as `generate` would have drawn them for that format: the same points in the same
    order, rounded to the packed step.
    """
    old, manifest = read_finished(folder)
    row, kept_points = find_format(format), find_format(old.format).all_points
    source = open_dataset(folder)
    if row.all_points:
        row.load().write(source, out)  # says why it cannot
    if (row.pairs or row.complete) and not kept_points:
        raise DatasetError(
            f"{format} must be made of all points of the objects, for it holds complete clouds; {old.format} keeps "
            f"only those drawn. Make it with `zbuf-occlude generate --format {format}`, or convert a packed dataset."
        )
    plan: Plan = replace(old, format=format)
    if kept_points:
        plan = replace(plan, recipe=row.redrawn(plan.recipe))
        source = find_format(old.format).load().read(folder, plan, manifest["files"])
    row.check(plan)

    def take(numbers: Numbers) -> NDArray[Any]:
        progress(len(numbers))
        return source.take(numbers)

    own_names(plan)  # a format that cannot write them says so
    claim(plan, out)
    if (finished := read_manifest(out)) is not None:
        progress(sum(map(np.size, source.order.values())))
        return finished
    files = row.write(replace(source, plan=plan, take=take), out)
    write_names(plan, out)
    written = row.load().read(out, plan, files)
    write_contact_sheet(out / CONTACT_SHEET, written)
    document = {
        **manifest,
        "fingerprint": plan.fingerprint,
        "format": format,
        "options": plan.document["recipe"],
        "counts": manifest["counts"] | {"clouds": sum(written.n_clouds.values()), "clouds_by_split": written.n_clouds},
        "files": files,
        "sha256": checksums(out, files),
        "converted_from": {"format": old.format, "fingerprint": old.fingerprint},
    }
    atomic.write_json(out / MANIFEST, document)
    return document
