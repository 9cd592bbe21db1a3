"""MeshCollection: what is found in which folder, keys that are the same everywhere, and who comes first."""

import os
import pickle
import re
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import zbuf_occlude as zo
from zbuf_occlude import ArgumentError, Mesh, MeshCollection, MeshError, OptionError
from zbuf_occlude.meshes.collection import MeshEntry

TRIANGLE = "OFF 3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"


def plant(root: Path, *names: str) -> Path:
    for name in names:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(TRIANGLE)
    return root


def facts(meshes: Iterable[MeshEntry]) -> list[tuple[str, str, str]]:
    return [(entry.key, entry.label, entry.split) for entry in meshes]


def entries(*facts: tuple[str, str, str]) -> MeshCollection:
    triangle = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    return MeshCollection(MeshEntry(key, label, split, lambda: triangle) for key, label, split in facts)


MODELNET = (
    "chair/train/chair_0010.off",
    "chair/train/chair_0002.off",
    "chair/test/chair_0890.off",
    "bed/val/bed_1.off",
)


def test_modelnets_layout(tmp_path: Path) -> None:
    meshes = MeshCollection.from_paths(plant(tmp_path / "ModelNet40", *MODELNET))
    assert facts(meshes) == [
        ("bed/val/bed_1.off", "bed", "val"),
        ("chair/test/chair_0890.off", "chair", "test"),
        ("chair/train/chair_0002.off", "chair", "train"),
        ("chair/train/chair_0010.off", "chair", "train"),
    ]
    assert meshes.classes == ["bed", "chair"]
    assert repr(meshes) == "MeshCollection(4 meshes, 2 classes)"


@pytest.mark.parametrize("given", ["chair", "chair/train", "chair/train/chair_0002.off"])
def test_a_part_of_modelnet_has_the_keys_of_the_whole(tmp_path: Path, given: str) -> None:
    plant(tmp_path / "ModelNet40", *MODELNET)
    assert ("chair/train/chair_0002.off", "chair", "train") in facts(
        MeshCollection.from_paths(tmp_path / "ModelNet40" / given)
    )


def test_keys_do_not_depend_on_the_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here, there = plant(tmp_path / "a", *MODELNET), plant(tmp_path / "deep" / "er", *MODELNET)
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
        (
            ["test/cup/a.off", "train/cup/a.off"],
            [("test/cup/a.off", "cup", "test"), ("train/cup/a.off", "cup", "train")],
        ),
        (["test/a.off", "train/a.off"], [("root/test/a.off", "root", "test"), ("root/train/a.off", "root", "train")]),
        (["cup/Valid/a.off"], [("cup/Valid/a.off", "cup", "val")]),
        (["0123/id/models/a.obj"], [("0123/id/models/a.obj", "0123", "train")]),
        (["a.off", "a.obj"], [("root/a.obj", "root", "train"), ("root/a.off", "root", "train")]),
        (["cup/a.off", "b.off"], [("cup/a.off", "cup", "train"), ("root/b.off", "root", "train")]),
    ],
    ids=["classes", "flat", "split first", "only splits", "valid", "deep", "two endings", "mixed"],
)
def test_other_layouts(tmp_path: Path, names: list[str], expected: list[tuple[str, str, str]]) -> None:
    assert facts(MeshCollection.from_paths(plant(tmp_path / "root", *names))) == expected


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


def test_up_reaches_the_file(tmp_path: Path) -> None:
    (entry,) = MeshCollection.from_paths(plant(tmp_path, "a.off"), up="y")
    assert entry.load().vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 0, 1]]


def test_entries_travel_to_other_processes(tmp_path: Path) -> None:
    meshes = MeshCollection.from_paths(plant(tmp_path, *MODELNET))
    again = pickle.loads(pickle.dumps(meshes))
    assert facts(again) == facts(meshes)
    assert again[0].load().vertices.tobytes() == meshes[0].load().vertices.tobytes()


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


def test_classes_are_in_natural_order() -> None:
    assert entries(("a", "c10", "train"), ("b", "c2", "train"), ("c", "C3", "train")).classes == ["C3", "c2", "c10"]


@given(st.lists(st.text("ab~é😀_/ 0019٣", max_size=6), max_size=20, unique=True))
def test_natural_order_is_that_of_words_and_numbers(names: list[str]) -> None:
    """Words come before numbers, numbers are compared as such; and what is the same but for zeros, by its text."""

    def spelled_out(name: str) -> tuple[list[tuple[int, int, str]], str]:
        parts = [part for part in re.split(r"(\d+)", name) if part]
        return [(1, int(part), "") if part.isdecimal() else (0, 0, part) for part in parts], name

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


def test_interleaved_shows_classes_and_splits_first() -> None:
    every = [
        (f"{label}/{split}/{i}", label, split)
        for label in ("a", "b", "c", "d")
        for split, n in (("train", 5), ("val", 2), ("test", 3))
        for i in range(n)
    ]
    order = entries(*every).interleaved()
    assert facts(order) != every
    first = order.limit(4)
    assert {entry.label for entry in first} == {"a", "b", "c", "d"}
    assert {entry.split for entry in first} == {"train", "val", "test"}
    assert len({(entry.label, entry.split) for entry in order.limit(12)}) == 12


@given(
    facts_=st.lists(st.tuples(st.sampled_from("abcde"), st.sampled_from(["train", "val", "test"])), max_size=40),
)
@settings(max_examples=60, deadline=None)
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
    plant(tmp_path, *MODELNET)
    lock(tmp_path / locked)
    meshes = MeshCollection.from_paths(tmp_path)
    hidden = [key for key in MODELNET if key.startswith(locked)]
    assert {e.key for e in meshes} == {*MODELNET, entry[0]} - set(hidden)
    assert entry in facts(meshes)
    bad = next(e for e in meshes if e.key == entry[0])
    with pytest.raises(MeshError, match=f"{locked}: a folder must be readable; it is not: Permission denied"):
        bad.load()
    with pytest.raises(MeshError, match="a folder must be readable; it is not: Permission denied"):
        MeshCollection.from_paths(tmp_path / locked)
    lock(tmp_path / "another")
    with pytest.raises(MeshError, match="it was not when meshes were looked for"):
        pickle.loads(pickle.dumps(bad.load))()


def test_the_collection_is_public() -> None:
    assert zo.MeshCollection is MeshCollection
