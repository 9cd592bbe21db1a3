"""MeshFiles: the files of one mesh, each read once, the origin they make up, and whether they are still the same."""

import hashlib
import os
from pathlib import Path

from zbuf_occlude.errors import MeshError
from zbuf_occlude.meshes.archives import archive_of, read_bytes
from zbuf_occlude.provenance import UNKNOWN, Origin, Stamp


class MeshFiles:
    """The files of the mesh at a path as they are read: each once, and what it held is remembered."""

    def __init__(self, path: Path) -> None:
        self._folder = path.parent
        self._contents: dict[Path, bytes] = {}
        self._stamps: list[Stamp] = []

    def read(self, path: Path) -> bytes:
        """Return the content of a file; raises as `archives.read_bytes` does."""
        if path not in self._contents:
            try:
                stamp = _stamp(path, self._folder)
            except (OSError, ValueError):
                stamp = Stamp(path.name, 0, 0)  # reading it says why
            self._contents[path] = read_bytes(path)
            self._stamps.append(stamp)
        return self._contents[path]

    @property
    def origin(self) -> Origin:
        """Of what was read so far."""
        digests = [hashlib.sha256(content).hexdigest() for content in self._contents.values()]
        if len(digests) > 1:
            digests = [hashlib.sha256("\n".join(digests).encode()).hexdigest()]
        return Origin(digests[0], tuple(self._stamps))


def origin_now(path: Path, then: Origin) -> Origin:
    """Return what a mesh made of `then` would be made of now.

    That is `then` itself, and nothing is read, where no file changed its size or time. A file that cannot be read has
    an unknown origin.
    """
    folder = path.parent
    paths = [path, *(folder / stamp.name for stamp in then.files[1:])]
    try:
        if tuple(_stamp(each, folder) for each in paths) == then.files:
            return then
        files = MeshFiles(path)
        for each in paths:
            files.read(each)
    except (OSError, ValueError, MeshError):
        return UNKNOWN
    return files.origin


def origin_unread(path: Path) -> Origin:
    """Return what shows of a file without reading it; of glTF its folder too, where buffers may appear."""
    paths = [path, *([path.parent] if path.suffix.lower() in (".gltf", ".glb") else [])]
    try:
        return Origin("", tuple(_stamp(each, path.parent) for each in paths))
    except (OSError, ValueError):
        return UNKNOWN


def _stamp(path: Path, folder: Path) -> Stamp:
    inside = archive_of(path)
    status = os.stat(path if inside is None else inside[0])
    return Stamp(_name_from(path, folder), status.st_size, status.st_mtime_ns)


def _name_from(path: Path, folder: Path) -> str:
    if path.parent == folder:  # as nearly all: a million folders need not be resolved
        return path.name
    for base in (folder, folder.resolve()):
        if path.is_relative_to(base):
            return path.relative_to(base).as_posix()
    return Path(os.path.relpath(path, folder)).as_posix()  # textures may lie next to the folder
