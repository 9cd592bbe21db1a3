"""Origin: what a mesh was made of, the content of its files or a recipe, so that a change of it is noticed."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple


class Stamp(NamedTuple):
    """What a file shows without being read: its name from the mesh's folder on, bytes, time of change in ns.

    Of a file in an archive bytes and time are the archive's.
    """

    name: str
    size: int
    time: int


@dataclass(frozen=True, slots=True)
class Origin:
    """What a mesh was made of.

    Parameters
    ----------
    sha256 : str
        Of the file's content, in hexadecimal; of several files, of the lines of their own; of a mesh from no file, of
        its recipe. Empty where nothing is known.
    files : tuple of Stamp
        The mesh's own file first, then those that it names. Empty for a mesh from no file.
    """

    sha256: str = ""
    files: tuple[Stamp, ...] = ()

    @classmethod
    def of_recipe(cls, *values: str | int) -> "Origin":
        """Return the origin of a mesh that is computed from these values."""
        return cls(hashlib.sha256(repr(values).encode()).hexdigest())

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> "Origin":
        """Read back what `document` gave."""
        return cls(document["sha256"], tuple(Stamp(*each) for each in document["files"]))

    @property
    def document(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        return {"sha256": self.sha256, "files": [list(stamp) for stamp in self.files]}


UNKNOWN = Origin()
