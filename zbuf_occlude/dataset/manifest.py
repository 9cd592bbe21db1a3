"""The end of a dataset: names, picture and manifest.json, with how it was made, what failed and how wrong it is."""

import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.confidence import interval
from zbuf_occlude.dataset.counts import Counts
from zbuf_occlude.dataset.folder import CONTACT_SHEET, MANIFEST, MESH_KEYS, SHAPE_NAMES, checksums, remove_work
from zbuf_occlude.dataset.formats import find_format
from zbuf_occlude.dataset.group import Group, check_origins, read_groups
from zbuf_occlude.dataset.packing import STEPS
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.sheet import write_contact_sheet
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.gl.devices import fallen_to_software
from zbuf_occlude.provenance import versions

SHOWN = 16
"""The picture is drawn of the clouds of at most this many files."""


def finish(plan: Plan, out: Path, seconds: Mapping[str, float]) -> dict[str, Any]:
    """Write what belongs to the whole dataset, the manifest last; return the manifest.

    Parameters
    ----------
    plan : Plan
    out : Path
    seconds : mapping of str to float
        Wall-clock times of what was done before.

    Raises
    ------
    DatasetError
        A group is not done, a mesh has changed since it was used, or no mesh has a cloud.
    """
    began, row = time.perf_counter(), find_format(plan.format)
    groups = list(read_groups(plan, out))
    check_origins(plan.meshes, {key: origin for group in groups for key, origin in group.made.items()}, out)
    names: dict[str, list[str]] = {split: [] for split in plan.splits}
    known, n_clouds = dict[str, str](), Counter[str]()
    for group in groups:
        n_clouds.update(group.n_clouds)
        for split, files in group.files.items():
            names[split] += [file.name for file in files]
            known |= {file.name: file.sha256 for file in files}
    names = {split: of_split for split, of_split in names.items() if of_split}
    if not n_clouds.total():
        raise DatasetError(_nothing_made(plan, groups))
    write_names(plan, out)
    getattr(row.load(), "finish", lambda *arguments: None)(out, plan, names)
    shown = {split: of_split[:SHOWN] for split, of_split in names.items()}
    write_contact_sheet(out / CONTACT_SHEET, row.load().read(out, plan, shown))
    document = {
        **summed_up(plan, groups, {**seconds, "finishing": time.perf_counter() - began}),
        "files": names,
        "sha256": checksums(out, known, known),
    }
    document["counts"]["clouds_by_split"] = {split: n_clouds[split] for split in names}
    atomic.write_json(out / MANIFEST, document)
    remove_work(out, plan)
    return document


def write_names(plan: Plan, out: Path) -> None:
    """Write what labels and mesh ids stand for."""
    atomic.write_lines(out / SHAPE_NAMES, plan.classes)
    atomic.write_lines(out / MESH_KEYS, [entry.key for entry in plan.meshes])


def _nothing_made(plan: Plan, groups: list[Group]) -> str:
    """Say why there is no cloud, and what to do."""
    reasons = [reason for group in groups for reason in group.failures.values()]
    setup = plan.recipe.setup
    if reasons:
        why = reasons[0]
    elif setup is None:
        why = "its views see nothing. Choose other --views."
    else:
        sensor = setup.made_sensor
        reach = f"{sensor.imperfections.range_min:g} to {sensor.imperfections.range_max:g} m"
        why = f"its views see nothing; {sensor.name} measures at {reach}. Choose --views, --range and --size by that."
    return f"at least one mesh must give a cloud; none of {len(plan.meshes)} did. The first failed so: {why}"


def summed_up(plan: Plan, groups: list[Group], seconds: Mapping[str, float]) -> dict[str, Any]:
    """Return the manifest of all groups, but for what it says of files.

    Parameters
    ----------
    plan : Plan
    groups : list of Group
    seconds : mapping of str to float
        Wall-clock times of the steps of this run.

    Returns
    -------
    dict
        ``error`` holds fractions of the checked pairs of view and point: *false_visible* (the dataset has the point,
        the oracle says hidden) and *false_hidden* (the other way round); of the checked views the share of those that
        are wrong in more than `counts.BAD_VIEW` of their checked points, and the worst. ``origins`` says what each mesh
        was made of, ``stacked`` how much of the surface has another sheet nearer than the method's tolerance, ``tries``
        what was there of those that failed, and the limits they had.
    """
    counts, row = sum((group.counts for group in groups), Counts()), find_format(plan.format)
    failures = {key: reason for group in groups for key, reason in group.failures.items()}
    renderers = sorted({renderer for group in groups for renderer in group.renderers})
    return {
        "fingerprint": plan.fingerprint,
        "seed": plan.recipe.seed,
        "format": plan.format,
        "options": plan.document["recipe"],
        "versions": versions(),
        "renderer": ", ".join(renderers) or "none",
        "renderer_remark": next(filter(None, map(fallen_to_software, renderers)), ""),
        "classes": plan.classes,
        **frame_of(plan),
        "counts": {
            "meshes": len(plan.meshes),
            "meshes_failed": len(failures),
            "views": len(plan.views),
            "variations": plan.recipe.variations,
            "clouds": counts.n_clouds,
            "views_that_see_nothing": counts.n_blind_views,
            "views_inside_the_bounding_box": counts.n_inside,
            "clouds_with_repeated_points": counts.n_with_repeats,
            "faces_dropped": dict(counts.faces_dropped),
            "meshes_without_colors": counts.n_without_colors,
        },
        "failures": failures,
        "tries": {
            key: {
                "origin": group.origins[key].document,
                "limits": group.given_up[key].document if key in group.given_up else None,
            }
            for group in groups
            for key in group.failures
        },
        "origins": {key: origin.document for group in groups for key, origin in group.made.items()},
        # how far positions may be off along each axis, in longest sides; float32 alone is nothing beside it
        "rounding": 0.5 / STEPS if row.keeps_points else 0.0,
        "error": error_of(counts),
        "stacked": stacked_of(counts),
        "seconds": {
            **{name: round(value, 3) for name, value in seconds.items()},
            "workers": round(sum(group.seconds for group in groups), 3),
        },
    }


def frame_of(plan: Plan) -> dict[str, Any]:
    """Say the axes of the clouds in the files, by those of the mesh with z up, and which is up; or the eye's."""
    if plan.recipe.frame == "camera":
        return {"axes": ["right", "up", "backwards"], "up": None}
    axes = find_format(plan.format).axes_in(plan.recipe.frame)
    return {"axes": list(axes), "up": "xyz"[[axis[-1] for axis in axes].index("z")]}


def error_of(counts: Counts) -> dict[str, Any]:
    """Say how wrong the checked answers are; None where nothing was checked. ``interval`` is of all answers' share."""
    n, n_views, worst = counts.n_checked, counts.n_views_checked, counts.worst
    return {
        "false_visible": counts.false_visible / n if n else None,
        "false_hidden": counts.false_hidden / n if n else None,
        "interval": list(interval(counts.false_visible + counts.false_hidden, n)) if n else None,
        "n_checked": n,
        "n_views_checked": n_views,
        "bad_views": counts.n_bad_views / n_views if n_views else None,
        "worst_view": None if worst is None else worst._asdict(),
    }


def stacked_of(counts: Counts) -> dict[str, Any] | None:
    """Say how much of the surface has another sheet too near; None of methods without a tolerance."""
    if counts.most_stacked is None:
        return None
    return {
        "share": counts.n_stacked / counts.n_looked_at,
        "n_looked_at": counts.n_looked_at,
        "most": counts.most_stacked._asdict(),
    }
