"""What `generate` understood of the meshes, before it begins: a table of classes and splits, and what looks wrong."""

from collections import Counter

from zbuf_occlude.dataset.formats import Format
from zbuf_occlude.dataset.presets import Preset
from zbuf_occlude.meshes.collection import SPLITS, MeshCollection

MOST_ROWS = 60
"""Of a collection of more classes the largest of them are shown."""


def overview(meshes: MeshCollection, format: Format, preset: Preset | None = None, *, limited: bool = False) -> str:
    """Return remarks, the table of classes and splits, and warnings."""
    counts = Counter((entry.label, entry.split) for entry in meshes)
    return "\n".join([*meshes.remarks, *_table(counts), *_warnings(meshes, counts, format, preset, limited)])


def _table(counts: Counter[tuple[str, str]]) -> list[str]:
    splits = [split for split in SPLITS if any(found == split for _, found in counts)]
    totals = Counter[str]()
    for (label, _), count in counts.items():
        totals[label] += count
    shown = sorted(label for label, _ in totals.most_common(MOST_ROWS))
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
            f"{format.name} is tested by published code that divides by a tenth of the test objects, so there must be "
            f"{format.least_tested} or more; here are {n_tested}. Training is not concerned."
        )
    return [f"warning: {warning}" for warning in warnings]


def _few(names: list[str]) -> str:
    """Return the first names of a list, and the number of others."""
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
