"""Mesh files by name, in folders or inside ZIP archives, which are read in place: ModelNet40.zip/chair/train/a.off."""

import os
import zipfile
from functools import lru_cache
from pathlib import Path, PurePosixPath

from zbuf_occlude.errors import MeshError, in_words

SUFFIX = ".zip"


def archive_of(path: Path) -> tuple[Path, str] | None:
    """Return the archive that a path leads into and the member's name; None for a path outside archives."""
    if SUFFIX not in os.fspath(path).lower():  # as nearly all
        return None
    for archive in path.parents:
        if archive.suffix.lower() == SUFFIX and archive.is_file():
            return archive, path.relative_to(archive).as_posix()
    return None


def members(archive: Path) -> list[PurePosixPath]:
    """Return the names of an archive's files; those that lead out of it, as nobody packs them, are left out.

    Raises
    ------
    MeshError
        The archive cannot be read.
    """
    names = (PurePosixPath(name) for name in _opened(archive).namelist() if not name.endswith("/"))
    return [name for name in names if not name.is_absolute() and ".." not in name.parts]


def read_bytes(path: Path) -> bytes:
    """Return the content of a file, in a folder or in an archive.

    Raises
    ------
    MeshError
        It is missing, no file, not readable, or empty.
    """
    if (place := archive_of(path)) is not None:
        data = _member(*place)
    else:
        try:
            if path.is_dir():
                raise MeshError("it must be a file; it is a folder. Use MeshCollection.from_paths for folders.")
            if not path.exists():
                raise MeshError("there is no such file. Check the path.")
            if not path.is_file():
                raise MeshError("it must be a file; it is a device or a pipe. Copy it into a file.")
            data = path.read_bytes()
        except OSError as error:
            raise MeshError(f"it must be readable; reading says: {error.strerror}. Check it.") from None
    if not data:
        raise MeshError("it must hold a mesh; it is empty, 0 bytes. Copy it again.")
    return data


def in_any_case(path: Path, root: Path) -> Path | None:
    """Return the file below a folder whose path differs from this one in case alone; None where there is none."""
    if (place := archive_of(path)) is not None:
        archive, name = place
        member = _members_in_any_case(archive, os.getpid()).get(name.casefold(), name)
        return archive / member if member != name else None
    found = root
    for part in path.relative_to(root).parts:
        try:
            names = {part.casefold(): part} if (found / part).exists() else _names_in(found, found.stat().st_mtime_ns)
        except OSError:
            return None
        if part.casefold() not in names:
            return None
        found /= names[part.casefold()]
    return found if found != path else None


@lru_cache(maxsize=16)
def _names_in(folder: Path, changed_ns: int) -> dict[str, str]:
    """Return the names in a folder as it was when last changed, by what they are in any case."""
    return {name.casefold(): name for name in sorted(os.listdir(folder), reverse=True)}


def _member(archive: Path, name: str) -> bytes:
    try:
        return _opened(archive).read(name)
    except KeyError:
        raise MeshError(f"there is no such file in {archive.name}. Check the path.") from None
    except Exception as error:  # what zipfile and its decompressors raise on damaged bytes is not ours to list
        said = " ".join(str(error).split())[:100] or type(error).__name__
        raise MeshError(f"it must be readable in {archive.name}; reading says: {said}. Is it damaged?") from None


@lru_cache(maxsize=4)
def _members_in_any_case(archive: Path, process: int) -> dict[str, str]:
    return {name.casefold(): name for name in sorted(_opened(archive).namelist(), reverse=True)}


def _opened(archive: Path) -> zipfile.ZipFile:
    return _cached(archive, os.getpid())


@lru_cache(maxsize=64)  # ShapeNetCore's 57: opening one anew takes up to a second, holding all some 200 MB
def _cached(archive: Path, process: int) -> zipfile.ZipFile:
    """Open an archive once per process: a file opened before a fork would be read at the other's position."""
    try:
        return zipfile.ZipFile(archive)
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise MeshError(
            f"{archive}: it must be a ZIP archive; reading says: {in_words(error)}. Is it damaged?"
        ) from None
