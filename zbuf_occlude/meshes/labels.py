"""Label files, which name the class and split of each object: CSV, or the JSON of PCN and LVIS."""

import gzip
import io
import zlib
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path, PurePath, PurePosixPath
from typing import Any, TypeVar

from zbuf_occlude.base.documents import MAX_BYTES, MAX_ROWS, parse_document, read_limited
from zbuf_occlude.base.errors import OptionError, describe, escape_control

FORMS = "CSV with the columns key,class[,split], or JSON: PCN's list, LVIS's {class: [keys]}, {key: class}"
_KEYS = ("key", "uid", "modelid", "model_id", "id", "file", "path", "name")
_CLASSES = ("class", "label", "category", "taxonomy_name", "synsetid")
_SPLITS = ("split", "subset")
SPLIT_WORDS: Mapping[str, str] = {"train": "train", "val": "val", "valid": "val", "validation": "val", "test": "test"}

_SMALL, _LARGEST, _RATIO = 2**24, max(MAX_BYTES.values()), 100
"""Limits of unpacked gzip: `_RATIO` times its size, but at least `_SMALL` and at most `_LARGEST` bytes."""

_Item = TypeVar("_Item")


@dataclass(frozen=True)
class Label:
    """The class and split of one object in a file; None where the file has none.

    The key is the mesh's key or a unique end of it: SYNSET/MODEL, MODEL, a uid, a file's name.
    """

    key: str
    label: str | None
    split: str | None = None

    @property
    def said(self) -> str:
        """The class and split, in words."""
        return ", ".join(f"{word!r:.80}" for word in (self.label, self.split) if word is not None) or "none"


def read_labels(path: Path) -> list[Label]:
    """Read a label file.

    Raises
    ------
    OptionError
        The file cannot be read, has an unknown form, or names an unknown split.
    """
    data = read_limited(path)
    if data[:2] == b"\x1f\x8b":
        try:
            data = unpacked(data, path)
        except (OSError, EOFError, zlib.error) as error:
            raise OptionError(f"{path}: cannot unpack gzip: {describe(error)}. Is it damaged?") from None
    is_json = ".json" in path.suffixes or data.lstrip()[:1] in (b"{", b"[")
    labels = parse_json(data, path.name) if is_json else parse_csv(data, path.name)
    if not labels:
        raise OptionError(f"{path} must contain labels ({FORMS}); it has none.")
    return labels


def unpacked(data: bytes, path: PurePath) -> bytes:
    """Return unpacked gzip, within limits: a malicious file may grow a thousandfold.

    Raises
    ------
    OptionError
        The content is larger than the limits.
    OSError, EOFError, zlib.error
        The data are damaged.
    """
    most = min(_LARGEST, max(_SMALL, _RATIO * len(data)))
    with gzip.GzipFile(fileobj=io.BytesIO(data)) as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise OptionError(
            f"{path}: {len(data):,} bytes of gzip must unpack to at most {most:,}; they unpack to more. Unpack and "
            "check the file: labels take some 100 bytes an object."
        )
    return content


def parse_csv(data: bytes, name: str) -> list[Label]:
    """Return the labels of a CSV file with a header, such as ShapeNet's all.csv (synsetId, modelId, split)."""
    columns = parse_document("CSV", data, name)
    key, label, split = (next((c for c in known if c in columns), "") for known in (_KEYS, _CLASSES, _SPLITS))
    if not key or not (label or split):
        raise OptionError(f"{escape_control(name)} must be {FORMS}; found: {', '.join(columns):.200}.")
    keys, lines = columns[key], columns.lines
    own, synsets, words = (columns.get(column, [""] * len(keys)) for column in (label, "synsetid", split))
    return [
        Label(
            f"{synset.zfill(8)}/{key}".strip() if synset else key.strip(),
            own or None if label != "synsetid" else None,
            _split(word or None, f"{name}, line {line}"),
        )
        for line, key, own, synset, word in zip(lines, keys, own, synsets, words, strict=True)
        if key
    ]


def parse_json(data: bytes, name: str) -> list[Label]:
    """Return the labels of PCN's list of taxonomies, LVIS's object of lists, or an object of classes by key."""
    document = parse_document("JSON", data, name)
    try:
        labels = list(islice(_labels_in(document), MAX_ROWS + 1))
    except (LookupError, TypeError, AttributeError):  # JSON of any other form
        raise OptionError(f"{escape_control(name)} must be {FORMS}; it is JSON of another form.") from None
    if len(labels) > MAX_ROWS:
        raise OptionError(f"{escape_control(name)} must have at most {MAX_ROWS:,} labels; it has more. Split it.")
    return labels


def _labels_in(document: Any) -> Iterator[Label]:
    if isinstance(document, dict) and all(isinstance(keys, list) for keys in document.values()):
        return (Label(_word(key), label) for label, keys in document.items() for key in keys)
    if isinstance(document, dict):
        return (Label(key, _word(label)) for key, label in document.items())
    return (
        Label(f"{_word(row['taxonomy_id'])}/{_word(key)}", _word(row["taxonomy_name"]), split)
        for row in document
        for split in ("train", "val", "test")
        for key in row.get(split, [])
    )


def match(items: Mapping[str, _Item], labels: Sequence[Label]) -> tuple[list[tuple[_Item, Label]], int]:
    """Return the labelled objects in their order with their labels, and the number of labels without an object.

    A label SYNSET/MODEL of no object is that of MODEL, unless another label names this one.

    Raises
    ------
    OptionError
        A label matches several objects, or the labels of one object differ.
    """
    short: defaultdict[str, list[str]] = defaultdict(list)
    for key in items:
        path = PurePosixPath(key)
        for name in {str(path.with_suffix("")), path.name, path.stem} - {key}:
            short[name].append(key)

    def keys_of(name: str) -> Sequence[str]:
        return [name] if name in items else short.get(name, [])

    named = {key for label in labels for key in keys_of(label.key)}
    chosen: dict[str, Label] = {}
    n_unknown = 0
    for label in labels:
        keys = keys_of(label.key) or [key for key in keys_of(PurePosixPath(label.key).name) if key not in named]
        if len(keys) > 1:
            raise OptionError(
                f"a label must match one mesh; {label.key!r:.80} matches {', '.join(keys[:3])}. Write the whole key."
            )
        first = chosen.setdefault(keys[0], label) if keys else label
        if (first.label, first.split) != (label.label, label.split):
            raise OptionError(
                f"a mesh must have one label; {keys[0]!r:.80} has {first.said} and {label.said}. Keep one."
            )
        n_unknown += not keys
    return [(items[key], chosen[key]) for key in items if key in chosen], n_unknown


def _word(value: object) -> str:
    if isinstance(value, bool) or not isinstance(value, str | int):
        raise TypeError("a key or class must be a word")
    return str(value)


def _split(word: str | None, name: str) -> str | None:
    if word is None:
        return None
    if (split := SPLIT_WORDS.get(word.strip().lower())) is None:
        raise OptionError(f"{name} must name the splits train, val or test; it has {word!r:.80}. Correct it.")
    return split
