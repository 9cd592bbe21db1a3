"""The folder layouts of published collections, from which each mesh gets its key, class and split.

A layout is one row of a table and one function. The function returns the `FoundMesh` of each file of a `Tree` and
remarks for the user, or None for a tree of another layout. The first row that accepts a tree is used; the last accepts
any.
"""

import json
import re
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import PurePosixPath
from typing import Any, NamedTuple, TypeVar

from zbuf_occlude.base.errors import OptionError
from zbuf_occlude.meshes.labels import SPLIT_WORDS, Label, parse_csv, parse_json, unpacked
from zbuf_occlude.meshes.tree import ALL, Tree

_Value = TypeVar("_Value")

_LVIS, _FUTURE_INFO = "lvis-annotations.json.gz", "model_info.json"
_RAW, _NORMALIZED = "raw_model.obj", "normalized_model.obj"  # 3D-FUTURE
SHAPENET_CLASSES = {
    "02691156": "airplane", "02747177": "trash bin", "02773838": "bag", "02801938": "basket", "02808440": "bathtub",
    "02818832": "bed", "02828884": "bench", "02834778": "bicycle", "02843684": "birdhouse", "02858304": "boat",
    "02871439": "bookshelf", "02876657": "bottle", "02880940": "bowl", "02924116": "bus", "02933112": "cabinet",
    "02942699": "camera", "02946921": "can", "02954340": "cap", "02958343": "car", "02992529": "cellphone",
    "03001627": "chair", "03046257": "clock", "03085013": "keyboard", "03207941": "dishwasher",
    "03211117": "display", "03261776": "earphone", "03325088": "faucet", "03337140": "file", "03467517": "guitar",
    "03513137": "helmet", "03593526": "jar", "03624134": "knife", "03636649": "lamp", "03642806": "laptop",
    "03691459": "loudspeaker", "03710193": "mailbox", "03759954": "microphone", "03761084": "microwave",
    "03790512": "motorbike", "03797390": "mug", "03928116": "piano", "03938244": "pillow", "03948459": "pistol",
    "03991062": "flowerpot", "04004475": "printer", "04074963": "remote", "04090263": "rifle", "04099429": "rocket",
    "04225987": "skateboard", "04256520": "sofa", "04330267": "stove", "04379243": "table", "04401088": "telephone",
    "04460130": "tower", "04468005": "train", "04530566": "watercraft", "04554684": "washer",
}  # fmt: skip
"""ShapeNetCore's classes by synset: 55 of v2, and bicycle and boat of v1."""

_SHAPENET_PATH = re.compile(
    r"(?P<above>.*)/(?P<synset>\d{8})/(?P<model>[^/]+?)(?:/models/model_normalized|/model|)\.(?:obj|glb|gltf|ply|off|stl)$",
    re.IGNORECASE,
)
# in an unpublished synset only files named like models are models
_SHAPENET_END = re.compile(r"(?:/models/model_normalized|/model|/[0-9a-z]{20,40})\.[a-z]+$", re.IGNORECASE)


class FoundMesh(NamedTuple):
    """A mesh file with its key, class and split, as of `MeshEntry`."""

    file: PurePosixPath  # relative to the tree's root
    key: str
    label: str
    split: str = "train"


FoundMeshes = tuple[list[FoundMesh], list[str]]
"""The meshes of a tree, and remarks on the source of their classes and splits."""


class FolderLayout(NamedTuple):
    """One row of the table of layouts."""

    name: str
    find: Callable[[Tree], FoundMeshes | None]
    up: str | None = None  # axis that points up in the files; None: the default of `load_mesh`


def recognise(tree: Tree) -> tuple[FolderLayout, FoundMeshes]:
    """Return the first layout that accepts a tree, and the meshes that it finds."""
    return next((layout, found) for layout in LAYOUTS if (found := layout.find(tree)) is not None)


def _shapenet(tree: Tree) -> FoundMeshes | None:
    """Accept a tree in which every file is a model of a synset; the key is SYNSET/MODEL."""
    matches = {}
    for file in tree.files:
        name = str(tree.named(file))
        match = _SHAPENET_PATH.fullmatch(name)
        if match is not None and (match["synset"] in SHAPENET_CLASSES or _SHAPENET_END.search(name)):
            matches[file] = match
        elif file.name != ALL:
            return None
    if not matches:
        return None
    above = PurePosixPath(next(iter(matches.values()))["above"] or "/")
    named = _rows(tree, above / "taxonomy.json", lambda row: (row["synsetId"], str(row["name"]).split(",")[0].strip()))
    names = SHAPENET_CLASSES | named
    splits, from_splits = _shapenet_splits(tree, above)
    found, n_unlisted = [], 0
    for file, match in matches.items():
        synset, model = match["synset"], match["model"]
        split = splits.get(f"{synset}/{model}", splits.get(model))
        n_unlisted += split is None
        found.append(FoundMesh(file, f"{synset}/{model}", names.get(synset, synset), split or "train"))
    if splits and n_unlisted:
        from_splits += f"; {n_unlisted} not listed there are in train"
    return found, ["class names from " + ("taxonomy.json" if named else "the published list"), from_splits]


def _shapenet_splits(tree: Tree, above: PurePosixPath) -> tuple[dict[str, str], str]:
    """Return the split of each SYNSET/MODEL or MODEL listed in a file above the synsets, and a remark on the file."""
    for name, parse in (("PCN.json", parse_json), ("all.csv", parse_csv)):
        if (data := tree.read(above / name)) is not None:
            rows = parse(data, str(above / name))
            return {row.key: row.split for row in rows if row.split}, f"splits from {name}"
    return {}, "no all.csv or PCN.json above the synsets: everything is in train"


def _future(tree: Tree) -> FoundMeshes | None:
    """Accept a tree of raw_model.obj and normalized_model.obj; the key is the model's id.

    The raw model takes precedence.
    """
    models: dict[PurePosixPath, PurePosixPath] = {}
    for file in tree.files:
        if file.name.lower() not in (_RAW, _NORMALIZED, ALL):
            return None
        if file.name != ALL and (file.name.lower() == _RAW or file.parent not in models):
            models[file.parent] = file
    if not models:
        return None
    above = tree.named(next(iter(models.values()))).parent.parent
    info = _rows(tree, above / _FUTURE_INFO, lambda row: (row["model_id"], row))
    named = [(tree.named(file).parent.name, file) for file in models.values()]
    for column in ("category", "super-category"):  # not both: one category is within another's super-category
        classes = {name: str(row[column]) for name, row in info.items() if row.get(column)}
        found = [FoundMesh(file, name, classes[name]) for name, file in named if name in classes]
        if found:
            said = f"classes from {_FUTURE_INFO}" + (f", its {column}" if column != "category" else "")
            if left_out := len(named) - len(found):
                said += f"; models without one are left out: {left_out:,}"
            break
    else:
        found = [FoundMesh(file, name, "unknown") for name, file in named]
        said = f"it has no classes: there is no {_FUTURE_INFO} above the models that has some"
    return found, [said, "it has no splits: everything is in train"]


def _objaverse(tree: Tree) -> FoundMeshes | None:
    """Accept GLB files named by 32 hexadecimal digits, or in objaverse's folders such as glbs/000-023.

    The key is the uid. Classes are LVIS's if its list is there.
    """
    packed = all(re.search(r"/glbs/\d{3}-\d{3}$", str(tree.named(file).parent)) for file in tree.files)
    names = _names(tree, r"(.+)\.glb" if packed else r"([0-9a-f]{32})\.glb")
    if names is None:
        return None
    labels: dict[str, Label] = {}
    for folder in list(tree.named(names[0][0]).parents)[:4]:  # 000-023, glbs, hf-objaverse-v1, one more
        if not labels and (data := tree.read(folder / _LVIS)) is not None:
            labels = _lvis_labels(data, folder / _LVIS)
    if not labels:
        return _without_classes("objaverse", names)
    found = [FoundMesh(file, uid, labels[uid].label or "objaverse") for file, uid in names if uid in labels]
    if not found:
        return _without_classes("objaverse", names, f"{_LVIS} has none of its objects")
    said = f"classes from {_LVIS}"
    if left_out := len(names) - len(found):
        said += f"; {left_out} objects without a class are left out"
    return found, [said]


def _lvis_labels(data: bytes, path: PurePosixPath) -> dict[str, Label]:
    """Return labels by uid; empty for a damaged file."""
    with suppress(OSError, EOFError, zlib.error):
        content = unpacked(data, path)  # raises for too large a content
        with suppress(OptionError):
            return {label.key: label for label in parse_json(content, _LVIS)}
    return {}


def _abc(tree: Tree) -> FoundMeshes | None:
    """Accept the names of the ABC dataset: an eight-digit number, a hash, the kind of file and a part."""
    names = _names(tree, r"(\d{8}_[0-9a-f]{24}_[a-z0-9]+_\d{3})\.(?:obj|stl|ply|off)")
    return None if names is None else _without_classes("abc", names)


def _thingi10k(tree: Tree) -> FoundMeshes | None:
    """Accept files named by numbers in a folder raw_meshes, or below one named like the collection."""
    names = _names(tree, r"(\d+)\.(?:stl|obj|ply|off)")
    folders = {part.lower() for file, _ in names or () for part in tree.parts(file)[:-1]}
    if names is None or not any(folder == "raw_meshes" or folder.startswith("thingi10k") for folder in folders):
        return None
    return _without_classes("thingi10k", names)


def _names(tree: Tree, pattern: str) -> list[tuple[PurePosixPath, str]] | None:
    """Return each file and the first group of a pattern in its name; None without files, or if one does not match."""
    names = []
    for file in tree.files:
        match = re.fullmatch(pattern, file.name, re.IGNORECASE)
        if match is not None:
            names.append((file, match[1]))
        elif file.name != ALL:
            return None
    return names or None


def _without_classes(label: str, names: list[tuple[PurePosixPath, str]], *said: str) -> FoundMeshes:
    return [FoundMesh(file, name, label) for file, name in names], [
        *said,
        "it has no classes; --labels FILE gives some",
    ]


def _modelnet(tree: Tree) -> FoundMeshes | None:
    """Accept a tree whose files all lie in a split folder of a class folder; the key begins at the class."""
    found = []
    for file in tree.files:
        *_, label, split, name = ("", "", *tree.parts(file))
        if split.lower() in SPLIT_WORDS and label not in ("", "/") and label.lower() not in SPLIT_WORDS:
            found.append(FoundMesh(file, f"{label}/{split}/{name}", label, SPLIT_WORDS[split.lower()]))
        elif name != ALL:
            return None
        else:  # a class folder that cannot be read
            found.append(FoundMesh(file, f"{split}/{name}", split))
    return found, []


def _plain(tree: Tree) -> FoundMeshes:
    """Accept any tree.

    The label is the first folder below the root that is no split folder; the root's name for files directly in it; for
    a single file its name without ending and number, ``chair`` for ``chair_0003.off``. Without a split folder the split
    is "train". The key is the path from the class folder on.
    """
    if tree.single:
        name = tree.files[0].name
        stem = PurePosixPath(name).stem
        return [FoundMesh(tree.files[0], name, re.sub(r"[\W_]*\d+$", "", stem) or stem)], []
    root = tree.root
    while root.name.lower() in SPLIT_WORDS:
        root = root.parent
    found = []
    flat = False
    for file in tree.files:
        relative = tree.parts(file)[len(root.parts) :]
        if not _class_folders(relative):  # the root is the class
            relative = (root.name, *relative) if root.name else relative
            flat = True
        folders = _class_folders(relative)
        splits = [SPLIT_WORDS[part.lower()] for part in relative[:-1] if part.lower() in SPLIT_WORDS]
        label = folders[0] if folders else file.stem
        found.append(FoundMesh(file, "/".join(relative), label, splits[0] if splits else "train"))
    if flat and len({place.label for place in found}) == 1:
        return found, ["it has no classes: its files lie in one folder; --labels FILE gives some"]
    return found, []


def _class_folders(relative: tuple[str, ...]) -> list[str]:
    return [part for part in relative[:-1] if part.lower() not in SPLIT_WORDS]


def _rows(tree: Tree, path: PurePosixPath, read_row: Callable[[Any], tuple[Any, _Value]]) -> dict[str, _Value]:
    """Return a name and a value for each row of a JSON file; empty where the file cannot be read."""
    try:
        return {str(name): value for name, value in map(read_row, json.loads(tree.read(path) or b"[]"))}
    except (ValueError, LookupError, TypeError, RecursionError):
        return {}


LAYOUTS: tuple[FolderLayout, ...] = (
    # SYNSET/MODEL/models/model_normalized.obj (v2), SYNSET/MODEL/model.obj (v1), SYNSET/MODEL.glb
    FolderLayout("ShapeNetCore", _shapenet, up="y"),
    # MODEL/raw_model.obj, with model_info.json above
    FolderLayout("3D-FUTURE", _future, up="y"),
    # UID.glb, the uid being 32 hexadecimal digits, or glbs/000-023/UID.glb
    FolderLayout("Objaverse", _objaverse),
    # NUMBER_HASH_trimesh_000.obj
    FolderLayout("ABC", _abc),
    # raw_meshes/NUMBER.stl
    FolderLayout("Thingi10K", _thingi10k),
    # CLASS/{train,val,test}/FILE, anywhere below the folder
    FolderLayout("ModelNet", _modelnet),
    # CLASS/FILE, {train,val,test}/CLASS/FILE, or files of one class
    FolderLayout("plain", _plain),
)
