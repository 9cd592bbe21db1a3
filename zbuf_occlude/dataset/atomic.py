"""Files that are either whole or not there: written under a temporary name, synced, renamed."""

import errno
import json
import os
import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

_TEMPORARY = re.compile(r"\..+\.\d+\.part", re.DOTALL)


def write(path: Path, fill: Callable[[IO[bytes]], object]) -> None:
    """Let `fill` write to an open file; the file appears under `path` only when all of it is on the disk."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with open(temporary, "wb") as file:
            fill(file)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OSError as error:
        if error.errno is None:  # from inside NumPy
            raise OSError(errno.EIO, "it could not be written whole; is the disk full?", str(path)) from error
        if error.filename is not None:
            error.filename = str(path)  # the name that people know
        raise
    finally:
        with suppress(OSError):  # it is not there any more, or never was
            temporary.unlink()


def leftovers(folder: Path) -> list[Path]:
    """Return the temporary files that killed processes have left in a folder and below it."""
    return [path for path in folder.rglob(".*.part") if _TEMPORARY.fullmatch(path.name)]


def write_json(path: Path, document: Any) -> None:
    """Write plain data as indented JSON."""
    text = json.dumps(document, indent=2, sort_keys=True) + "\n"
    write(path, lambda file: file.write(text.encode()))


def write_lines(path: Path, lines: list[str]) -> None:
    """Write a text file of one entry a line."""
    text = "".join(line + "\n" for line in lines)
    write(path, lambda file: file.write(text.encode()))
