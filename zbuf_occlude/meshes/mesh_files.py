"""The files of a mesh, in folders or in ZIP archives, which are read in place: ModelNet40.zip/chair/train/a.off."""

import hashlib
import os
import zipfile
from functools import lru_cache
from pathlib import Path, PurePosixPath

from zbuf_occlude.base.errors import MeshError, describe
from zbuf_occlude.base.limits import memory_allowed
from zbuf_occlude.base.provenance import FileStat, MeshSource

ARCHIVE = ".zip"


class MeshFiles:
    """The files of the mesh at a path, each read once and cached."""

    def __init__(self, path: Path) -> None:
        self.folder = path.parent
        self._contents: dict[Path, bytes] = {}
        self._stats: list[FileStat] = []

    def read(self, path: Path) -> bytes:
        """Return the content of a file; raises as `content_of` does."""
        if path not in self._contents:
            try:
                stat = _file_stat(path, self.folder)
            except (OSError, ValueError):
                stat = FileStat(path.name, 0)  # content_of raises with the cause
            self._contents[path] = content_of(path)
            self._stats.append(stat)
        return self._contents[path]

    def read_named(self, name: str) -> bytes:
        """Return the content of a file that the mesh's file names: at that path, or of that name in the mesh's folder.

        A name that differs only in case is accepted, as on a file system that ignores case. Files outside the folder
        above the mesh's are not read.

        Raises
        ------
        MeshError
            There is no such file.
        """
        relative = name.replace("\\", "/").strip().strip('"')
        root = Path(os.path.normpath(self.folder.parent))
        stated = Path(os.path.normpath(self.folder / relative))
        candidates = [stated] * stated.is_relative_to(root) + [self.folder / os.path.basename(relative)]
        for candidate in candidates:
            try:
                return self.read(candidate)
            except MeshError as error:
                reason = error
            if (other := _in_any_case(candidate, root)) is not None:
                return self.read(other)
        raise MeshError(f"{name[:80]!r}: {reason}") from None

    @property
    def origin(self) -> MeshSource:
        """Source of the files read so far."""
        digests = [hashlib.sha256(content).hexdigest() for content in self._contents.values()]
        if len(digests) > 1:
            digests = [hashlib.sha256("\n".join(digests).encode()).hexdigest()]
        return MeshSource(digests[0], tuple(self._stats))


def has_changed(path: Path, source: MeshSource) -> bool:
    """Return whether a file that a mesh was made of is gone, or has another size."""
    try:
        return any(_file_stat(path.parent / stat.name, path.parent).size != stat.size for stat in source.files)
    except (OSError, ValueError):
        return True


def archive_of(path: Path) -> tuple[Path, str] | None:
    """Return the archive that contains a path, and the member's name; None for a path outside archives."""
    if ARCHIVE not in os.fspath(path).lower():  # true of nearly all paths
        return None
    for archive in path.parents:
        if archive.suffix.lower() == ARCHIVE and archive.is_file():
            return archive, path.relative_to(archive).as_posix()
    return None


def members(archive: Path) -> list[PurePosixPath]:
    """Return the names of an archive's files, without those outside its root; raise MeshError if it cannot be read."""
    names = (PurePosixPath(name) for name in _opened(archive).namelist() if not name.endswith("/"))
    return [name for name in names if not name.is_absolute() and ".." not in name.parts]


def n_bytes_of(path: Path) -> int | None:
    """Return the size of a file in bytes, None if it is missing; raise MeshError for an unreadable archive."""
    if (member := archive_of(path)) is not None:
        archive, name = member
        return _opened(archive).getinfo(name).file_size if name in _opened(archive).NameToInfo else None
    try:
        return path.stat().st_size
    except (OSError, ValueError):
        return None


def content_of(path: Path) -> bytes:
    """Return the content of a file; raise MeshError if it is missing, no regular file, unreadable or empty."""
    if (member := archive_of(path)) is not None:
        data = _member(*member)
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
            raise MeshError(f"cannot read it: {error.strerror}. Check it.") from None
    if not data:
        raise MeshError("the file is empty. Copy it again.")
    return data


def _member(archive: Path, name: str) -> bytes:
    try:
        return _opened(archive).read(name)
    except KeyError:
        raise MeshError(f"there is no such file in {archive.name}. Check the path.") from None
    except MeshError:  # raised by the limits of time and memory
        raise
    except MemoryError:
        size = _opened(archive).getinfo(name).file_size
        raise MeshError(
            f"it must fit in {memory_allowed()}; unpacked from {archive.name} it has {size:,} bytes. "
            "Allow more, or unpack it and check whether it is a mesh."
        ) from None
    except Exception as error:  # zipfile and its decompressors raise any error on damaged bytes
        cause = " ".join(str(error).split())[:100] or type(error).__name__
        raise MeshError(f"cannot read it in {archive.name}: {cause}. Is it damaged?") from None


def _opened(archive: Path) -> zipfile.ZipFile:
    return _opened_in(archive, os.getpid())


@lru_cache(maxsize=64)  # enough for ShapeNetCore's 57, which take some 200 MB; opening one takes up to a second
def _opened_in(archive: Path, process: int) -> zipfile.ZipFile:
    """Return an archive opened by this process: processes that share an open file share its position too."""
    try:
        return zipfile.ZipFile(archive)
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise MeshError(f"{archive}: cannot read the ZIP archive: {describe(error)}. Is it damaged?") from None


def _in_any_case(path: Path, root: Path) -> Path | None:
    """Return the file below a folder whose path differs from this one only in case; None where there is none."""
    if (inside := archive_of(path)) is not None:
        archive, name = inside
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
    """Return the names in a folder by their case-folded form; `changed_ns` makes the cache follow changes."""
    return {name.casefold(): name for name in sorted(os.listdir(folder), reverse=True)}


@lru_cache(maxsize=4)
def _members_in_any_case(archive: Path, process: int) -> dict[str, str]:
    return {name.casefold(): name for name in sorted(_opened(archive).namelist(), reverse=True)}


def _file_stat(path: Path, folder: Path) -> FileStat:
    inside = archive_of(path)
    status = os.stat(path if inside is None else inside[0])
    return FileStat(_name_from(path, folder), status.st_size)


def _name_from(path: Path, folder: Path) -> str:
    if path.parent == folder:  # nearly always, without resolving a million folders
        return path.name
    for base in (folder, folder.resolve()):
        if path.is_relative_to(base):
            return path.relative_to(base).as_posix()
    return Path(os.path.relpath(path, folder)).as_posix()  # textures may lie beside the folder
