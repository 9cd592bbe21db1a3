"""What `generate` and `merge` say at the end."""

from pathlib import Path
from typing import Any

from zbuf_occlude.dataset.folder import CONTACT_SHEET, MANIFEST
from zbuf_occlude.meshes.collection import SPLITS

SOME_FAILED = 3
"""Exit code of a run that was done but for some meshes."""


def summary(document: dict[str, Any], out: Path) -> str:
    """Say what was made, how wrong it is, and where it is."""
    counts, error, files = document["counts"], document["error"], document["files"]
    lines = [
        f"{counts['clouds']} clouds of {counts['meshes'] - counts['meshes_failed']} meshes, "
        f"{len(document['classes'])} classes, by {document['options']['method']} on {document['renderer']}",
        f"measured against the oracle on {error['n_checked']} pairs of view and point: "
        f"{error['false_visible']:.3%} false visible, {error['false_hidden']:.3%} false hidden",
        f"data      {out}/ply_data_*.h5 ({', '.join(f'{s}: {len(files[s])}' for s in SPLITS if s in files)} files)",
        f"manifest  {out / MANIFEST}",
        f"picture   {out / CONTACT_SHEET}",
    ]
    if document["failures"]:
        lines.append(f"{len(document['failures'])} meshes failed:")
        lines += [f"  {key}: {reason}" for key, reason in document["failures"].items()]
    return "\n".join(lines)
