"""Atomic writing of files (temporary name, sync, rename), and errors that name a damaged file."""

import errno
import hashlib
import io
import json
import os
import re
import secrets
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tarfile import TarError
from tokenize import TokenError
from typing import IO, Any, NamedTuple
from zipfile import BadZipFile

from zbuf_occlude.base.errors import DatasetError

LOCK = ".zbuf-lock"
"""File of a dataset's folder that a run holds locked while it is at work."""
_TEMPORARY = re.compile(rf"\.zbuf-[0-9a-f]{{16}}\.part|{re.escape(LOCK)}")


class FileDigest(NamedTuple):
    """The name, the size and the SHA-256 of a file."""

    name: str
    n_bytes: int
    sha256: str


def write(path: Path, fill: Callable[[IO[bytes]], object], *, exclusive: bool = False, synced: bool = True) -> None:
    """Let `fill` write to an open file; the file appears under `path` only when all of it is on the disk.

    Without `synced` it appears when all of it is written: nothing waits for the disk, and a power loss may take the
    file. With `exclusive` a file that is there already stays, and FileExistsError is raised. A failed write is an
    OSError.
    """
    # random, not the process's number: machines and containers that share a folder have the same numbers
    temporary = path.with_name(f".zbuf-{secrets.token_hex(8)}.part")
    try:
        with open(temporary, "x+b") as file:
            fill(file)
            file.flush()
            if synced:
                os.fsync(file.fileno())
        if exclusive:
            _link(temporary, path)
        else:
            os.replace(temporary, path)
    except OSError as error:
        if error.errno is None:  # from inside NumPy
            raise OSError(errno.EIO, "it could not be written whole; is the disk full?", str(path)) from error
        error.filename = str(path)  # the name that people know
        raise
    finally:
        with suppress(OSError):  # it is not there any more, or never was
            temporary.unlink()


def write_data(path: Path, fill: Callable[[IO[bytes]], object]) -> FileDigest:
    """Write a file as `write` does, and return its digest."""
    found: list[FileDigest] = []

    def fill_and_digest(file: IO[bytes]) -> None:
        fill(file)
        n_bytes = file.seek(0, os.SEEK_END)
        file.seek(0)
        found.append(FileDigest(path.name, n_bytes, hashlib.file_digest(file, "sha256").hexdigest()))  # type: ignore[arg-type]

    write(path, fill_and_digest)
    return found[0]


def _link(temporary: Path, path: Path) -> None:
    try:
        os.link(temporary, path)
    except FileExistsError:
        raise
    except OSError:  # a file system without links
        if path.exists():
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path)) from None
        os.replace(temporary, path)


def leftovers(folders: Iterable[Path]) -> list[Path]:
    """Return the temporary files that killed processes have left in some folders, without their subfolders."""
    found = []
    for folder in folders:
        with suppress(OSError):  # it is not there
            found += [path for path in folder.iterdir() if is_temporary(path.name)]
    return found


def is_temporary(name: str) -> bool:
    """Return whether a file's name is a temporary one, or that of the lock."""
    return _TEMPORARY.fullmatch(name) is not None


def write_json(path: Path, document: Any, *, exclusive: bool = False) -> None:
    """Write plain data as indented JSON; `exclusive` as in `write`."""

    def fill(file: IO[bytes]) -> None:  # piece by piece: of a million meshes the whole text would be 300 MB
        text = io.TextIOWrapper(file, "ascii", newline="\n", write_through=False)
        json.dump(document, text, indent=2, sort_keys=True)
        text.write("\n")
        text.detach()

    write(path, fill, exclusive=exclusive)


def write_lines(path: Path, lines: list[str]) -> None:
    """Write a text file of one entry a line."""
    text = "".join(line + "\n" for line in lines)
    write(path, lambda file: file.write(text.encode()))


REMEDY = "Copy it again from where it was made, or make the dataset again, with --overwrite."
DAMAGES = (
    ArithmeticError,
    AttributeError,  # of HDF5, where a group stands for a dataset
    BadZipFile,
    EOFError,
    LookupError,
    OSError,
    RuntimeError,  # of HDF5, and of ZIP members that claim to be encrypted or packed in another way
    SyntaxError,  # of NumPy, whose headers are Python
    TarError,
    TokenError,
    TypeError,
    ValueError,
    struct.error,
    zlib.error,
)
"""Errors that h5py, NumPy, tarfile, zipfile, json and the use of their values raise where bytes are damaged."""


@contextmanager
def reading(path: Path, remedy: str = REMEDY) -> Iterator[None]:
    """Turn the errors of reading a damaged file or folder into a DatasetError that names it and the remedy."""
    try:
        yield
    except DatasetError:  # it was said already
        raise
    except FileNotFoundError:
        raise DatasetError(f"{path} must be there; it is missing. {remedy}") from None
    except DAMAGES as error:
        text = " ".join(str(error).split())[:200]
        reason = f"no {text}" if isinstance(error, KeyError) else text or type(error).__name__
        raise DatasetError(f"{path} must be as it was written; it cannot be read ({reason}). {remedy}") from None
