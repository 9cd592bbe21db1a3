"""3D-FUTURE: MODEL/raw_model.obj and MODEL/normalized_model.obj, classes in model_info.json."""

import json
from pathlib import PurePosixPath
from typing import Any

from zbuf_occlude.meshes.layouts import Arranged
from zbuf_occlude.meshes.layouts.tree import ALL, Place, Tree

INFO = "model_info.json"
_RAW, _NORMALIZED = "raw_model.obj", "normalized_model.obj"
UNKNOWN = "unknown"
"""The class of all models where none has one."""


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
    named = [(tree.named(file).parent.name, file) for file in models.values()]
    for column in ("category", "super-category"):  # not both: one category is within another's super-category
        classes = {name: str(row[column]) for name, row in info.items() if row.get(column)}
        places = [Place(file, name, classes[name]) for name, file in named if name in classes]
        if places:
            said = f"classes from {INFO}" + (f", its {column}" if column != "category" else "")
            if left_out := len(named) - len(places):
                said += f"; models without one are left out: {left_out:,}"
            break
    else:
        places = [Place(file, name, UNKNOWN) for name, file in named]
        said = f"it has no classes: there is no {INFO} above the models that has some"
    return places, [said, "it has no splits: everything is in train"]


def _information(tree: Tree, above: PurePosixPath) -> dict[str, dict[str, Any]]:
    try:
        rows = json.loads(tree.read(above / INFO) or b"[]")
        return {str(row["model_id"]): row for row in rows}
    except (ValueError, LookupError, TypeError, RecursionError):
        return {}
