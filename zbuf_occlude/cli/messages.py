"""Texts of `generate`: the meshes that it found, the cost of a plan, and the dataset that it made."""

import errno
import math
import os
import shutil
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from zbuf_occlude.cli.shared_options import nearest
from zbuf_occlude.cli.shell import counted, on_renderer
from zbuf_occlude.datasets.counts import CONFIDENCE, FEW, Blank
from zbuf_occlude.datasets.folder import CONTACT_SHEET, MANIFEST, contains_plan, removable
from zbuf_occlude.datasets.formats import Format
from zbuf_occlude.datasets.plan import Plan
from zbuf_occlude.datasets.presets import Preset
from zbuf_occlude.datasets.rehearsal import estimate
from zbuf_occlude.geometry.colors import GREY
from zbuf_occlude.meshes.collection import SPLITS, MeshCollection

BAD = 0.05
"""Share of a view's checked points that are wrong above which a dataset comes with a warning."""


def format_error_rates(error: dict[str, Any], complete: bool) -> str:
    """Return the measured error in words; `complete` where the clouds hold hidden points too."""
    if not error["n_checked"]:
        if complete:
            return "complete clouds: nothing was removed, so nothing was measured"
        return "warning: how wrong the clouds are is not known: none of the views drawn for the check has a point"
    lines = [
        f"measured against the oracle on {error['n_checked']} pairs of view and point: "
        f"{error['false_visible']:.3%} false visible, {error['false_hidden']:.3%} false hidden; "
        f"of all {error['interval'][0]:.3%} to {error['interval'][1]:.3%} are wrong, with {CONFIDENCE:.0%} confidence"
    ]
    worst = error["worst_view"]
    if worst is not None and worst["share"] > BAD:
        where = f"view {worst['view']} of {worst['mesh']}"
        lines.append(
            f"warning: {worst['share']:.0%} of the points checked in {where} are wrong, and "
            f"more than 1 % in {error['bad_views']:.1%} of the views checked. --method exact has no such views."
        )
    return "\n".join(lines)


def n_blank(document: dict[str, Any]) -> int:
    """Return the number of views of a dataset that gave no cloud."""
    return sum(each["n_views"] for each in document["blank_views"].values())


def n_made(document: dict[str, Any]) -> int:
    """Return the number of clouds that were made for a dataset, also of those that its layout has no place for."""
    counts = document["counts"]
    return len(document["origins"]) * counts["views"] * counts["variations"] - n_blank(document)


def format_warnings(document: dict[str, Any]) -> Iterator[str]:
    """Yield warnings: lacking colours and windows, scans left out, few distinct points, cameras inside objects."""
    counts, n_meshes = document["counts"], len(document["origins"])
    if n := counts["meshes_without_colors"]:
        yield (
            f"warning: of {n} of {counted(n_meshes, 'mesh', 'meshes')} colours are lacking: where they "
            f"are, points have their material's, or are grey ({GREY}, {GREY}, {GREY})"
        )
    if n := counts["meshes_with_far_faces"]:
        yield (
            f"warning: {counted(n, 'mesh has', 'meshes have')} faces so far from most of the area that the contact "
            "tolerance is too large, and what hides is missed. Their lines in the log say which; --set contact=X helps."
        )
    n = counts["meshes_without_windows"]
    if n and n == n_meshes:
        names = ", ".join(document["options"]["scan"]["transparent"])
        yield f"warning: --transparent {names} names no material of any mesh that lets light pass: all are opaque"
    if counts["views_that_see_nothing"]:
        key, blank = next(iter(document["blank_views"].items()))
        yield f"{counted(n_blank(document), 'view')} without a cloud; {key}, {Blank(**blank).said}"
    if n := counts["scans_of_too_few_points"]:
        least = document["options"]["scan"]["least_points"]
        yield (
            f"{counted(n, 'scan')} of {n_made(document) + n} left out: fewer than {least} distinct points "
            "(--least-points 0 keeps them)"
        )
    if n := counts[f"clouds_of_fewer_than_{FEW}_distinct_points"]:
        total = n_made(document)
        yield f"warning: {n} of {counted(total, 'cloud')} show fewer than {FEW} distinct points of their object"
    yield from cut_off(document["cut_by_range"], document["options"]["scan"])
    if n := counts["cameras_raised_above_the_ground"]:
        placed = f"{counted(n, 'camera')} would be below the ground or table, and stand on it"
        yield f"warning: {placed}. Choose --views from above."
    if n := counts["views_inside_the_bounding_box"]:
        cure = "Raise --distance or --range, or place the cameras of a file in the mesh's unit."
        yield f"warning: {counted(n, 'camera')} inside the bounding box of the object seen. {cure}"


def named(what: str, reasons: Mapping[str, str]) -> list[str]:
    """Return a heading, and a line for each mesh without clouds: its key and the reason."""
    lines = [f"  {key}: {reason}" for key, reason in reasons.items()]
    return [f"{counted(len(reasons), 'mesh', 'meshes')} {what}:", *lines] if reasons else []


def cut_off(cut: Mapping[str, Any] | None, scan: Mapping[str, Any] | None) -> Iterator[str]:
    """Yield warnings of objects beyond the range of their sensor, with the range that suffices."""
    if not cut or not scan:
        return
    sensor, given = scan["sensor"]["name"], scan["sensor"]["noise_model"]
    least, most = given.get("range_min", 0.0), given.get("range_max", math.inf)
    if cut["too_near"]:
        clear = math.ceil(100.0 * cut["clear_range"]) / 100.0
        cure = f"With --range {clear:g} or more none is." if clear < most else "Give a smaller --size."
        yield (
            f"warning: {sensor} measures from {least:g} m: {cut['too_near']:.1%} of the objects' returns are nearer, "
            f"and lost. {cure}"
        )
    if cut["too_far"]:
        yield (
            f"warning: {sensor} measures to {most:g} m: {cut['too_far']:.1%} of the objects' returns are farther, "
            "and lost. Lower --range, or give a smaller --size."
        )


def picture(path: Path) -> str:
    """Return the path of a contact sheet, or the package that it needs."""
    return str(path) if path.exists() else "none: that needs Pillow, pip install 'zbuf-occlude[report]'"


def what_was_made(document: dict[str, Any], out: Path, read_as: str = "") -> str:
    """Return the summary of a dataset: clouds, measured error, frame of the mesh files, paths."""
    counts, error, files = document["counts"], document["error"], document["files"]
    n_files = ", ".join(f"{split}: {len(files[split])}" for split in SPLITS if split in files)
    names = sorted({name for split in SPLITS for name in files.get(split, [])})
    others = f" and {len(names) - 1} more" if len(names) > 1 else ""
    options = document["options"]
    how = "complete" if options["complete"] else f"by {options['method']}"
    why = [f"because {options['reason']}"] if options["reason"] and not options["complete"] else []
    made = n_made(document)
    left_out = f" ({made} made; {document['format']} has no place for the others)"
    lines = [
        f"{counted(counts['clouds'], 'cloud')}{left_out if counts['clouds'] < made else ''} of "
        f"{counted(counts['meshes'], 'mesh', 'meshes')}, "
        f"{counted(len(document['classes']), 'class', 'classes')}, {how}{on_renderer(document['renderer'])}",
        *why,
        *([f"warning: {document['renderer_remark']}"] if document["renderer_remark"] else []),
        format_error_rates(error, options["complete"]),
        *format_warnings(document),
        *([f"read as   {read_as}"] if read_as else []),
        f"data      {out / names[0]}{others} ({n_files})",
        f"manifest  {out / MANIFEST}",
        f"picture   {picture(out / CONTACT_SHEET)}",
    ]
    lines += named("left out", document["left_out"]) + named("failed", document["failures"])
    return "\n".join(lines)


MAX_ROWS = 60
"""Maximum number of classes shown; of more, the largest."""


def overview(
    meshes: MeshCollection,
    format: Format,
    preset: Preset | None = None,
    *,
    limited: bool = False,
    read_as: str = "",
) -> str:
    """Return remarks, the frame of the mesh files, the table of classes and splits, and warnings."""
    counts = Counter((entry.label, entry.split) for entry in meshes)
    remarks = [*meshes.remarks, *([f"files read as {read_as}"] if read_as else [])]
    return "\n".join([*remarks, *_table(counts), *_warnings(meshes, counts, format, preset, limited)])


def _table(counts: Counter[tuple[str, str]]) -> list[str]:
    splits = [split for split in SPLITS if any(found == split for _, found in counts)]
    totals = Counter[str]()
    for (label, _), count in counts.items():
        totals[label] += count
    shown = sorted(label for label, _ in totals.most_common(MAX_ROWS))
    width = min(40, max(len("class"), *map(len, shown)))
    rows = [("class", *splits), *((label, *(counts[label, split] for split in splits)) for label in shown)]
    if hidden := len(totals) - len(shown):
        rest = [sum(n for (label, at), n in counts.items() if at == split and label not in shown) for split in splits]
        rows.append((f"{hidden:,} more", *rest))
    if len(totals) > 1:
        rows.append((f"{len(totals):,} classes", *(sum(n for (_, at), n in counts.items() if at == s) for s in splits)))
    return [f"{str(name)[:40]:<{width}}" + "".join(f"{value:>9}" for value in values) for name, *values in rows]


def _warnings(
    meshes: MeshCollection, counts: Counter[tuple[str, str]], format: Format, preset: Preset | None, limited: bool
) -> list[str]:
    warnings = []
    if len(meshes) > 1:
        if len(meshes.classes) == 1:
            warnings.append(
                f"one class, {meshes.classes[0]!r}: nothing to tell apart. If that folder holds the class folders, "
                "give it itself; or say the classes with --labels FILE."
            )
        elif len(meshes.classes) == len(meshes) and any(entry.path is not None for entry in meshes):
            warnings.append("one object per class: are these folders of single models? --labels FILE says the classes.")
    present = [split for split in SPLITS if any(at == split for _, at in counts)]
    lacking = {split: [label for label in meshes.classes if not counts[label, split]] for split in present}
    if any(lacking.values()):
        said = "; ".join(f"{split} lacks {_few(labels)}" for split, labels in lacking.items() if labels)
        cure = " Raise --limit, or leave it out." if limited else ""
        warnings.append(f"the splits have different classes: {said}.{cure}")
    if preset is not None and len(meshes) < preset.n_objects:
        warnings.append(f"{preset.name} has {preset.n_objects:,} objects in its paper; here are {len(meshes):,}.")
    n_tested = sum(n for (_, split), n in counts.items() if split == "test")
    if n_tested < format.least_tested:
        warnings.append(
            f"the published test script of {format.name} needs at least {format.least_tested} test objects; here are "
            f"{n_tested}. Training works without."
        )
    return [f"warning: {warning}" for warning in warnings]


def missing_splits(meshes: MeshCollection, shares: Sequence[float] | None, chosen: Sequence[str] | None) -> list[str]:
    """Return a warning of splits with a share above 0, of those chosen, that no mesh was drawn for; [] if all have."""
    present = {entry.split for entry in meshes}
    wanted = [
        split for split, share in zip(SPLITS, shares or (), strict=False) if share and split in (chosen or SPLITS)
    ]
    lacking = [split for split in wanted if split not in present]
    if not lacking:
        return []
    cure = "Raise its share in --split, give more meshes, or another --seed."
    return [f"warning: {counted(len(meshes), 'mesh', 'meshes')}: no mesh is in {' or '.join(lacking)}. {cure}"]


def _few(names: list[str]) -> str:
    """Return the first names of a list, and the number of others."""
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


UNITS = ((1e12, "TB"), (1e9, "GB"), (1e6, "MB"), (1e3, "kB"), (1.0, "B"))
TIMES = ((86400.0, "days"), (3600.0, "hours"), (60.0, "minutes"), (1.0, "seconds"))


def human(amount: float, units: Sequence[tuple[float, str]]) -> str:
    """Return an amount in the largest unit that is not larger than it, with two digits: ``340 kB``, ``2.1 hours``."""
    size, unit = next((row for row in units if amount >= row[0]), units[-1])
    number = amount / size
    return f"{number:.2g} {unit}" if number < 99.5 else f"{number:.0f} {unit}"


def check_folder(plan: Plan, out: Path, *, overwrite: bool) -> None:
    """Raise DatasetError or PermissionError where a plan's dataset could not be made in a folder."""
    if overwrite:
        removable(out)
    elif contains_plan(plan, out) and (out / MANIFEST).exists():
        return
    if out.is_dir() and not os.access(out, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(out))


def format_plan(plan: Plan, out: Path) -> str:
    """Return a summary of a plan."""
    config = plan.config
    free = shutil.disk_usage(nearest(out)).free
    how = f"by {config.method}" + (f", because {config.reason}" if config.reason else "")
    how = "complete" if config.complete else how
    if config.scan is not None:
        how = f"scanned by {config.scan.sensor.name}, rays {how}, scene {config.scan.scene}"
    points = counted(config.sample_size, "point") if config.sample_size else "all visible points"
    return (
        f"{counted(len(plan.meshes), 'mesh', 'meshes')} x {counted(len(plan.views), 'view')} x "
        f"{counted(config.variations, 'variation')} = {counted(plan.n_clouds, 'cloud')} of "
        f"{points} in {counted(len(plan.shards), 'shard')}, "
        f"{how}\n"
        f"into {out} ({human(free, UNITS)} free)\n"
        f"fingerprint {plan.fingerprint}"
    )


def costs(plan: Plan) -> str:
    """Return the cost of a plan, measured on a few of its meshes; their clouds are not kept."""
    found = estimate(plan)
    seconds, more = found.processor_seconds, found.uncertainty
    failed = f", of which {found.n_failed} failed" if found.n_failed else ""
    return (
        f"about {human(found.n_bytes, UNITS)} on disk; at most {human(found.peak_bytes, UNITS)} while it works\n"
        f"about {human(seconds, TIMES)} on one processor core, give or take {human(more, TIMES)}: "
        f"{counted(found.n_meshes, 'mesh', 'meshes')} made here took {seconds / len(plan.meshes):.2g} s each{failed}"
    )
