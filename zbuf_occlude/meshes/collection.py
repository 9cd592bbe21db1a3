"""MeshCollection: meshes with a key, a class and a split each, loaded only when asked for."""

import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import zip_longest
from pathlib import Path, PurePosixPath
from typing import overload

from zbuf_occlude.checks import check_word
from zbuf_occlude.errors import ArgumentError, MeshError, OptionError
from zbuf_occlude.mesh import Mesh
from zbuf_occlude.meshes.files import SUFFIXES, UP, load_mesh

SPLITS = ("train", "val", "test")
_SPLIT_FOLDERS = {"train": "train", "val": "val", "valid": "val", "validation": "val", "test": "test"}
_NOT_PRINTABLE = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]")
_ALL = "*"
"""Stands for the meshes of a folder that cannot be read."""
_UNPACKERS_RUBBISH = "__MACOSX"  # ModelNet's own archives contain it, full of files ._chair_0001.off

Paths = str | os.PathLike[str] | Iterable[str | os.PathLike[str]]


@dataclass(frozen=True)
class MeshEntry:
    """One mesh of a collection, not loaded yet.

    Parameters
    ----------
    key : str
        Names the mesh, the same on every machine, and differs from all other keys of the collection.
        Randomness is seeded with it.
    label : str
        Name of its class.
    split : {"train", "val", "test"}
    load : callable
        Returns the `Mesh`, or raises `MeshError`. Can be pickled when the entry comes from a file.
    path : Path, optional
        Of the file, if it comes from one.
    """

    key: str
    label: str
    split: str
    load: Callable[[], Mesh] = field(repr=False)
    path: Path | None = None

    def __post_init__(self) -> None:
        if self.split not in SPLITS:
            raise ArgumentError(f"split must be one of {', '.join(SPLITS)}; got {self.split!r} for {self.key}.")


class MeshCollection(Sequence[MeshEntry]):
    """A sequence of `MeshEntry`, in the order given.

    Parameters
    ----------
    entries : iterable of MeshEntry

    Raises
    ------
    ArgumentError
        Two entries have the same key.
    """

    def __init__(self, entries: Iterable[MeshEntry]) -> None:
        self._entries = tuple(entries)
        keys: set[str] = set()
        for entry in self._entries:
            if entry.key in keys:
                raise ArgumentError(f"keys of a collection must differ; two entries are {entry.key!r}. Rename one.")
            keys.add(entry.key)

    def __repr__(self) -> str:
        return f"MeshCollection({len(self)} meshes, {len(self.classes)} classes)"

    def __len__(self) -> int:
        return len(self._entries)

    @overload
    def __getitem__(self, index: int) -> MeshEntry: ...
    @overload
    def __getitem__(self, index: slice) -> "MeshCollection": ...
    def __getitem__(self, index: int | slice) -> "MeshEntry | MeshCollection":
        """Return an entry, or for a slice a collection."""
        return MeshCollection(self._entries[index]) if isinstance(index, slice) else self._entries[index]

    @property
    def classes(self) -> list[str]:
        """Names of the classes, in natural order; the index in here is the number of a class."""
        return sorted({entry.label for entry in self}, key=_natural)

    @classmethod
    def from_paths(cls, paths: Paths, *, up: str | None = None) -> "MeshCollection":
        """Find the meshes in files and folders; nothing is read yet.

        Parameters
        ----------
        paths : path-like or iterable of path-like
            Any of: a mesh file; a folder of mesh files; a folder of class folders, ``CLASS/FILE``, ModelNet's
            ``CLASS/{train,val,test}/FILE`` or ``{train,val,test}/CLASS/FILE``; one class of those.
        up : {"z", "y"}, optional
            As in `load_mesh`, for all of them.

        Returns
        -------
        MeshCollection
            In natural order of the keys (``chair_2`` before ``chair_10``).

        Raises
        ------
        MeshError
            A path does not exist or cannot be read, a file is of a format not read here, or a folder has no mesh.
        OptionError
            `up` is unknown.

        Notes
        -----
        The label is the first folder below the path given, ``train``, ``val`` (``valid``, ``validation``) and
        ``test`` apart, which are splits; the folder itself when its files lie right in it; for a single file the
        class folder of its split folder, or else its name without its ending and number, ``chair`` for
        ``chair_0003.off``. Without a split folder the split is "train".

        The key is the path from the class folder on (else from the path given), with forward slashes and the ending.
        A key that another path given earlier has taken already gets ``~2``, ``~3``... A file met twice is taken once.
        In keys and labels, which are lines of text files, line breaks, control characters and bytes that are not UTF-8
        are written as in Python, ``\\n``, ``\\xff``.
        Files of other formats and hidden ones are ignored, linked folders followed. A folder below the path given that
        cannot be read is one entry, ``FOLDER/*``, which fails when it is loaded.
        """
        if up is not None:
            check_word("up", up, UP)
        given = [paths] if isinstance(paths, str | os.PathLike) else list(paths)
        if not given:
            raise MeshError("at least one mesh file or folder must be given; got none.")
        entries: dict[str, MeshEntry] = {}
        met: set[str] = set()
        for path in map(Path, given):
            for file, labelled in _found(path):
                absolute = os.path.abspath(file)
                if absolute in met:
                    continue
                met.add(absolute)
                key = _free(labelled.key, entries)
                load = (
                    partial(_unreadable, file.parent)
                    if file.name == _ALL
                    else partial(load_mesh, file, up=up, name=key)
                )
                entries[key] = MeshEntry(key, labelled.label, labelled.split, load, file)
        return cls(sorted(entries.values(), key=lambda entry: _natural(entry.key)))

    def select(self, *, classes: Iterable[str] | None = None, splits: Iterable[str] | None = None) -> "MeshCollection":
        """Return the entries of some classes and splits, in their order.

        Raises
        ------
        OptionError
            A class or split that no entry has.
        """
        chosen = {}
        for what, names, known in (
            ("class", classes, self.classes),
            ("split", splits, [split for split in SPLITS if any(entry.split == split for entry in self)]),
        ):
            chosen[what] = set(known) if names is None else {names} if isinstance(names, str) else set(names)
            for name in sorted(chosen[what]):
                check_word(what, name, known)
        return MeshCollection(e for e in self if e.label in chosen["class"] and e.split in chosen["split"])

    def limit(self, n: int) -> "MeshCollection":
        """Return the first `n` entries, all of them when there are fewer.

        Raises
        ------
        OptionError
            `n` is less than 1.
        """
        if n < 1:
            raise OptionError(f"a limit must be at least 1; got {n}.")
        return self[:n]

    def interleaved(self) -> "MeshCollection":
        """Return the same entries with classes and splits in turn, so that the first few see all of them.

        As many entries as there are classes see every class, and about as many of each split as can be.
        Within a class and split the order stays.
        """
        queues: dict[str, dict[str, list[MeshEntry]]] = {}
        for entry in self:
            queues.setdefault(entry.label, {}).setdefault(entry.split, []).append(entry)
        turns = []
        for number, label in enumerate(self.classes):
            splits = [split for split in SPLITS if split in queues[label]]
            first = number % len(splits)  # each class begins with another split
            turns.append(list(_in_turn([queues[label][split] for split in splits[first:] + splits[:first]])))
        return MeshCollection(_in_turn(turns))


@dataclass(frozen=True)
class _Labelled:
    key: str
    label: str
    split: str

    def __post_init__(self) -> None:
        for name in ("key", "label"):
            object.__setattr__(self, name, _NOT_PRINTABLE.sub(_escaped, getattr(self, name)))


def _found(path: Path) -> Iterator[tuple[Path, _Labelled]]:
    """Mesh files at a path that a person gave, each with its key, label and split."""
    absolute = Path(os.path.abspath(path))  # not resolved: the names that count are those that a person sees
    if os.path.isdir(path):
        files = list(_walk(str(path)))
        if not files:
            raise MeshError(f"{path}: a folder must have meshes in it ({', '.join(SUFFIXES)}); it has none.")
        root = absolute
        while root.name.lower() in _SPLIT_FOLDERS:
            root = root.parent
        for file in files:
            relative = PurePosixPath(Path(os.path.abspath(file)).relative_to(root).as_posix())
            if not _class_folders(relative):  # the folder is the class
                relative = PurePosixPath(root.name) / relative
            yield file, _labelled(relative)
    elif not os.path.exists(path):
        raise MeshError(f"{path}: there is no such file or folder. Check the path.")
    elif path.suffix.lower() not in SUFFIXES:
        raise MeshError(f"{path}: a mesh file must end in one of {', '.join(SUFFIXES)}; this does not. Convert it.")
    else:
        above = absolute.parent
        if above.name.lower() in _SPLIT_FOLDERS and above.parent.name:
            yield path, _labelled(PurePosixPath(above.parent.name, above.name, path.name))
        else:
            yield path, _Labelled(path.name, re.sub(r"[\W_]*\d+$", "", path.stem) or path.stem, "train")


def _labelled(relative: PurePosixPath) -> _Labelled:
    folders = _class_folders(relative)
    splits = [_SPLIT_FOLDERS[part.lower()] for part in relative.parts[:-1] if part.lower() in _SPLIT_FOLDERS]
    return _Labelled(str(relative), folders[0] if folders else relative.stem, splits[0] if splits else "train")


def _escaped(match: re.Match[str]) -> str:
    character = match[0]
    if "\udc80" <= character <= "\udcff":  # a byte of a file name that is not UTF-8, as Python holds it
        return f"\\x{ord(character) - 0xDC00:02x}"
    return character.encode("unicode_escape").decode()


def _class_folders(relative: PurePosixPath) -> list[str]:
    return [part for part in relative.parts[:-1] if part.lower() not in _SPLIT_FOLDERS]


def _walk(folder: str, above: tuple[str, ...] = ()) -> Iterator[Path]:
    """Mesh files anywhere below a folder; links are followed, but not back to a folder that they lie in."""
    real = os.path.realpath(folder)
    if real in above:
        return
    try:
        items = sorted(os.scandir(folder), key=lambda item: item.name)
    except OSError:
        if not above:
            _unreadable(Path(folder))
        yield Path(folder, _ALL)
        return
    for item in items:
        if item.name.startswith(".") or item.name == _UNPACKERS_RUBBISH:
            continue
        if os.path.isdir(item.path):  # a link to itself is none
            yield from _walk(item.path, (*above, real))
        elif Path(item.name).suffix.lower() in SUFFIXES:
            yield Path(item.path)


def _unreadable(folder: Path) -> Mesh:
    """Raise MeshError that says why a folder cannot be read."""
    try:
        os.scandir(folder).close()
    except OSError as error:
        raise MeshError(f"{folder}: a folder must be readable; it is not: {error.strerror}.") from None
    raise MeshError(f"{folder}: a folder must be readable; it was not when meshes were looked for. Start again.")


def _free(key: str, taken: dict[str, MeshEntry]) -> str:
    if key not in taken:
        return key
    number = 2
    while f"{key}~{number}" in taken:
        number += 1
    return f"{key}~{number}"


def _in_turn(queues: list[list[MeshEntry]]) -> Iterator[MeshEntry]:
    """Take the first of each queue, then the second of each, and so on."""
    for row in zip_longest(*queues):
        yield from (entry for entry in row if entry is not None)


def _natural(text: str) -> tuple[list[tuple[int, int, str]], str]:
    """Sort key that compares runs of digits as numbers, and equal ones by the text itself."""
    parts = re.split(r"(\d+)", text)
    return [(1, int(part), "") if part.isdecimal() else (0, 0, part) for part in parts if part], text
