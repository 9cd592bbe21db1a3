"""ShapeNetCore v1 and v2: SYNSET/MODEL/model.obj, SYNSET/MODEL/models/model_normalized.obj, SYNSET/MODEL.glb."""

import json
import re
from pathlib import PurePosixPath

from zbuf_occlude.meshes.labels import Label, parse_csv, parse_json
from zbuf_occlude.meshes.layouts import Arranged
from zbuf_occlude.meshes.layouts.tree import ALL, Place, Tree

NAMES = {
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
"""The published classes: 55 of v2, and bicycle and boat of v1."""

_PATH = re.compile(
    r"(?P<above>.*)/(?P<synset>\d{8})/(?P<model>[^/]+?)(?:/models/model_normalized|/model|)\.(?:obj|glb|gltf|ply|off|stl)$",
    re.IGNORECASE,
)
# of a synset that is not published only what looks like a model is one
_ENDS = re.compile(r"(?:/models/model_normalized|/model|/[0-9a-z]{20,40})\.[a-z]+$", re.IGNORECASE)


def arrange(tree: Tree) -> Arranged | None:
    """Take a tree of which every file is a model of a synset; the key is SYNSET/MODEL."""
    matches = {}
    for file in tree.files:
        name = str(tree.named(file))
        match = _PATH.fullmatch(name)
        if match is not None and (match["synset"] in NAMES or _ENDS.search(name)):
            matches[file] = match
        elif file.name != ALL:
            return None
    if not matches:
        return None
    above = PurePosixPath(next(iter(matches.values()))["above"] or "/")
    names, from_names = _class_names(tree, above)
    splits, from_splits = _splits(tree, above)
    places, n_unlisted = [], 0
    for file, match in matches.items():
        synset, model = match["synset"], match["model"]
        split = splits.get(f"{synset}/{model}", splits.get(model))
        n_unlisted += split is None
        places.append(Place(file, f"{synset}/{model}", names.get(synset, synset), split or "train"))
    remarks = [from_names]
    remarks.append(from_splits + (f"; {n_unlisted} not listed there are in train" if splits and n_unlisted else ""))
    return places, remarks


def _class_names(tree: Tree, above: PurePosixPath) -> tuple[dict[str, str], str]:
    data = tree.read(above / "taxonomy.json")
    try:
        rows = json.loads(data or b"[]")
        found = {str(row["synsetId"]): str(row["name"]).split(",")[0].strip() for row in rows}
    except (ValueError, LookupError, TypeError, RecursionError):
        found = {}
    if found:
        return NAMES | found, "class names from taxonomy.json"
    return NAMES, "class names from the published list"


def _splits(tree: Tree, above: PurePosixPath) -> tuple[dict[str, str], str]:
    """Return the split of each SYNSET/MODEL or MODEL that a file above the synsets lists.

    Raises
    ------
    OptionError
        The file cannot be read, or names a split that there is not.
    """
    for name, parse in (("PCN.json", parse_json), ("all.csv", parse_csv)):
        if (data := tree.read(above / name)) is not None:
            rows: list[Label] = parse(data, str(above / name))
            return {row.key: row.split for row in rows if row.split}, f"splits from {name}"
    return {}, "no all.csv or PCN.json above the synsets: everything is in train"
