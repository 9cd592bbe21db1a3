"""Tree: the mesh files of a folder, an archive or a single path, by name; and the small files beside them."""

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath

from zbuf_occlude.base.documents import MAX_BYTES
from zbuf_occlude.base.errors import MeshError, escape_control
from zbuf_occlude.meshes.load import SUFFIXES
from zbuf_occlude.meshes.mesh_files import ARCHIVE, archive_of, content_of, members, n_bytes_of

MAX_FILE_BYTES = max(MAX_BYTES.values())
"""Maximum bytes of a small file beside meshes."""
ALL = "*"
"""File name that stands for the meshes of a folder that cannot be read."""
_SYNSET = re.compile(r"\d{8}")
"""Names of ShapeNetCore's archives, one for each class."""
_UNPACKERS_RUBBISH = "__MACOSX"  # ModelNet's own archives contain it, full of files ._chair_0001.off


@dataclass(frozen=True)
class Tree:
    """The mesh files at one path given by a user."""

    root: PurePosixPath  # absolute, links not resolved; of an archive without its ending
    base: Path  # folder or archive from which the files are read
    files: tuple[PurePosixPath, ...]  # relative to the root
    single: bool = False  # True for a file, False for a folder or archive
    packed: Mapping[PurePosixPath, PurePosixPath] = field(default_factory=dict)  # folders, and their archives' folders

    def path_of(self, file: PurePosixPath) -> Path:
        """Return the path from which a file below the root is read."""
        for folder in file.parents if self.packed else ():
            if folder in self.packed:
                return self.base / self.packed[folder] / file.relative_to(folder)
        return self.base / file

    def read(self, path: PurePosixPath) -> bytes | None:
        """Return the content of a small file by its absolute name; None where there is no such file.

        Raises
        ------
        MeshError
            The file cannot be read, or is larger than documents may be.
        """
        inside = path.is_relative_to(self.root)
        own = self.path_of(path.relative_to(self.root)) if inside else Path(path)
        try:
            size = n_bytes_of(own)
            if size is None:
                return None
            if size > MAX_FILE_BYTES:
                raise MeshError(
                    f"it must have at most {MAX_FILE_BYTES:,} bytes; it has {size:,}. Is it the right file?"
                )
            return content_of(own)
        except MeshError as error:
            raise MeshError(f"{escape_control(str(path))}: {error}") from None

    def named(self, file: PurePosixPath) -> PurePosixPath:
        """Return the absolute name of one of the files."""
        return self.root / file

    def parts(self, file: PurePosixPath) -> tuple[str, ...]:
        """Return the parts of a file's absolute name; much faster than the name."""
        return (*self.root.parts, *file.parts)


def tree_at(path: Path) -> Tree:
    """Return the mesh files at a path.

    Raises
    ------
    MeshError
        The path is missing, cannot be read, has another format, or contains no mesh.
    """
    name = escape_control(str(path))
    if os.path.isdir(path):
        tree, what = _folder_tree(path), "a folder"
    elif path.suffix.lower() == ARCHIVE and path.is_file():
        tree, what = _archive_tree(path), "an archive"
    elif not os.path.exists(path) and archive_of(path) is None:
        raise MeshError(f"{name}: there is no such file or folder. Check the path.")
    elif path.suffix.lower() not in SUFFIXES:
        raise MeshError(f"{name}: a mesh file must end in one of {', '.join(SUFFIXES)}; this does not. Convert it.")
    else:
        return Tree(_absolute(path).parent, path.parent, (PurePosixPath(path.name),), single=True)
    if not tree.files:
        raise MeshError(f"{name}: {what} must have meshes in it ({', '.join(SUFFIXES)}); it has none.")
    return tree


def _absolute(path: Path) -> PurePosixPath:
    return PurePosixPath(Path(os.path.abspath(path)))


def _folder_tree(path: Path) -> Tree:
    found = tuple(map(PurePosixPath, _walk(str(path))))
    zips = [file for file in found if file.suffix.lower() == ARCHIVE]
    files = tuple(file for file in found if file.suffix.lower() != ARCHIVE)
    if files:  # some class folders may still be packed; other archives beside meshes are not read
        zips = [zip for zip in zips if _SYNSET.fullmatch(zip.stem)]
    unread = [zip for zip in zips if not (path / zip.with_suffix("")).exists()]
    return _with_archives(Tree(_absolute(path), path, files), unread)


def _archive_tree(path: Path) -> Tree:
    files = tuple(sorted(name for name in members(path) if _is_mesh(name.parts)))
    root = _absolute(path).with_suffix("")
    wrapper = root.name  # many programs pack the folder itself
    if files and all(len(file.parts) > 1 and file.parts[0] == wrapper for file in files):
        return Tree(root / wrapper, path / wrapper, tuple(PurePosixPath(*file.parts[1:]) for file in files))
    return Tree(root, path, files)


def _with_archives(tree: Tree, zips: Sequence[PurePosixPath]) -> Tree:
    """Return a folder's tree with the meshes of its archives, each as if it were unpacked there."""
    files, packed = list(tree.files), {}
    for zip in zips:
        folder = zip.with_suffix("")
        names = [name for name in members(tree.base / zip) if _is_mesh(name.parts)]
        if all(len(name.parts) > 1 and name.parts[0] == folder.name for name in names):
            files += [folder.parent / name for name in names]
            packed[folder] = zip / folder.name
        else:
            files += [folder / name for name in names]
            packed[folder] = zip
    return replace(tree, files=tuple(sorted(files)), packed=packed) if zips else tree


def check_readable(folder: Path) -> None:
    """Raise MeshError with the cause if a folder cannot be read."""
    try:
        os.scandir(folder).close()
    except OSError as error:
        raise MeshError(f"{folder}: cannot read the folder: {error.strerror}.") from None


def _walk(folder: str, prefix: str = "", above: tuple[str, ...] = ()) -> Iterator[str]:
    """Yield the mesh files and archives below a folder; links are followed, except to a folder that contains them."""
    real = os.path.realpath(folder)
    if real in above:
        return
    try:
        items = sorted(os.scandir(folder), key=lambda item: item.name)
    except OSError:
        if not above:
            check_readable(Path(folder))
        yield prefix + ALL
        return
    for item in items:
        if _is_hidden(item.name):
            continue
        # os.path.isdir is False for a link to itself; item.is_dir needs no further system call
        if os.path.isdir(item.path) if item.is_symlink() else item.is_dir():
            yield from _walk(item.path, f"{prefix}{item.name}/", (*above, real))
        elif _is_mesh((item.name,)) or item.name.lower().endswith(ARCHIVE):
            yield prefix + item.name


def _is_mesh(parts: Sequence[str]) -> bool:
    return os.path.splitext(parts[-1])[1].lower() in SUFFIXES and not any(map(_is_hidden, parts))


def _is_hidden(name: str) -> bool:
    return name.startswith(".") or name == _UNPACKERS_RUBBISH
