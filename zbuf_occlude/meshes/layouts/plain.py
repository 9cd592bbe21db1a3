"""Plain trees: the first folder is the class, folders called train, val or test are splits."""

import re
from pathlib import PurePosixPath

from zbuf_occlude.meshes.labels import SPLIT_WORDS
from zbuf_occlude.meshes.layouts import Arranged
from zbuf_occlude.meshes.layouts.tree import Place, Tree


def arrange(tree: Tree) -> Arranged:
    """Take any tree.

    The label is the first folder below the one given, splits apart; the folder itself when its files lie right in it;
    for a single file its name without its ending and number, ``chair`` for ``chair_0003.off``. Without a split folder
    the split is "train". The key is the path from the class folder on.
    """
    if tree.single:
        name = tree.files[0].name
        stem = PurePosixPath(name).stem
        return [Place(tree.files[0], name, re.sub(r"[\W_]*\d+$", "", stem) or stem)], []
    root = PurePosixPath(tree.root)
    while root.name.lower() in SPLIT_WORDS:
        root = root.parent
    places = []
    flat = False
    for file in tree.files:
        relative = tree.parts(file)[len(root.parts) :]
        if not _class_folders(relative):  # the folder is the class
            relative = (root.name, *relative) if root.name else relative
            flat = True
        folders = _class_folders(relative)
        splits = [SPLIT_WORDS[part.lower()] for part in relative[:-1] if part.lower() in SPLIT_WORDS]
        label = folders[0] if folders else file.stem
        places.append(Place(file, "/".join(relative), label, splits[0] if splits else "train"))
    if flat and len({place.label for place in places}) == 1:
        return places, ["it has no classes: its files lie in one folder; --labels FILE gives some"]
    return places, []


def _class_folders(relative: tuple[str, ...]) -> list[str]:
    return [part for part in relative[:-1] if part.lower() not in SPLIT_WORDS]
