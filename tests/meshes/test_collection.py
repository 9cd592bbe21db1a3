"""MeshCollection: keys, classes and splits of folders, archives, published collections; labels; who comes first."""

import gzip
import json
import os
import pickle
import re
import zipfile
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zbuf_occlude import ArgumentError, Mesh, MeshCollection, MeshError, OptionError, load_mesh
from zbuf_occlude.meshes.collection import MeshEntry
from zbuf_occlude.meshes.labels import read_labels

TRIANGLES = {
    ".off": "OFF 3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    ".obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
}
UID = "0123456789abcdef0123456789abcd{:02x}"
ABC = "00000050_80d90bfdd2e74e709956122a_trimesh_000"
MODEL = "1a04e3eab45ca15dd86060f189eb1{:02d}"


def plant(root: Path, *names: str) -> Path:
    for name in names:
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(TRIANGLES.get(path.suffix.lower(), ""))
    return root


def facts(meshes: Iterable[MeshEntry]) -> list[tuple[str, str, str]]:
    return [(entry.key, entry.label, entry.split) for entry in meshes]


MODELNET = ("chair/train/chair_0002.off", "chair/test/chair_0890.off", "night_stand/train/night_stand_0001.off")


@pytest.mark.parametrize("wrapper", ["", "ModelNet40/", "a/ModelNet10/"])
def test_modelnet_below_wrappers(tmp_path: Path, wrapper: str) -> None:
    meshes = MeshCollection.from_paths(plant(tmp_path / "data", *(wrapper + name for name in MODELNET)))
    assert facts(meshes) == [
        ("chair/test/chair_0890.off", "chair", "test"),
        ("chair/train/chair_0002.off", "chair", "train"),
        ("night_stand/train/night_stand_0001.off", "night_stand", "train"),
    ]
    assert meshes.remarks == (f"{tmp_path / 'data'}: layout ModelNet",)


@pytest.mark.parametrize("ending", ["/models/model_normalized.obj", "/model.obj", ".glb"])
@pytest.mark.parametrize("wrapper", ["", "ShapeNetCore.v2/"])
@pytest.mark.parametrize("model", [MODEL, "{}"])
def test_shapenet(tmp_path: Path, ending: str, wrapper: str, model: str) -> None:
    names = [f"02691156/{model.format(0)}", f"02691156/{model.format(1)}", f"03001627/{model.format(2)}"]
    root = plant(tmp_path, *(wrapper + name + ending for name in names))
    meshes = MeshCollection.from_paths(root)
    assert facts(meshes) == [
        (names[0], "airplane", "train"), (names[1], "airplane", "train"), (names[2], "chair", "train"),
    ]  # fmt: skip
    assert "layout ShapeNetCore; class names from the published list; no all.csv or PCN.json" in meshes.remarks[0]
    part = MeshCollection.from_paths(root / wrapper / "03001627")
    assert facts(part) == facts(meshes)[2:], "a part of it has the keys of the whole"


def test_shapenets_splits_and_names_come_from_its_own_files(tmp_path: Path) -> None:
    names = [f"02691156/{MODEL.format(i)}" for i in range(4)]
    plant(tmp_path, *(f"{name}/models/model_normalized.obj" for name in names))
    (tmp_path / "taxonomy.json").write_text(json.dumps([{"synsetId": "02691156", "name": "plane,jet", "children": []}]))
    rows = [f"{i},02691156,02690373,{MODEL.format(i)},{split}" for i, split in enumerate(["train", "val", "test"])]
    (tmp_path / "all.csv").write_text("\n".join(["id,synsetId,subSynsetId,modelId,split", *rows]))
    meshes = MeshCollection.from_paths(tmp_path)
    assert [(e.label, e.split) for e in meshes] == [("plane", s) for s in ("train", "val", "test", "train")]
    assert "class names from taxonomy.json; splits from all.csv; 1 not listed there are in train" in meshes.remarks[0]
    pcn = [{"taxonomy_id": "02691156", "taxonomy_name": "airplane", "train": [], "val": [], "test": [MODEL.format(0)]}]
    (tmp_path / "PCN.json").write_text(json.dumps(pcn))
    assert MeshCollection.from_paths(tmp_path)[0].split == "test"


def test_a_split_that_there_is_not_refuses_by_its_line(tmp_path: Path) -> None:
    """One unknown word had the whole list ignored, and everything in train."""
    names = [f"02691156/{MODEL.format(i)}" for i in range(3)]
    plant(tmp_path, *(f"{name}/models/model_normalized.obj" for name in names))
    rows = [f"{i},02691156,02690373,{MODEL.format(i)},{split}" for i, split in enumerate(["train", "holdout", "test"])]
    (tmp_path / "all.csv").write_text("\n".join(["id,synsetId,subSynsetId,modelId,split", *rows]))
    with pytest.raises(OptionError, match=r"all\.csv, line 3 .*train, val or test.*'holdout'"):
        MeshCollection.from_paths(tmp_path)
    (tmp_path / "all.csv").write_text("no,such,columns\n1,2,3\n")
    with pytest.raises(OptionError, match=r"all\.csv must be .*found: no, such, columns"):
        MeshCollection.from_paths(tmp_path)


def test_shapenet_packed_by_classes(tmp_path: Path) -> None:
    """As its hub has it, SYNSET.zip with SYNSET/MODEL/models/...: like the folder unpacked, or unpacked in part."""
    names = [f"{synset}/{MODEL.format(i)}" for i, synset in enumerate(["02691156", "02691156", "03001627", "04379243"])]
    whole = plant(tmp_path / "whole", *(f"{name}/models/model_normalized.obj" for name in names))
    packed = tmp_path / "packed"
    packed.mkdir()
    for number, synset in enumerate(["02691156", "03001627", "04379243"]):
        archive(packed / f"{synset}.zip", whole / synset, f"{synset}/" if number < 2 else "")
    splits = ["val", "test", "val", "test"]
    rows = [f"{name.replace('/', ',')},{split}" for name, split in zip(names, splits, strict=True)]
    table = "\n".join(["synsetId,modelId,split", *rows])
    for root in (whole, packed):
        (root / "all.csv").write_text(table)
    expected, found = (MeshCollection.from_paths(root) for root in (whole, packed))
    assert facts(found) == facts(expected)
    assert [entry.split for entry in found] == splits
    assert found.classes == ["airplane", "chair", "table"]
    for one, other in zip(found, expected, strict=True):
        assert one.load().vertices.tobytes() == other.load().vertices.tobytes()
        assert one.load().origin.sha256 == other.load().origin.sha256
    plant(packed, f"{names[2]}/models/model_normalized.obj")  # one class is unpacked: its archive is not read too
    again = MeshCollection.from_paths(packed)
    assert facts(again) == facts(expected)
    assert ".zip" not in str(again[2].path)
    assert ".zip" in str(again[0].path)


def test_a_folder_of_archives_and_nothing_else(tmp_path: Path) -> None:
    packed = tmp_path / "packed"
    (packed / "more").mkdir(parents=True)
    archive(packed / "cup.zip", plant(tmp_path / "m", "a.off", "b.off"))
    archive(packed / "more" / "jar.zip", tmp_path / "m", "jar/")
    jars = MeshCollection.from_paths(packed / "more")
    assert facts(jars) == [("jar/a.off", "jar", "train"), ("jar/b.off", "jar", "train")]
    meshes = MeshCollection.from_paths(packed)
    assert [entry.key for entry in meshes] == ["cup/a.off", "cup/b.off", "more/jar/a.off", "more/jar/b.off"]
    plant(packed, "cup/c.off")  # beside meshes archives are no class folders
    assert [entry.key for entry in MeshCollection.from_paths(packed)] == ["cup/c.off"]
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "02691156.zip").write_bytes(b"PK nonsense")
    with pytest.raises(MeshError, match=r"02691156\.zip: cannot read the ZIP archive"):
        MeshCollection.from_paths(tmp_path / "bad")


def test_shapenet_has_y_up(tmp_path: Path) -> None:
    plant(tmp_path, f"02691156/{MODEL.format(0)}/model.obj")
    (entry,) = MeshCollection.from_paths(tmp_path)
    assert entry.load().vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 0, 1]]
    (entry,) = MeshCollection.from_paths(tmp_path, up="z")
    assert entry.load().vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


def test_of_3d_future_what_has_no_category_is_left_out_and_counted(tmp_path: Path) -> None:
    """A super-category holds other categories: a class of its name beside theirs would be of the same things."""
    plant(tmp_path, *(f"{i}/{name}_model.obj" for i in "abcd" for name in ("raw", "normalized")))
    rows = [("a", "Wardrobe"), ("b", None), ("c", "Wardrobe"), ("d", "")]
    info = [{"model_id": i, "super-category": "Cabinets", "category": category} for i, category in rows]
    (tmp_path / "model_info.json").write_text(json.dumps(info))
    meshes = MeshCollection.from_paths(tmp_path)
    assert facts(meshes) == [("a", "Wardrobe", "train"), ("c", "Wardrobe", "train")]
    assert all(entry.path is not None and entry.path.name == "raw_model.obj" for entry in meshes)
    for word in ("layout 3D-FUTURE", "classes from model_info.json", "left out: 2", "it has no splits"):
        assert word in meshes.remarks[0]
    for row in info:
        row["category"] = None
    (tmp_path / "model_info.json").write_text(json.dumps(info))
    meshes = MeshCollection.from_paths(tmp_path)
    assert (len(meshes), meshes.classes) == (4, ["Cabinets"])
    assert "super-category" in meshes.remarks[0]
    (tmp_path / "model_info.json").unlink()
    meshes = MeshCollection.from_paths(tmp_path)
    assert (len(meshes), meshes.classes) == (4, ["unknown"])
    assert "it has no classes" in meshes.remarks[0]


@pytest.mark.parametrize(
    ("layout", "name", "key"),
    [
        ("Objaverse", f"{UID.format(1)}.glb", UID.format(1)),
        ("Objaverse", "glbs/000-023/one.glb", "one"),
        ("ABC", f"00000050/{ABC}.obj", ABC),
        ("Thingi10K", "Thingi10K/raw_meshes/32770.stl", "32770"),
    ],
)
def test_collections_without_classes_say_so(tmp_path: Path, layout: str, name: str, key: str) -> None:
    meshes = MeshCollection.from_paths(plant(tmp_path / "there", name))
    assert facts(meshes) == [(key, layout.lower(), "train")]
    assert f"layout {layout}; it has no classes; --labels FILE gives some" in meshes.remarks[0]


@pytest.mark.parametrize("above", ["", "downloads/hf-objaverse-v1/"])
def test_objaverse_takes_the_labels_of_lvis(tmp_path: Path, above: str) -> None:
    plant(tmp_path, *(f"{above}glbs/000-000/{UID.format(i)}.glb" for i in range(3)))
    lvis = json.dumps({"chair": [UID.format(0)], "cup": [UID.format(2), UID.format(99)]}).encode()
    (tmp_path / above / "lvis-annotations.json.gz").write_bytes(gzip.compress(lvis))
    for place in ("glbs", "glbs/000-000"):
        assert len(MeshCollection.from_paths(tmp_path / above / place)) == 2
    meshes = MeshCollection.from_paths(tmp_path)
    assert facts(meshes) == [(UID.format(0), "chair", "train"), (UID.format(2), "cup", "train")]
    assert "classes from lvis-annotations.json.gz; 1 objects without a class are left out" in meshes.remarks[0]


PCN = [
    {"taxonomy_id": "1", "taxonomy_name": "cup", "train": ["z"], "val": [], "test": ["a"]},
    {"taxonomy_id": "2", "taxonomy_name": "plate", "train": [], "val": ["c"], "test": []},
]
LABELS = {
    "labels.csv": b"uid, class, split\na, cup, test\nc.off,plate,val\nz,cup,train\n",
    "simple.json": b'{"a": "cup", "c": "plate", "z": "cup"}',
    "lvis.json": b'{"cup": ["a", "z"], "plate": ["c"]}',
    "lvis.json.gz": gzip.compress(b'{"cup": ["a", "z"], "plate": ["c"]}'),
    "PCN.json": json.dumps(PCN).encode(),
}


@pytest.mark.parametrize("name", LABELS)
def test_labels(tmp_path: Path, name: str) -> None:
    plant(tmp_path / "m", "a.off", "b.off", "c.off")
    (tmp_path / name).write_bytes(LABELS[name])
    meshes = MeshCollection.from_paths(tmp_path / "m", labels=tmp_path / name)
    assert [(entry.key, entry.label) for entry in meshes] == [("m/a.off", "cup"), ("m/c.off", "plate")]
    splits = ["train", "train"] if name.startswith(("simple", "lvis")) else ["test", "val"]
    assert [entry.split for entry in meshes] == splits
    assert "2 of 3 meshes are named there, the others left out" in meshes.remarks[-1]
    assert "1 of its labels match no mesh" in meshes.remarks[-1]
    assert MeshCollection.from_paths(tmp_path / "m")[0].key == meshes[0].key, "labels change no key, so no draw"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "must have a row of names and 1 to"),
        ("uid,colour\na,red\n", "found: uid, colour"),
        ("uid,class,split\na,cup,dev\n", "must name the splits train, val or test; it has 'dev'"),
        ("uid,class\n", "must be CSV"),
        ("[1, 2]", "it is JSON of another form"),
        ('{"a": ', "must be JSON; it cannot be read"),
        ("{}", "it has none"),
        ("uid,class\nnone,cup\n", "none of its 1 labels matches a mesh; the first label"),
        ("uid,class\ntwice,cup\n", "a label must match one mesh; 'twice' matches x/twice.off, y/twice.off. Write"),
        ("uid,class\nx/twice,cup\nx/twice.off,pan\n", "must have one label; 'x/twice.off' has 'cup' and 'pan'. Keep"),
        ("uid,split\nx/twice,val\nx/twice,test\n", "must have one label; 'x/twice.off' has 'val' and 'test'. Keep"),
        ("uid,class,split\nx/twice,test,\nx/twice,,test\n", "must have one label; 'x/twice.off' has 'test' and 'test'"),
        (f"uid,class\nx/twice,{'x' * 90}1\nx/twice,{'x' * 90}2\n", "must have one label; 'x/twice.off' has 'xxx"),
    ],
)
def test_labels_that_cannot_be_used(tmp_path: Path, content: str, message: str) -> None:
    plant(tmp_path / "m", "x/twice.off", "y/twice.off")
    (tmp_path / "labels").write_text(content)
    with pytest.raises(OptionError, match=message):
        MeshCollection.from_paths(tmp_path / "m", labels=tmp_path / "labels")
    with pytest.raises(OptionError, match="a file must be readable"):
        read_labels(tmp_path / "nowhere.csv")


def test_labels_that_agree_are_one(tmp_path: Path) -> None:
    """A model of ShapeNet is in two synsets, and here in one of them."""
    plant(tmp_path / "m", "1/a.off", "3/b.off")
    (tmp_path / "labels.csv").write_text("uid,class\n1/a,cup\n1/a.off,cup\n2/a,pan\n4/b,jar\n")
    meshes = MeshCollection.from_paths(tmp_path / "m", labels=tmp_path / "labels.csv")
    assert [entry.label for entry in meshes] == ["cup", "jar"]
    assert "1 of its labels match no mesh" in meshes.remarks[-1]


def test_more_labels_than_any_collection_has_are_refused(tmp_path: Path) -> None:
    """15 kB of gzip that say eight million."""
    path = tmp_path / "labels.json.gz"
    path.write_bytes(gzip.compress(b'{"a": [' + b"1," * 8_000_000 + b"1]}"))
    with pytest.raises(OptionError, match=r"labels\.json\.gz must have at most 1,000,000 labels"):
        read_labels(path)


def test_labels_from_a_pipe_are_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "labels.csv")
    with pytest.raises(OptionError, match="it must be a file, and is a device or a pipe"):
        read_labels(tmp_path / "labels.csv")


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize(
    ("content", "said"), [(b"", "the file is empty"), (b"x" * 49_000_000, "at most 48,000,000 bytes")]
)
def test_a_list_of_splits_that_cannot_be_read_is_not_taken_for_none(
    tmp_path: Path, content: bytes, said: str, packed: bool
) -> None:
    root = plant(tmp_path / "ShapeNetCore", "02691156/one/model.obj", "02691156/two/model.obj")
    (root / "all.csv").write_bytes(content)
    place = archive(tmp_path / "ShapeNetCore.zip", root) if packed else root
    with pytest.raises(MeshError, match=rf"all\.csv: .*{said}"):
        MeshCollection.from_paths(place)


def archive(path: Path, root: Path, prefix: str = "") -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as opened:
        for file in sorted(root.rglob("*")):
            opened.write(file, prefix + file.relative_to(root).as_posix())
        opened.writestr("__MACOSX/chair/train/._chair_0002.off", "rubbish")
    return path


@pytest.mark.parametrize("prefix", ["", "ModelNet40/"])
def test_archives_are_read_in_place(tmp_path: Path, prefix: str) -> None:
    root = plant(tmp_path / "unpacked", *MODELNET)
    packed = archive(tmp_path / "ModelNet40.zip", root, prefix)
    meshes = MeshCollection.from_paths(packed)
    assert facts(meshes) == facts(MeshCollection.from_paths(root))
    assert meshes[0].load().vertices.tobytes() == MeshCollection.from_paths(root)[0].load().vertices.tobytes()
    assert load_mesh(packed / f"{prefix}chair/train/chair_0002.off").name == "chair_0002"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ModelNet40.zip", "unpacked"], "nothing was unpacked"


def test_archives_that_cannot_be_used(tmp_path: Path) -> None:
    (tmp_path / "bad.zip").write_bytes(b"PK nonsense")
    with pytest.raises(MeshError, match=r"bad\.zip: cannot read the ZIP archive"):
        MeshCollection.from_paths(tmp_path / "bad.zip")
    plant(tmp_path / "m", "a.off")
    packed = archive(tmp_path / "good.zip", tmp_path / "m")
    with pytest.raises(MeshError, match=r"there is no such file in good\.zip"):
        load_mesh(packed / "b.off")
    data = bytearray(packed.read_bytes())
    data[40:44] = b"\xff" * 4
    packed.write_bytes(data)
    (entry,) = MeshCollection.from_paths(packed)
    with pytest.raises(MeshError, match=r"good\.zip/a\.off: cannot read it in good\.zip: .*damaged"):
        entry.load()
    with zipfile.ZipFile(tmp_path / "empty.zip", "w") as opened:
        opened.writestr("readme.txt", "none")
    with pytest.raises(MeshError, match="an archive must have meshes in it"):
        MeshCollection.from_paths(tmp_path / "empty.zip")


def test_names_that_lead_out_of_an_archive_are_none(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        for name in ("/chair/a.off", "../chair/b.off", "chair/c.off"):
            archive.writestr(name, TRIANGLES[".off"])
    assert facts(MeshCollection.from_paths(tmp_path / "a.zip")) == [("chair/c.off", "chair", "train")]


@pytest.mark.parametrize("content", [b"[" * 100_000, b"{}", b"\x1f\x8b damaged"])
def test_lists_beside_the_meshes_that_cannot_be_read_are_as_if_not_there(tmp_path: Path, content: bytes) -> None:
    for place, listed in (
        (f"a/{UID.format(0)}.glb", "lvis-annotations.json.gz"),
        ("b/02691156/one.glb", "taxonomy.json"),
        ("c/one/raw_model.obj", "model_info.json"),
    ):
        plant(tmp_path, place)
        packed = gzip.compress(content) if content[:1] == b"[" and listed.endswith(".gz") else content
        (tmp_path / place[0] / listed).write_bytes(packed)
        assert len(MeshCollection.from_paths(tmp_path / place[0])) == 1
    if content != b"{}":  # what would put everything into train
        plant(tmp_path, "d/02691156/one.glb")
        (tmp_path / "d" / "PCN.json").write_bytes(content)
        with pytest.raises(OptionError, match=r"PCN\.json must be .*cannot be read"):
            MeshCollection.from_paths(tmp_path / "d")
    (tmp_path / "labels.json").write_bytes(content)
    with pytest.raises(OptionError, match=r"must be JSON|must contain labels|cannot unpack gzip"):
        read_labels(tmp_path / "labels.json")


def test_gzip_that_grows_without_bounds_is_refused_by_its_name(tmp_path: Path) -> None:
    bomb = gzip.compress(b" " * 20 * 2**20)
    (tmp_path / "labels.csv.gz").write_bytes(bomb)
    with pytest.raises(OptionError, match=r"labels\.csv\.gz: .* bytes of gzip must unpack to at most 16,777,216"):
        read_labels(tmp_path / "labels.csv.gz")
    plant(tmp_path / "objaverse", f"{UID.format(0)}.glb")
    (tmp_path / "objaverse" / "lvis-annotations.json.gz").write_bytes(bomb)
    with pytest.raises(OptionError, match=r"objaverse/lvis-annotations\.json\.gz: .* must unpack to at most"):
        MeshCollection.from_paths(tmp_path / "objaverse")


def entries(*facts: tuple[str, str, str]) -> MeshCollection:
    triangle = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    return MeshCollection(MeshEntry(key, label, split, lambda: triangle) for key, label, split in facts)


MANY = ("chair/train/chair_0010.off", "chair/train/chair_0002.off", "chair/test/chair_0890.off", "bed/val/bed_1.off")


def test_keys_do_not_depend_on_the_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here, there = plant(tmp_path / "a", *MANY), plant(tmp_path / "deep" / "er", *MANY)
    monkeypatch.chdir(there)
    assert facts(MeshCollection.from_paths(here)) == facts(MeshCollection.from_paths("."))
    monkeypatch.chdir(there / "chair" / "train")
    assert facts(MeshCollection.from_paths("."))[0] == ("chair/train/chair_0002.off", "chair", "train")
    assert facts(MeshCollection.from_paths(".."))[0] == ("chair/test/chair_0890.off", "chair", "test")
    assert facts(MeshCollection.from_paths("chair_0002.off")) == [("chair/train/chair_0002.off", "chair", "train")]


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["cup/b.obj", "cup/a.STL"], [("cup/a.STL", "cup", "train"), ("cup/b.obj", "cup", "train")]),
        (["b.glb", "a.ply"], [("root/a.ply", "root", "train"), ("root/b.glb", "root", "train")]),
        (["test/c/a.off", "train/c/a.off"], [("test/c/a.off", "c", "test"), ("train/c/a.off", "c", "train")]),
        (["test/a.off", "train/a.off"], [("root/test/a.off", "root", "test"), ("root/train/a.off", "root", "train")]),
        (["cup/Valid/a.off"], [("cup/Valid/a.off", "cup", "val")]),
        (["0123/id/models/a.obj"], [("0123/id/models/a.obj", "0123", "train")]),
        (["a.off", "a.obj"], [("root/a.obj", "root", "train"), ("root/a.off", "root", "train")]),
        (["cup/a.off", "b.off"], [("cup/a.off", "cup", "train"), ("root/b.off", "root", "train")]),
    ],
    ids=["classes", "flat", "split first", "only splits", "valid", "deep", "two endings", "mixed"],
)
def test_other_layouts(tmp_path: Path, names: list[str], expected: list[tuple[str, str, str]]) -> None:
    meshes = MeshCollection.from_paths(plant(tmp_path / "root", *names))
    assert facts(meshes) == expected
    is_flat = all("/" not in name for name in names)
    assert ("it has no classes: its files lie in one folder" in meshes.remarks[0]) == is_flat


@pytest.mark.parametrize(
    ("name", "label"), [("chair_0003.off", "chair"), ("bunny.ply", "bunny"), ("a b-12.obj", "a b"), ("7.stl", "7")]
)
def test_a_single_file_is_labelled_by_its_name(tmp_path: Path, name: str, label: str) -> None:
    assert facts(MeshCollection.from_paths(plant(tmp_path, name) / name)) == [(name, label, "train")]


def test_other_files_are_ignored(tmp_path: Path) -> None:
    plant(tmp_path, "cup/a.off", "cup/README.txt", "cup/a.mtl", "cup/a.off.gz", "notes.md")
    plant(tmp_path, "cup/._a.off", "__MACOSX/cup/a.off", ".hidden/a.off")
    assert facts(MeshCollection.from_paths(tmp_path)) == [("cup/a.off", "cup", "train")]


def test_several_paths_together(tmp_path: Path) -> None:
    one, two = plant(tmp_path / "one", "cup/a.off", "cup/b.off"), plant(tmp_path / "two", "cup/a.off", "jug/a.off")
    meshes = MeshCollection.from_paths([one, two, one / "cup" / "b.off", str(tmp_path / "one" / "cup" / ".." / "cup")])
    assert [(entry.key, entry.path) for entry in meshes] == [
        ("cup/a.off", one / "cup" / "a.off"),
        ("cup/a.off~2", two / "cup" / "a.off"),
        ("cup/b.off", one / "cup" / "b.off"),
        ("jug/a.off", two / "jug" / "a.off"),
    ]


def test_linked_folders_are_followed_but_not_in_circles(tmp_path: Path) -> None:
    plant(tmp_path, "root/cup/a.off", "elsewhere/b.off")
    os.symlink(tmp_path / "elsewhere", tmp_path / "root" / "jug")
    os.symlink(tmp_path / "root", tmp_path / "root" / "cup" / "round")
    os.symlink(tmp_path / "root" / "self", tmp_path / "root" / "self")
    keys = [entry.key for entry in MeshCollection.from_paths(tmp_path / "root")]
    assert keys == ["cup/a.off", "jug/b.off"]


def test_nothing_is_read_before_it_is_asked_for(tmp_path: Path) -> None:
    plant(tmp_path, "cup/a.off", "cup/b.off")
    (tmp_path / "cup" / "b.off").write_text("rubbish")
    good, bad = MeshCollection.from_paths(tmp_path)
    mesh = good.load()
    assert (mesh.name, len(mesh.faces)) == ("cup/a.off", 1)
    with pytest.raises(MeshError, match=f"{tmp_path / 'cup' / 'b.off'}: an OFF file must begin with OFF"):
        bad.load()


@pytest.mark.parametrize("n", [0, 1, 64, 129])
def test_entries_travel_to_other_processes(tmp_path: Path, n: int) -> None:
    plant(tmp_path, *(f"cup/cup_{i}.off" for i in range(129)))
    meshes = MeshCollection.from_paths(tmp_path)[:n]
    again = pickle.loads(pickle.dumps(pickle.loads(pickle.dumps(meshes))))
    assert facts(again) == facts(meshes)
    assert facts(again[i] for i in reversed(range(n))) == facts(meshes)[::-1]
    assert facts(again[-3:]) == facts(meshes)[-3:]
    assert all(entry.load().vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]] for entry in again[:2])
    with pytest.raises(IndexError):
        again[n]


def test_a_collection_is_a_sequence() -> None:
    meshes = entries(("b", "x", "train"), ("a", "y", "test"))
    assert len(meshes) == 2
    assert [entry.key for entry in meshes] == ["b", "a"]  # as given
    assert meshes[-1].key == "a"
    assert isinstance(meshes[:1], MeshCollection)
    assert meshes[0] in meshes
    assert meshes.classes == ["x", "y"]
    both = MeshCollection([*meshes, *entries(("c", "z", "val"))])
    assert both.classes == ["x", "y", "z"]
    assert len(MeshCollection([])) == 0


@given(st.lists(st.text("ab~é😀_/ 0019٣", max_size=6), max_size=20, unique=True))
def test_natural_order_is_that_of_words_and_numbers(names: list[str]) -> None:
    """Words come before numbers, which compare as such (ASCII digits); equal ones but for zeros by their text."""

    def spelled_out(name: str) -> tuple[list[tuple[int, int, str]], str]:
        parts = [part for part in re.split(r"([0-9]+)", name) if part]
        return [(1, int(part), "") if part.isascii() and part.isdecimal() else (0, 0, part) for part in parts], name

    assert entries(*((name, name, "train") for name in names)).classes == sorted(names, key=spelled_out)


def test_numbers_of_any_length_have_an_order() -> None:
    """A member of an archive may have a name of 65,535 digits; Python makes an int of 4,300."""
    names = ["7" * 5000, "8" * 300, "0" * 5000 + "9"]
    assert entries(*((name, name, "train") for name in names)).classes == [names[2], names[1], names[0]]


def test_select_and_limit() -> None:
    meshes = entries(("1", "x", "train"), ("2", "y", "test"), ("3", "x", "test"), ("4", "y", "train"))
    assert [e.key for e in meshes.select(classes=["x"])] == ["1", "3"]
    assert [e.key for e in meshes.select(splits="test")] == ["2", "3"]
    assert [e.key for e in meshes.select(classes="y", splits=["train"])] == ["4"]
    assert [e.key for e in meshes.limit(3)] == ["1", "2", "3"]
    assert len(meshes.limit(99)) == 4
    with pytest.raises(OptionError, match="class must be one of x, y; got 'z'"):
        meshes.select(classes=["x", "z"])
    with pytest.raises(OptionError, match="split must be one of train, test; got 'val'"):
        meshes.select(splits="val")
    with pytest.raises(OptionError, match="a limit must be at least 1; got 0"):
        meshes.limit(0)


@given(
    facts_=st.lists(st.tuples(st.sampled_from("abcde"), st.sampled_from(["train", "val", "test"])), max_size=40),
)
@settings(max_examples=60)
def test_interleaved_is_a_fair_reordering(facts_: list[tuple[str, str]]) -> None:
    meshes = entries(*[(str(i), label, split) for i, (label, split) in enumerate(facts_)])
    order = meshes.interleaved()
    assert sorted(facts(order)) == sorted(facts(meshes))
    assert {entry.label for entry in order[: len(meshes.classes)]} == set(meshes.classes)
    for label in meshes.classes:
        of_class = [entry for entry in order if entry.label == label]
        splits = {entry.split for entry in of_class}
        assert {entry.split for entry in of_class[: len(splits)]} == splits
        for split in splits:
            keys = [int(entry.key) for entry in of_class if entry.split == split]
            assert keys == sorted(keys)


def test_what_cannot_be_a_collection_says_so(tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match="keys of a collection must differ; two entries are 'a'"):
        entries(("a", "x", "train"), ("a", "y", "test"))
    with pytest.raises(ArgumentError, match="split must be one of train, val, test; got 'dev' for a"):
        entries(("a", "x", "dev"))
    plant(tmp_path, "empty/readme.txt")
    for path, message in (
        (tmp_path / "empty", r"a folder must have meshes in it \(.off, .obj, .ply, .stl, .glb, .gltf\); it has none"),
        (tmp_path / "none", "there is no such file or folder"),
        (tmp_path / ("x" * 300), "there is no such file or folder"),
        (tmp_path / "empty" / "readme.txt", "a mesh file must end in one of"),
    ):
        with pytest.raises(MeshError, match=message) as caught:
            MeshCollection.from_paths([path])
        assert str(caught.value).startswith(f"{path}: ")
    with pytest.raises(MeshError, match="at least one mesh file or folder must be given; got none"):
        MeshCollection.from_paths([])
    with pytest.raises(OptionError, match="up must be one of z, y; got 'x'"):
        MeshCollection.from_paths(tmp_path, up="x")


@pytest.mark.parametrize(
    ("locked", "entry"),
    [("chair/train", ("chair/train/*", "chair", "train")), ("bed", ("bed/*", "bed", "train"))],
)
def test_a_folder_that_cannot_be_read_is_an_entry_that_fails(
    tmp_path: Path,
    lock: Callable[[Path], None],
    monkeypatch: pytest.MonkeyPatch,
    locked: str,
    entry: tuple[str, str, str],
) -> None:
    plant(tmp_path, *MANY)
    lock(tmp_path / locked)
    meshes = MeshCollection.from_paths(tmp_path)
    hidden = [key for key in MANY if key.startswith(locked)]
    assert {e.key for e in meshes} == {*MANY, entry[0]} - set(hidden)
    assert entry in facts(meshes)
    bad = next(e for e in meshes if e.key == entry[0])
    with pytest.raises(MeshError, match=f"{locked}: cannot read the folder: Permission denied"):
        bad.load()
    with pytest.raises(MeshError, match="cannot read the folder: Permission denied"):
        MeshCollection.from_paths(tmp_path / locked)
    lock(tmp_path / "another")
    with pytest.raises(MeshError, match="could not be read when meshes were searched"):
        pickle.loads(pickle.dumps(bad.load))()


def test_splits_by_shares_follow_from_keys_and_seed_alone() -> None:
    keys = [f"chair/{i:04d}.off" for i in range(3000)]
    whole = entries(*((key, "chair", "train") for key in keys)).divided((0.8, 0.1, 0.1), seed=3)
    split_of = {entry.key: entry.split for entry in whole}
    shares = np.array([list(split_of.values()).count(split) for split in ("train", "val", "test")]) / 3000
    assert np.abs(shares - [0.8, 0.1, 0.1]).max() < 4 * (0.8 * 0.2 / 3000) ** 0.5
    some = entries(*((key, "chair", "train") for key in reversed(keys[::7]))).divided((0.8, 0.1, 0.1), seed=3)
    assert all(entry.split == split_of[entry.key] for entry in some), "others move none"
    other = entries(*((key, "chair", "train") for key in keys)).divided((0.8, 0.1, 0.1), seed=4)
    assert [entry.split for entry in other] != list(split_of.values())
    assert "seed 3: train 0.8, val 0.1, test 0.1" in whole.remarks[-1]


def test_no_val_where_its_share_is_nothing() -> None:
    found = entries(*((f"{i}", "a", "train") for i in range(200))).divided((0.5, 0, 0.5))
    assert {entry.split for entry in found} == {"train", "test"}
    for shares in ((0.8, 0.2), (0.8, 0.1, 0.2), (1.2, -0.1, -0.1), (float("nan"), 0, 1)):
        with pytest.raises(OptionError, match="three shares, of train, val and test"):
            found.divided(shares)
    with pytest.raises(OptionError, match="for meshes without splits; these have train, test"):
        found.divided((0.8, 0.1, 0.1))
