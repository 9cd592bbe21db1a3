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

import numpy as np

from zbuf_occlude.base.arrays import as_flag
from zbuf_occlude.base.documents import as_path
from zbuf_occlude.base.errors import ArgumentError, MeshError, OptionError, check_choice, escape_control
from zbuf_occlude.base.provenance import UNKNOWN, MeshSource, seed_of
from zbuf_occlude.geometry.mesh import Mesh, check_frame
from zbuf_occlude.meshes.labels import match, read_labels
from zbuf_occlude.meshes.layouts import recognise
from zbuf_occlude.meshes.load import default_up, load_mesh
from zbuf_occlude.meshes.mesh_files import has_changed
from zbuf_occlude.meshes.tree import ALL, check_readable, tree_at

SPLITS = ("train", "val", "test")

_BUNDLE = 64
"""Entries pickled together: their common parts, such as classes and folders, are then stored once."""

Paths = str | os.PathLike[str] | Iterable[str | os.PathLike[str]]


@dataclass(frozen=True, slots=True)
class MeshEntry:
    """One mesh of a collection, not loaded yet.

    Parameters
    ----------
    key : str
        Unique name in the collection, the same on every machine. It seeds all randomness.
    label : str
        Name of the class.
    split : {"train", "val", "test"}
    load : callable
        Returns the `Mesh`, or raises `MeshError`. For an entry from a file it can be pickled.
    path : Path, optional
        File of the mesh, if there is one.
    up : str
        Axis that points up in the file, "z" or "y"; empty without a file.
    unit : str
        Unit of the file, where the user gave one; the mesh is then in metres.
    origin : MeshSource
        Source of a computed mesh. The source of a file is known once it is read (`Mesh.origin`).
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
        """Return whether the mesh differs from this source, by its files' sizes or a computed mesh's digest."""
        if self.path is None:
            return self.origin.sha256 not in ("", source.sha256)
        return has_changed(self.path, source)


class MeshCollection(Sequence[MeshEntry]):
    """A sequence of `MeshEntry`, in the order given.

    Parameters
    ----------
    entries : iterable of MeshEntry
    remarks : iterable of str
        Lines for the user: the layout recognised, and the source of classes and splits.

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
        """Return the state for another process, which unpickles entries on demand and need not hold all."""
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
        """Return an entry, or a collection for a slice."""
        if isinstance(index, slice):
            return self._with(self._entries[i] for i in range(len(self))[index])
        return self._entries[index]

    @property
    def classes(self) -> list[str]:
        """Names of the classes, in natural order; a class's index here is its number."""
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
        """Return the meshes in files, folders and ZIP archives, without reading them.

        Parameters
        ----------
        paths : path-like or iterable of path-like
            Any of: a mesh file; a folder or a ZIP archive in one of the layouts of `zbuf_occlude.meshes.layouts`
            (ModelNet, ShapeNetCore, Objaverse, 3D-FUTURE, ABC, Thingi10K, plain class folders), or a part of one. A
            folder without mesh files may contain ZIP archives, each read as a folder of its name; so may ShapeNetCore.
        up : {"z", "y"}, optional
            As in `load_mesh`, for all meshes. Default: the layout's axis, else the format's.
        unit : {"mm", "cm", "m", "in"}, optional
            As in `load_mesh`, for all meshes.
        labels : path-like, optional
            A label file with classes and splits (`zbuf_occlude.meshes.labels`). Meshes without a label are left out.
        colors : bool
            Load the meshes with their colours, as in `load_mesh`.

        Returns
        -------
        MeshCollection
            In natural order of the keys (``chair_2`` before ``chair_10``). `remarks` describe the layouts.

        Raises
        ------
        MeshError
            A path does not exist or cannot be read; a file has another format; a folder has no mesh.
        OptionError
            `up` or `unit` is unknown; the labels, or a layout's list of splits, cannot be read; no label matches a
            mesh.

        Notes
        -----
        Key, label and split follow from names alone: they are the same on every machine, and for a part of a collection
        as for the whole. A key that an earlier path has already gets ``~2``, ``~3``... A file found twice is taken
        once. Keys and labels are lines of text files: line breaks, control characters and bytes that are not UTF-8 are
        escaped as in Python, ``\\n``, ``\\xff``. Files of other formats and hidden files are ignored; linked folders
        are followed. A subfolder that cannot be read becomes one entry, ``FOLDER/*``, whose loading fails.
        """
        check_frame(up, unit)
        colors = as_flag(colors, "colors")
        if isinstance(paths, str | os.PathLike) or not isinstance(paths, Iterable) or getattr(paths, "ndim", 1) == 0:
            given = [paths]
        else:
            given = list(paths)
        if not given:
            raise MeshError("at least one mesh file or folder must be given; got none.")
        entries: dict[str, MeshEntry] = {}
        remarks: list[str] = []
        known: set[str] = set()
        for path in [as_path(each, "a path of meshes") for each in given]:
            tree = tree_at(path)
            layout, (meshes, notes) = recognise(tree)
            if not tree.single:
                remarks.append("; ".join([f"{escape_control(str(path))}: layout {layout.name}", *notes]))
            for each in meshes:
                file = tree.path_of(each.file)
                absolute = os.path.abspath(file)
                if absolute in known:
                    continue
                known.add(absolute)
                key = _unique_key(escape_control(each.key), entries)
                load = (
                    partial(_unreadable, file.parent)
                    if file.name == ALL
                    else _FromFile(file, up or layout.up, unit, key, colors)
                )
                axis = up or layout.up or default_up(file)
                entries[key] = MeshEntry(key, escape_control(each.label), each.split, load, file, axis, unit or "")
        found = cls(sorted(entries.values(), key=lambda entry: _natural(entry.key)), remarks)
        return found if labels is None else found.labelled(labels)

    def labelled(self, path: str | os.PathLike[str]) -> "MeshCollection":
        """Return the entries named in a label file, with its classes and splits.

        Raises
        ------
        OptionError
            The file cannot be read, no label matches a mesh, or a label matches several.
        """
        labels = read_labels(as_path(path, "labels"))
        found, n_unknown = match({entry.key: entry for entry in self}, labels)
        if not found:
            raise OptionError(
                f"{path}: none of its {len(labels):,} labels matches a mesh; the first label is "
                f"{labels[0].key!r:.80}, the first mesh {self[0].key!r:.80}."
            )
        entries = [
            replace(e, label=escape_control(label.label or e.label), split=label.split or e.split) for e, label in found
        ]
        remark = (
            f"{escape_control(str(path))}: {len(found):,} of {len(self):,} meshes are named there, the others left out"
        )
        if n_unknown:
            remark += f"; {n_unknown:,} of its labels match no mesh"
        return MeshCollection(entries, (*self.remarks, remark))

    def select(self, *, classes: Iterable[str] | None = None, splits: Iterable[str] | None = None) -> "MeshCollection":
        """Return the entries of some classes and splits, in their order.

        Raises
        ------
        OptionError
            No entry has one of the classes or splits.
        """
        chosen = {}
        for what, names, known in (
            ("class", classes, self.classes),
            ("split", splits, [split for split in SPLITS if any(entry.split == split for entry in self)]),
        ):
            chosen[what] = set(known) if names is None else {names} if isinstance(names, str) else set(names)
            for name in sorted(chosen[what]):
                check_choice(what, name, known)
        return self._with(e for e in self if e.label in chosen["class"] and e.split in chosen["split"])

    def divided(self, shares: Sequence[float], seed: int = 0) -> "MeshCollection":
        """Return the entries with splits drawn at random: `shares` of train, val and test.

        The split of an entry follows from its key and the seed alone, so further entries move none. It is drawn for
        each entry by itself: of n entries the shares are met to about 1 / sqrt(n).

        Raises
        ------
        OptionError
            `shares` are not three numbers from 0 on with the sum 1, or the entries have splits already.
        """
        given = [float(share) for share in np.atleast_1d(shares)]
        if len(given) != len(SPLITS) or not (min(given) >= 0.0 and abs(sum(given) - 1.0) < 1e-6):
            shown = ",".join(f"{share:g}" for share in given)
            raise OptionError(f"--split must be three shares, of train, val and test, with the sum 1; got {shown}.")
        if (splits := {entry.split for entry in self}) - {"train"}:  # meshes without splits are all in train
            present = ", ".join(split for split in SPLITS if split in splits)
            raise OptionError(f"--split is for meshes without splits; these have {present}. Leave it out.")
        ends = np.cumsum(given)[:-1]
        places = (seed_of(seed, entry.key + "/split").generate_state(1)[0] / 2**32 for entry in self)
        chosen = (SPLITS[int(np.searchsorted(ends, place, side="right"))] for place in places)
        said = ", ".join(f"{split} {share:g}" for split, share in zip(SPLITS, given, strict=True))
        entries = (replace(entry, split=split) for entry, split in zip(self, chosen, strict=True))
        return MeshCollection(entries, (*self.remarks, f"splits drawn by key, seed {seed}: {said}"))

    def limit(self, n: int) -> "MeshCollection":
        """Return the first `n` entries, or all if there are fewer; raise OptionError for `n` below 1."""
        if n < 1:
            raise OptionError(f"a limit must be at least 1; got {n}.")
        return self[:n]

    def interleaved(self) -> "MeshCollection":
        """Return the entries reordered so that classes and splits alternate.

        The first entries, as many as there are classes, contain every class and each split about equally often. The
        order within a class and split stays.
        """
        queues: dict[str, dict[str, list[MeshEntry]]] = {}
        for entry in self:
            queues.setdefault(entry.label, {}).setdefault(entry.split, []).append(entry)
        turns = []
        for number, label in enumerate(self.classes):
            splits = [split for split in SPLITS if split in queues[label]]
            first = number % len(splits)  # consecutive classes begin with different splits
            turns.append(list(_round_robin([queues[label][split] for split in splits[first:] + splits[:first]])))
        return self._with(_round_robin(turns))

    def _with(self, entries: Iterable[MeshEntry]) -> "MeshCollection":
        return MeshCollection(entries, self.remarks)


@dataclass(frozen=True, slots=True)
class _FromFile:
    """A function that loads a mesh from its file, 300 bytes smaller than a `partial`: there may be millions."""

    file: Path
    up: str | None
    unit: str | None
    name: str
    colors: bool

    def __call__(self) -> Mesh:
        return load_mesh(self.file, up=self.up, unit=self.unit, name=self.name, colors=self.colors)


def _unreadable(folder: Path) -> Mesh:
    """Raise MeshError with the cause that a folder cannot be read."""
    check_readable(folder)
    raise MeshError(f"{folder}: the folder could not be read when meshes were searched. Start again.")


def _unique_key(key: str, entries: dict[str, MeshEntry]) -> str:
    number, unique = 1, key
    while unique in entries:
        number += 1
        unique = f"{key}~{number}"
    return unique


def _round_robin(queues: list[list[MeshEntry]]) -> Iterator[MeshEntry]:
    """Yield the first entry of each queue, then the second of each, and so on."""
    for row in zip_longest(*queues):
        yield from (entry for entry in row if entry is not None)


def _natural(text: str) -> tuple[bytes, str]:
    """Return a sort key in which runs of ASCII digits compare as numbers, after letters.

    The key is small, since the keys of all entries are in memory at once.
    """
    return _DIGITS.sub(_natural_digits, text.encode(errors="surrogatepass")), text


def _natural_digits(run: re.Match[bytes]) -> bytes:
    digits = run[0].lstrip(b"0")
    end_of_word = b"\0" if run.start() else b""
    return b"%b\xff%b%b" % (end_of_word, len(digits).to_bytes(2), digits)


_DIGITS = re.compile(rb"[0-9]+")


class _PickledEntries:
    """Entries stored as bytes and unpickled on demand: two arrays for a million entries."""

    def __init__(self, entries: Sequence[MeshEntry]) -> None:
        bundles = [pickle.dumps(entries[i : i + _BUNDLE], protocol=5) for i in range(0, len(entries), _BUNDLE)]
        self._n = len(entries)
        self._ends = np.cumsum([0, *map(len, bundles)])
        self._bytes = np.frombuffer(b"".join(bundles), np.uint8)
        self._last: tuple[int, Sequence[MeshEntry]] = (-1, ())

    def __len__(self) -> int:
        return self._n

    def __getitem__(self, index: int) -> MeshEntry:
        bundle, row = divmod(range(self._n)[index], _BUNDLE)
        return self._bundle(bundle)[row]

    def __iter__(self) -> Iterator[MeshEntry]:
        for bundle in range(len(self._ends) - 1):
            yield from self._bundle(bundle)

    def _bundle(self, number: int) -> Sequence[MeshEntry]:
        known, entries = self._last  # read once: another thread may replace it
        if known != number:
            entries = pickle.loads(self._bytes[self._ends[number] : self._ends[number + 1]].tobytes())
            self._last = number, entries
        return entries
