"""Collections without classes of their own: Objaverse, ABC, Thingi10K, each known by how its files are called."""

import gzip
import re
import zlib
from pathlib import PurePosixPath

from zbuf_occlude.errors import OptionError
from zbuf_occlude.meshes.labels import Label, parse_json
from zbuf_occlude.meshes.layouts import Arranged
from zbuf_occlude.meshes.layouts.tree import ALL, Place, Tree

NONE = "it has no classes; --labels FILE gives some"
LVIS = "lvis-annotations.json.gz"


def objaverse(tree: Tree) -> Arranged | None:
    """Take GLB files named by 32 hexadecimal digits, or in folders as objaverse packs them, glbs/000-023.

    The key is the uid, LVIS's classes are taken if they lie there.
    """
    packed = all(re.search(r"/glbs/\d{3}-\d{3}$", str(tree.named(file).parent)) for file in tree.files)
    names = _names(tree, r"(.+)\.glb" if packed else r"([0-9a-f]{32})\.glb")
    if names is None:
        return None
    labels: dict[str, Label] = {}
    for folder in list(tree.named(names[0][0]).parents)[:4]:  # 000-023, glbs, hf-objaverse-v1, one more
        if not labels and (data := tree.read(folder / LVIS)) is not None:
            labels = _labels_of_lvis(data)
    if not labels:
        return _all_of("objaverse", names), [NONE]
    places = [Place(file, uid, labels[uid].label or "objaverse") for file, uid in names if uid in labels]
    if not places:
        return _all_of("objaverse", names), [f"{LVIS} has none of its objects", NONE]
    left_out = len(names) - len(places)
    return places, [f"classes from {LVIS}" + (f"; {left_out} objects that it has not are left out" if left_out else "")]


def _labels_of_lvis(data: bytes) -> dict[str, Label]:
    """Labels by uid; none where the file is damaged."""
    try:
        return {label.key: label for label in parse_json(gzip.decompress(data), LVIS)}
    except (OSError, EOFError, zlib.error, OptionError):
        return {}


def abc(tree: Tree) -> Arranged | None:
    """Take the names of the ABC dataset: an eight-digit number, a hash, the kind of file and a part."""
    names = _names(tree, r"(\d{8}_[0-9a-f]{24}_[a-z0-9]+_\d{3})\.(?:obj|stl|ply|off)")
    return None if names is None else (_all_of("abc", names), [NONE])


def thingi10k(tree: Tree) -> Arranged | None:
    """Take files named by numbers in a folder raw_meshes, or below one named like the collection."""
    names = _names(tree, r"(\d+)\.(?:stl|obj|ply|off)")
    folders = {part.lower() for file, _ in names or () for part in tree.parts(file)[:-1]}
    if names is None or not any(folder == "raw_meshes" or folder.startswith("thingi10k") for folder in folders):
        return None
    return _all_of("thingi10k", names), [NONE]


def _names(tree: Tree, pattern: str) -> list[tuple[PurePosixPath, str]] | None:
    """Return what a pattern finds in the names of all files; None when one has another name, or no name is left."""
    names = []
    for file in tree.files:
        match = re.fullmatch(pattern, file.name, re.IGNORECASE)
        if match is not None:
            names.append((file, match[1]))
        elif file.name != ALL:
            return None
    return names or None


def _all_of(label: str, names: list[tuple[PurePosixPath, str]]) -> list[Place]:
    return [Place(file, name, label) for file, name in names]
