"""What `generate` and `merge` say at the end."""

from pathlib import Path
from typing import Any

from zbuf_occlude.dataset.folder import CONTACT_SHEET, MANIFEST
from zbuf_occlude.dataset.formats import find_format
from zbuf_occlude.meshes.collection import SPLITS

SOME_FAILED = 3
"""Exit code of a run that was done but for some meshes."""


def measured(error: dict[str, Any]) -> str:
    """Say how wrong a dataset is."""
    if not error["n_checked"]:
        return "complete clouds: nothing was removed, so nothing was measured"
    return (
        f"measured against the oracle on {error['n_checked']} pairs of view and point: "
        f"{error['false_visible']:.3%} false visible, {error['false_hidden']:.3%} false hidden"
    )


def summary(document: dict[str, Any], out: Path) -> str:
    """Say what was made, how wrong it is, and where it is."""
    counts, error, files = document["counts"], document["error"], document["files"]
    n_files = ", ".join(f"{split}: {len(files[split])}" for split in SPLITS if split in files)
    options = document["options"]
    how = "complete" if options["complete"] else f"by {options['method']}"
    why = [f"because {options['reason']}"] if options["reason"] and not options["complete"] else []
    lines = [
        f"{counts['clouds']} clouds of {counts['meshes'] - counts['meshes_failed']} meshes, "
        f"{len(document['classes'])} classes, {how} on {document['renderer']}",
        *why,
        measured(error),
        f"data      {out}/{find_format(document['format']).patterns[0]} ({n_files} files)",
        f"manifest  {out / MANIFEST}",
        f"picture   {out / CONTACT_SHEET}",
    ]
    if document["failures"]:
        lines.append(f"{len(document['failures'])} meshes failed:")
        lines += [f"  {key}: {reason}" for key, reason in document["failures"].items()]
    return "\n".join(lines)
