"""ModelNet10 and ModelNet40: CLASS/{train,val,test}/FILE, in the folder given or below folders that only wrap it."""

from zbuf_occlude.meshes.labels import SPLIT_WORDS
from zbuf_occlude.meshes.layouts import Arranged
from zbuf_occlude.meshes.layouts.tree import ALL, Place, Tree


def arrange(tree: Tree) -> Arranged | None:
    """Take a tree whose files all lie in a split folder of a class folder; the key begins at the class."""
    places = []
    for file in tree.files:
        *_, label, split, name = ("", "", *tree.parts(file))
        if split.lower() in SPLIT_WORDS and label not in ("", "/") and label.lower() not in SPLIT_WORDS:
            places.append(Place(file, f"{label}/{split}/{name}", label, SPLIT_WORDS[split.lower()]))
        elif name != ALL:
            return None
        else:  # a class folder that cannot be read
            places.append(Place(file, f"{split}/{name}", split))
    return places, []
