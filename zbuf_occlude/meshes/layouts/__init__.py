"""The table of layouts: how the folders of published collections say what is of which class and split.

A layout is one row here and one function, which looks at a `Tree` and returns the `Place` of each file and remarks to
be shown, or None when the tree is not of this layout. The first row that takes a tree has it; the last takes any.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module

from zbuf_occlude.meshes.layouts.tree import Place, Tree

Arranged = tuple[list[Place], list[str]]
"""The places of files, and what a person should know about where classes and splits come from."""


@dataclass(frozen=True)
class Layout:
    """One row of the table of layouts.

    Parameters
    ----------
    name : str
    summary : str
        The paths that make it, one line.
    function : str
        "module:function" in this package; imported when a tree is looked at.
    up : {"z", "y"}, optional
        The axis that points up in its files; by default as `load_mesh` takes the format.
    """

    name: str
    summary: str
    function: str
    up: str | None = None

    def arrange(self, tree: Tree) -> Arranged | None:
        """Place the files of a tree; None when it is not of this layout."""
        module, _, name = self.function.partition(":")
        arrange: Callable[[Tree], Arranged | None] = getattr(import_module(f"{__name__}.{module}"), name)
        return arrange(tree)


LAYOUTS: tuple[Layout, ...] = (
    Layout(
        "ShapeNetCore",
        "SYNSET/MODEL/models/model_normalized.obj (v2), SYNSET/MODEL/model.obj (v1), SYNSET/MODEL.glb",
        "shapenet:arrange",
        up="y",
    ),
    Layout("3D-FUTURE", "MODEL/raw_model.obj, with model_info.json above", "future:arrange", up="y"),
    Layout(
        "Objaverse", "UID.glb, the uid being 32 hexadecimal digits, or glbs/000-023/UID.glb", "unlabelled:objaverse"
    ),
    Layout("ABC", "NUMBER_HASH_trimesh_000.obj", "unlabelled:abc"),
    Layout("Thingi10K", "raw_meshes/NUMBER.stl", "unlabelled:thingi10k"),
    Layout("ModelNet", "CLASS/{train,val,test}/FILE, anywhere below the folder", "modelnet:arrange"),
    Layout("plain", "CLASS/FILE, {train,val,test}/CLASS/FILE, or files of one class", "plain:arrange"),
)


def recognise(tree: Tree) -> tuple[Layout, Arranged]:
    """Return the first layout that takes a tree, and what it makes of it."""
    for layout in LAYOUTS:
        if (arranged := layout.arrange(tree)) is not None:
            return layout, arranged
    raise AssertionError("the last row takes every tree")
