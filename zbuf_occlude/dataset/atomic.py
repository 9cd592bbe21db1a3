"""Files that are either whole or not there: written under a temporary name, synced as a rule, renamed."""

import errno
import io
import json
import os
import re
import secrets
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

_TEMPORARY = re.compile(r"\.zbuf-[0-9a-f]{16}\.part")


def write(path: Path, fill: Callable[[IO[bytes]], object], *, exclusive: bool = False, synced: bool = True) -> None:
    """Let `fill` write to an open file; the file appears under `path` only when all of it is on the disk.

    Parameters
    ----------
    path : Path
    fill : callable
    exclusive : bool
        Leave a file that is there already.
    synced : bool
        If not, the file appears when all of it is written; what of it the last seconds before a loss of power brought
        may be lost. For files of unfinished work that say themselves whether they are whole: nothing waits for the
        disk, and files that are soon removed may never go there.

    Raises
    ------
    FileExistsError
        There is one, and this was to be exclusive.
    OSError
        It cannot be written.
    """
    # random, not the process's number: machines and containers that share a folder have the same numbers
    temporary = path.with_name(f".zbuf-{secrets.token_hex(8)}.part")
    try:
        with open(temporary, "xb") as file:
            fill(file)
            file.flush()
            if synced:
                os.fsync(file.fileno())
        _publish(temporary, path, exclusive)
    except OSError as error:
        if error.errno is None:  # from inside NumPy
            raise OSError(errno.EIO, "it could not be written whole; is the disk full?", str(path)) from error
        if error.filename is not None:
            error.filename = str(path)  # the name that people know
        raise
    finally:
        with suppress(OSError):  # it is not there any more, or never was
            temporary.unlink()


def _publish(temporary: Path, path: Path, exclusive: bool) -> None:
    if exclusive:
        try:
            os.link(temporary, path)
            return
        except FileExistsError:
            raise
        except OSError:  # a file system without links
            if path.exists():
                raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path)) from None
    os.replace(temporary, path)


def leftovers(folders: Iterable[Path]) -> list[Path]:
    """Return the temporary files that killed processes have left in some folders, not below them."""
    found = []
    for folder in folders:
        with suppress(OSError):  # it is not there
            found += [path for path in folder.iterdir() if is_temporary(path.name)]
    return found


def is_temporary(name: str) -> bool:
    """Whether a file's name is one of those that files are written under."""
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
