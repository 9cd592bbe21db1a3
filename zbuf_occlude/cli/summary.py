"""What `generate` and `merge` say at the end."""

from pathlib import Path
from typing import Any

from zbuf_occlude.cli.echo import on
from zbuf_occlude.dataset.counts import CONFIDENCE
from zbuf_occlude.dataset.folder import CONTACT_SHEET, MANIFEST
from zbuf_occlude.geometry.colors import GREY
from zbuf_occlude.meshes.collection import SPLITS

BAD = 0.05
"""A dataset comes with a warning where a larger share of a view's checked points is wrong, or of a mesh's surface has
another sheet too near."""
SOME_FAILED = 3
"""Exit code of a run that was done but for some meshes."""


def counted(n: int, one: str, many: str = "") -> str:
    """Return a number of things in words: ``1 mesh``, ``2 meshes``."""
    return f"{n} {one if n == 1 else many or one + 's'}"


def measured(error: dict[str, Any]) -> str:
    """Say how wrong a dataset is."""
    if not error["n_checked"]:
        return "complete clouds: nothing was removed, so nothing was measured"
    lines = [
        f"measured against the oracle on {error['n_checked']} pairs of view and point: "
        f"{error['false_visible']:.3%} false visible, {error['false_hidden']:.3%} false hidden; "
        f"of all {error['interval'][0]:.3%} to {error['interval'][1]:.3%} are wrong, with {CONFIDENCE:.0%} confidence"
    ]
    worst = error.get("worst_view")
    if worst is not None and worst["share"] > BAD:
        where = f"view {worst['view']} of {worst['mesh']}"
        lines.append(
            f"warning: {worst['share']:.0%} of the points checked in {where} are wrong, and "
            f"more than 1 % in {error['bad_views']:.1%} of the views checked. --method exact has no such views."
        )
    return "\n".join(lines)


def stacked(document: dict[str, Any]) -> list[str]:
    """Warn of sheets that a method cannot tell apart."""
    found = document.get("stacked")
    if found is None or found["most"]["share"] <= BAD:
        return []
    most, method = found["most"], document["options"]["method"]
    return [
        f"warning: {most['share']:.0%} of the surface of {most['mesh']}, and {found['share']:.1%} of all, has another "
        f"sheet nearer than the tolerance of {method}, and may show through it. --method exact tells them apart."
    ]


def uncolored(document: dict[str, Any]) -> list[str]:
    """Say of how many meshes colours were wanted and are lacking, and what there is instead."""
    n = document["counts"].get("meshes_without_colors", 0)
    if not n:
        return []
    return [
        f"warning: of {n} of {counted(document['counts']['meshes'], 'mesh', 'meshes')} colours are lacking: where they "
        f"are, points have their material's, or are grey ({GREY}, {GREY}, {GREY})"
    ]


def inside(document: dict[str, Any]) -> list[str]:
    """Warn of cameras inside the bounding box of their object."""
    n = document["counts"].get("views_inside_the_bounding_box", 0)
    if not n:
        return []
    return [f"warning: {counted(n, 'camera')} inside the bounding box of the object seen. Raise --distance or --range?"]


def picture(path: Path) -> str:
    """Say where a contact sheet is, or what it would take."""
    return str(path) if path.exists() else "none: that needs Pillow, pip install 'zbuf-occlude[report]'"


def summary(document: dict[str, Any], out: Path) -> str:
    """Say what was made, how wrong it is, and where it is."""
    counts, error, files = document["counts"], document["error"], document["files"]
    n_files = ", ".join(f"{split}: {len(files[split])}" for split in SPLITS if split in files)
    names = sorted({name for split in SPLITS for name in files.get(split, [])})
    others = f" and {len(names) - 1} more" if len(names) > 1 else ""
    n_used = counts["meshes"] - counts["meshes_failed"]
    options = document["options"]
    how = "complete" if options["complete"] else f"by {options['method']}"
    why = [f"because {options['reason']}"] if options["reason"] and not options["complete"] else []
    n_kept = sum(counts["clouds_by_split"].values())
    left_out = f" ({counts['clouds']} made; {document['format']} has no place for the others)"
    lines = [
        f"{counted(n_kept, 'cloud')}{left_out if n_kept < counts['clouds'] else ''} of "
        f"{counted(n_used, 'mesh', 'meshes')}, "
        f"{counted(len(document['classes']), 'class', 'classes')}, {how}{on(document['renderer'])}",
        *why,
        *([f"warning: {document['renderer_remark']}"] if document.get("renderer_remark") else []),
        measured(error),
        *stacked(document),
        *uncolored(document),
        *inside(document),
        f"data      {out / names[0]}{others} ({n_files})",
        f"manifest  {out / MANIFEST}",
        f"picture   {picture(out / CONTACT_SHEET)}",
    ]
    if document["failures"]:
        lines.append(f"{counted(len(document['failures']), 'mesh', 'meshes')} failed:")
        lines += [f"  {key}: {reason}" for key, reason in document["failures"].items()]
    return "\n".join(lines)
