"""Provenance: the sources of meshes, the versions that data depend on, and the seeds of all random draws.

A seed depends on a mesh's key and on the draw, never on a worker, a machine or an order.
"""

import hashlib
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any, NamedTuple

import numpy as np

from zbuf_occlude.base.errors import OptionError, shown

PACKAGES = (
    "zbuf-occlude",
    "numpy",
    "numba",
    "moderngl",
    "trimesh",
    "h5py",
    "pyrender",
    "embreex",
    "open3d",
    "warp-lang",
)
"""Packages whose versions are in every manifest and row of a comparison."""


class FileStat(NamedTuple):
    """The name of a file, from the mesh's folder on, and its size in bytes; of a file in an archive the archive's."""

    name: str
    size: int


@dataclass(frozen=True, slots=True)
class MeshSource:
    """The source of a mesh.

    Parameters
    ----------
    sha256 : str
        Of the file's content, in hexadecimal; of several files, of the lines of their own; of a mesh from no file, of
        its recipe. Empty where nothing is known.
    files : tuple of FileStat
        The mesh's own file first, then those that it names. Empty for a mesh from no file.
    """

    sha256: str = ""
    files: tuple[FileStat, ...] = ()

    @classmethod
    def of_recipe(cls, *values: str | int) -> "MeshSource":
        """Return the origin of a mesh that is computed from these values."""
        return cls(hashlib.sha256(repr(values).encode()).hexdigest())

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> "MeshSource":
        """Read back what `to_dict` gave."""
        return cls(document["sha256"], tuple(FileStat(*each) for each in document["files"]))

    def to_dict(self) -> dict[str, Any]:
        """Return the source as plain data."""
        return {"sha256": self.sha256, "files": [list(stamp) for stamp in self.files]}


UNKNOWN = MeshSource()


@cache
def versions() -> dict[str, str]:
    """Return the versions of Python and of the installed packages, by name."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:  # an extra
            continue
    return found


def generator(seed: Any) -> np.random.Generator:
    """Return a generator of a seed, a SeedSequence or a generator.

    Raises
    ------
    OptionError
        It is none of these, or below 0.
    """
    is_int = isinstance(seed, int | np.integer) and not isinstance(seed, bool) and seed >= 0
    if not is_int and not isinstance(seed, np.random.SeedSequence | np.random.Generator):
        raise OptionError(f"seed must be an int of at least 0, a SeedSequence or a Generator; got {shown(seed)}.")
    return np.random.default_rng(seed)


def seed_of(seed: int, key: str, *path: int) -> np.random.SeedSequence:
    """Return the seed of a draw.

    `path` tells the draws of a mesh apart: (variation,) for its points, (variation, view) for a cloud's subset.
    """
    digest = hashlib.sha256(key.encode()).digest()
    return np.random.SeedSequence([seed, int.from_bytes(digest[:8], "little"), *path])
