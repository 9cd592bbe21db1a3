"""MeshCollection: meshes with a key, a class and a split each, loaded only when asked for."""

import os
import pickle
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import Any, overload
from unicodedata import decimal

import numpy as np

from zbuf_occlude.arrays import as_flag
from zbuf_occlude.errors import ArgumentError, MeshError, OptionError, check_choice, escape_control
from zbuf_occlude.geometry.mesh import Mesh, check_frame
from zbuf_occlude.meshes.labels import match, read_labels
from zbuf_occlude.meshes.layouts import recognise
from zbuf_occlude.meshes.load import default_up, load_mesh
from zbuf_occlude.meshes.mesh_files import has_changed
from zbuf_occlude.meshes.tree import ALL, check_readable, tree_at
from zbuf_occlude.provenance import UNKNOWN, MeshSource

SPLITS = ("train", "val", "test")

_BUNDLE = 64
"""Entries are pickled this many at a time: their common parts, such as classes and folders, stand there once."""

Paths = str | os.PathLike[str] | Iterable[str | os.PathLike[str]]


@dataclass(frozen=True, slots=True)
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
    up : str
        The axis that points up in the file, "z" or "y"; empty without a file.
    unit : str
        Of the file, where a person gave it; the mesh is in metres then.
    origin : MeshSource
        Of a mesh that is computed; a file's is known when it has been read (`Mesh.origin`).
    """

    key: str
    label: str
    split: str
    load: Callable[[], Mesh] = field(repr=False)
    path: Path | None = None
    up: str = ""
    unit: str = ""
    origin: MeshSource = UNKNOWN

    def __post_init__(self) -> None:
        if self.split not in SPLITS:
            raise ArgumentError(f"split must be one of {', '.join(SPLITS)}; got {self.split!r} for {self.key}.")

    def has_changed(self, source: MeshSource) -> bool:
        """Return whether the mesh is not what it was when it had this source, as the sizes of its files tell."""
        if self.path is None:
            return self.origin.sha256 not in ("", source.sha256)
        return has_changed(self.path, source)


class MeshCollection(Sequence[MeshEntry]):
    """A sequence of `MeshEntry`, in the order given.

    Parameters
    ----------
    entries : iterable of MeshEntry
    remarks : iterable of str
        Lines to be shown: which layout was recognised, and where classes and splits come from.

    Raises
    ------
    ArgumentError
        Two entries have the same key.

    Examples
    --------
    >>> zo.MeshCollection.from_paths(["chair.off", "car.obj"])
    MeshCollection(2 meshes, 2 classes)
    """

    def __init__(self, entries: Iterable[MeshEntry], remarks: Iterable[str] = ()) -> None:
        self._entries: tuple[MeshEntry, ...] | _PickledEntries = tuple(entries)
        self.remarks = tuple(remarks)
        keys: set[str] = set()
        for entry in self._entries:
            if entry.key in keys:
                raise ArgumentError(f"keys of a collection must differ; two entries are {entry.key!r}. Rename one.")
            keys.add(entry.key)

    def __getstate__(self) -> dict[str, Any]:
        """Return what another process gets: entries made when they are asked for, so that it need not hold all."""
        entries = _PickledEntries(self._entries) if isinstance(self._entries, tuple) else self._entries
        return {"_entries": entries, "remarks": self.remarks}

    def __repr__(self) -> str:
        return f"MeshCollection({len(self)} meshes, {len(self.classes)} classes)"

    def __len__(self) -> int:
        return len(self._entries)

    def __iter__(self) -> Iterator[MeshEntry]:
        return iter(self._entries)

    @overload
    def __getitem__(self, index: int) -> MeshEntry: ...
    @overload
    def __getitem__(self, index: slice) -> "MeshCollection": ...
    def __getitem__(self, index: int | slice) -> "MeshEntry | MeshCollection":
        """Return an entry, or for a slice a collection."""
        if isinstance(index, slice):
            return self._with(self._entries[i] for i in range(len(self))[index])
        return self._entries[index]

    @property
    def classes(self) -> list[str]:
        """Names of the classes, in natural order; the index in here is the number of a class."""
        return sorted({entry.label for entry in self}, key=_natural)

    @classmethod
    def from_paths(
        cls,
        paths: Paths,
        *,
        up: str | None = None,
        unit: str | None = None,
        labels: str | os.PathLike[str] | None = None,
        colors: bool = False,
    ) -> "MeshCollection":
        """Find the meshes in files, folders and ZIP archives; no mesh is read yet.

        Parameters
        ----------
        paths : path-like or iterable of path-like
            Any of: a mesh file; a folder or a ZIP archive in one of the layouts of `zbuf_occlude.meshes.layouts`
            (ModelNet, ShapeNetCore, Objaverse, 3D-FUTURE, ABC, Thingi10K, plain class folders), or a part of one. A
            folder without mesh files may hold ZIP archives, each read as a folder of its name; so may ShapeNetCore's.
        up : {"z", "y"}, optional
            As in `load_mesh`, for all of them; by default what the layout says, or else the format.
        unit : {"mm", "cm", "m", "in"}, optional
            As in `load_mesh`, for all of them.
        labels : path-like, optional
            A file that says which mesh is of which class and split (`zbuf_occlude.meshes.labels`). What it does not
            name is left out.
        colors : bool
            Load the meshes with their colours, as in `load_mesh`.

        Returns
        -------
        MeshCollection
            In natural order of the keys (``chair_2`` before ``chair_10``). `remarks` say what was recognised.

        Raises
        ------
        MeshError
            A path does not exist or cannot be read, a file is of a format not read here, or a folder has no mesh.
        OptionError
            `up` or `unit` is unknown; the labels, or a layout's own list of splits, cannot be read; labels are of none
            of the meshes.

        Notes
        -----
        The layout decides key, label and split from names alone, so that they are the same on every machine and for a
        part of a collection as for the whole. A key that another path given earlier has taken already gets ``~2``,
        ``~3``... A file met twice is taken once. In keys and labels, which are lines of text files, line breaks,
        control characters and bytes that are not UTF-8 are written as in Python, ``\\n``, ``\\xff``.
        Files of other formats and hidden ones are ignored, linked folders followed. A folder below the path given that
        cannot be read is one entry, ``FOLDER/*``, which fails when it is loaded.
        """
        check_frame(up, unit)
        colors = as_flag(colors, "colors")
        given = [paths] if isinstance(paths, str | os.PathLike) else list(paths)
        if not given:
            raise MeshError("at least one mesh file or folder must be given; got none.")
        entries: dict[str, MeshEntry] = {}
        remarks: list[str] = []
        met: set[str] = set()
        for path in map(Path, given):
            tree = tree_at(path)
            layout, (places, said) = recognise(tree)
            if not tree.single:
                remarks.append("; ".join([f"{escape_control(str(path))}: layout {layout.name}", *said]))
            for place in places:
                file = tree.path_of(place.file)
                absolute = os.path.abspath(file)
                if absolute in met:
                    continue
                met.add(absolute)
                key = _free(escape_control(place.key), entries)
                load = (
                    partial(_unreadable, file.parent)
                    if file.name == ALL
                    else _FromFile(file, up or layout.up, unit, key, colors)
                )
                up_there = up or layout.up or default_up(file)
                entries[key] = MeshEntry(
                    key, escape_control(place.label), place.split, load, file, up_there, unit or ""
                )
        found = cls(sorted(entries.values(), key=lambda entry: _natural(entry.key)), remarks)
        return found if labels is None else found.labelled(labels)

    def labelled(self, path: str | os.PathLike[str]) -> "MeshCollection":
        """Return the entries that a file of labels names, with its classes and splits.

        OptionError for a file that cannot be read, names no mesh of the collection, or names one that several could be.
        """
        labels = read_labels(Path(path))
        found, n_unknown = match({entry.key: entry for entry in self}, labels)
        if not found:
            raise OptionError(
                f"{path} must label meshes that were found; none of its {len(labels):,} labels is of one, "
                f"its first is {labels[0].key!r:.80}, the first mesh {self[0].key!r:.80}."
            )
        entries = [
            replace(e, label=escape_control(label.label or e.label), split=label.split or e.split) for e, label in found
        ]
        said = (
            f"{escape_control(str(path))}: {len(found):,} of {len(self):,} meshes are named there, the others left out"
        )
        if n_unknown:
            said += f"; {n_unknown:,} of its labels are of no mesh"
        return MeshCollection(entries, (*self.remarks, said))

    def select(self, *, classes: Iterable[str] | None = None, splits: Iterable[str] | None = None) -> "MeshCollection":
        """Return the entries of some classes and splits, in their order; OptionError for one that no entry has."""
        chosen = {}
        for what, names, known in (
            ("class", classes, self.classes),
            ("split", splits, [split for split in SPLITS if any(entry.split == split for entry in self)]),
        ):
            chosen[what] = set(known) if names is None else {names} if isinstance(names, str) else set(names)
            for name in sorted(chosen[what]):
                check_choice(what, name, known)
        return self._with(e for e in self if e.label in chosen["class"] and e.split in chosen["split"])

    def limit(self, n: int) -> "MeshCollection":
        """Return the first `n` entries, all of them when there are fewer; OptionError for `n` below 1."""
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
        return self._with(_in_turn(turns))

    def _with(self, entries: Iterable[MeshEntry]) -> "MeshCollection":
        return MeshCollection(entries, self.remarks)


@dataclass(frozen=True, slots=True)
class _FromFile:
    """Loads a mesh from its file. (Of a million meshes a `partial` each would take 300 bytes more.)"""

    file: Path
    up: str | None
    unit: str | None
    name: str
    colors: bool

    def __call__(self) -> Mesh:
        return load_mesh(self.file, up=self.up, unit=self.unit, name=self.name, colors=self.colors)


def _unreadable(folder: Path) -> Mesh:
    """Raise MeshError that says why a folder cannot be read."""
    check_readable(folder)
    raise MeshError(f"{folder}: a folder must be readable; it was not when meshes were looked for. Start again.")


def _free(key: str, taken: dict[str, MeshEntry]) -> str:
    number, free = 1, key
    while free in taken:
        number += 1
        free = f"{key}~{number}"
    return free


def _in_turn(queues: list[list[MeshEntry]]) -> Iterator[MeshEntry]:
    """Take the first of each queue, then the second of each, and so on."""
    for row in zip_longest(*queues):
        yield from (entry for entry in row if entry is not None)


def _natural(text: str) -> tuple[bytes, str]:
    """Sort key that compares runs of digits as numbers, after letters, and equal ones by the text itself.

    Letters become their bytes and a 0; digits become 255, their number and themselves. Bytes are small, and the sort
    keys of all entries are in memory at once. Names in archives may have more digits than Python turns into an int.
    """
    parts = []
    for part in filter(None, _DIGITS.split(text)):
        if part.isdecimal():
            ascii_part = part if part.isascii() else "".join(str(decimal(digit)) for digit in part)
            digits = ascii_part.lstrip("0").encode()
            parts.append(b"\xff%b%b" % (len(digits).to_bytes(2), digits))
        else:
            parts.append(part.encode(errors="surrogatepass") + b"\0")
    return b"".join(parts), text


_DIGITS = re.compile(r"(\d+)")


class _PickledEntries:
    """Entries kept as bytes and unpickled where they are asked for; a million are two arrays."""

    def __init__(self, entries: Sequence[MeshEntry]) -> None:
        bundles = [pickle.dumps(entries[i : i + _BUNDLE], protocol=5) for i in range(0, len(entries), _BUNDLE)]
        self._n = len(entries)
        self._ends = np.cumsum([0, *map(len, bundles)])
        self._bytes = np.frombuffer(b"".join(bundles), np.uint8)
        self._last: tuple[int, Sequence[MeshEntry]] = (-1, ())

    def __len__(self) -> int:
        return self._n

    def __getitem__(self, index: int) -> MeshEntry:
        bundle, place = divmod(range(self._n)[index], _BUNDLE)
        return self._bundle(bundle)[place]

    def __iter__(self) -> Iterator[MeshEntry]:
        for bundle in range(len(self._ends) - 1):
            yield from self._bundle(bundle)

    def _bundle(self, number: int) -> Sequence[MeshEntry]:
        known, entries = self._last  # read once: another thread may be here
        if known != number:
            entries = pickle.loads(self._bytes[self._ends[number] : self._ends[number + 1]].tobytes())
            self._last = number, entries
        return entries
