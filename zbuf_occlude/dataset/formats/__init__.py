"""The table of formats, and what each of them is: one file here, one row, written from a source and read as one.

A format's module has two functions:

    write(source, out) -> dict of split to file names    writes its files into a folder; each is whole or not there
    read(out, plan, files) -> Source                      reads them back, when and as far as they are asked for
"""

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Protocol

from zbuf_occlude.checks import find_row
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Source
from zbuf_occlude.meshes.collection import SPLITS


class Module(Protocol):
    """What a format's module has."""

    def write(self, source: Source, out: Path) -> dict[str, list[str]]:
        """Write all clouds of a source; return the names of the files of each split."""

    def read(self, out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
        """Return the clouds of these files."""


@dataclass(frozen=True)
class Format:
    """One row of the table of formats. Its module is imported when the format is used, not before.

    Parameters
    ----------
    name : str
        Also the name of its module.
    summary : str
        One line.
    patterns : tuple of str
        Match its files in a dataset's folder.
    all_points : bool
        Whether it keeps all points of the objects, and not only those that were drawn for each cloud.
    """

    name: str
    summary: str
    patterns: tuple[str, ...]
    all_points: bool = False

    def load(self) -> Module:
        """Import the format's module."""
        module: Module = import_module(f"{__name__}.{self.name}")
        return module


FORMATS: tuple[Format, ...] = (
    Format(
        "hdf5",
        "the PointNet layout: data (n, size, 3) and label, 2,048 clouds a file",
        ("ply_data_*.h5", "*_files.txt"),
    ),
    Format(
        "packed",
        "all points of the objects and a bit for each point and view: some fifty times as many clouds in a megabyte",
        ("packed-[0-9]*.zip",),
        all_points=True,
    ),
    Format("webdataset", "tar shards for streaming", tuple(f"{split}-[0-9]*.tar" for split in SPLITS)),
    Format("npz", "NumPy archives of 2,048 clouds", tuple(f"{split}-[0-9]*.npz" for split in SPLITS)),
    Format("ply", "a file for each cloud, to look at", ("ply/*/*/*.ply", "*_files.txt")),
)


def find_format(name: str) -> Format:
    """Return the row of a name.

    Raises
    ------
    OptionError
        No such format; the message lists those there are.
    """
    return find_row("format", name, FORMATS)
