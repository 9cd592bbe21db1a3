"""3D-FUTURE: MODEL/raw_model.obj and MODEL/normalized_model.obj, classes in model_info.json."""

import json
from pathlib import PurePosixPath
from typing import Any

from zbuf_occlude.meshes.layouts import Arranged
from zbuf_occlude.meshes.layouts.tree import ALL, Place, Tree

INFO = "model_info.json"
_RAW, _NORMALIZED = "raw_model.obj", "normalized_model.obj"
UNKNOWN = "unknown"


def arrange(tree: Tree) -> Arranged | None:
    """Take a tree of raw_model.obj and normalized_model.obj. The key is the model's id; of two the raw one is read."""
    models: dict[PurePosixPath, PurePosixPath] = {}
    for file in tree.files:
        if file.name.lower() not in (_RAW, _NORMALIZED, ALL):
            return None
        if file.name != ALL and (file.name.lower() == _RAW or file.parent not in models):
            models[file.parent] = file
    if not models:
        return None
    above = tree.named(next(iter(models.values()))).parent.parent
    info = _information(tree, above)
    places = []
    for file in models.values():
        model = tree.named(file).parent.name
        row = info.get(model, {})
        places.append(Place(file, model, str(row.get("category") or row.get("super-category") or UNKNOWN)))
    remarks = [f"classes from {INFO}" if info else f"it has no classes: there is no {INFO} above the models"]
    return places, [*remarks, "it has no splits: everything is in train"]


def _information(tree: Tree, above: PurePosixPath) -> dict[str, dict[str, Any]]:
    try:
        rows = json.loads(tree.read(above / INFO) or b"[]")
        return {str(row["model_id"]): row for row in rows}
    except (ValueError, LookupError, TypeError, RecursionError):
        return {}
