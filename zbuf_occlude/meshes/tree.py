"""Tree: the mesh files of a folder, an archive or a single path, by name; and the small files next to them."""

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath

from zbuf_occlude.documents import MOST_BYTES
from zbuf_occlude.errors import MeshError, escape_control
from zbuf_occlude.meshes.load import SUFFIXES
from zbuf_occlude.meshes.mesh_files import ARCHIVE, archive_of, content_of, members, n_bytes_of

MOST = max(MOST_BYTES.values())
"""Bytes of a small file next to meshes."""
ALL = "*"
"""Stands for the meshes of a folder that cannot be read."""
_SYNSET = re.compile(r"\d{8}")
"""ShapeNetCore's archives are called so, one for each class."""
_UNPACKERS_RUBBISH = "__MACOSX"  # ModelNet's own archives contain it, full of files ._chair_0001.off


@dataclass(frozen=True)
class Tree:
    """The mesh files that a person gave by one path.

    The root is absolute, not resolved: the names that count are those that a person sees; an archive's is without its
    ending. Files are below it.
    """

    root: PurePosixPath
    base: Path  # what the files are read below: the folder, or the archive
    files: tuple[PurePosixPath, ...]
    single: bool = False  # a file was given and not a folder
    packed: Mapping[PurePosixPath, PurePosixPath] = field(default_factory=dict)  # where in an archive a folder's are

    def path_of(self, file: PurePosixPath) -> Path:
        """Return where one of the files, or another below root, is read."""
        for folder in file.parents if self.packed else ():
            if folder in self.packed:
                return self.base / self.packed[folder] / file.relative_to(folder)
        return self.base / file

    def read(self, path: PurePosixPath) -> bytes | None:
        """Return the content of a small file by its absolute name, None where there is none.

        Raises
        ------
        MeshError
            It is there, and cannot be read or is larger than documents may be.
        """
        inside = path.is_relative_to(self.root)
        place = self.path_of(path.relative_to(self.root)) if inside else Path(path)
        try:
            size = n_bytes_of(place)
            if size is None:
                return None
            if size > MOST:
                raise MeshError(f"it must have at most {MOST:,} bytes; it has {size:,}. Is it the file of that name?")
            return content_of(place)
        except MeshError as error:
            raise MeshError(f"{escape_control(str(path))}: {error}") from None

    def named(self, file: PurePosixPath) -> PurePosixPath:
        """Return the absolute name of one of the files."""
        return self.root / file

    def parts(self, file: PurePosixPath) -> tuple[str, ...]:
        """Return the parts of a file's absolute name: of as many files as there are, much cheaper than the name."""
        return (*self.root.parts, *file.parts)


def tree_at(path: Path) -> Tree:
    """Find the mesh files at a path; MeshError if it is missing, not readable, of another format, or has no mesh."""
    absolute = PurePosixPath(Path(os.path.abspath(path)))
    is_archive = path.suffix.lower() == ARCHIVE and path.is_file()
    if os.path.isdir(path):
        found = tuple(map(PurePosixPath, _walk(str(path))))
        zips = [file for file in found if file.suffix.lower() == ARCHIVE]
        files = tuple(file for file in found if file.suffix.lower() != ARCHIVE)
        tree = Tree(absolute, path, files)
        if files:  # of class folders some may still be packed; other archives beside meshes are none of them
            zips = [zip for zip in zips if _SYNSET.fullmatch(zip.stem)]
        tree = _with_archives(tree, [zip for zip in zips if not (path / zip.with_suffix("")).exists()])
        files = tree.files
    elif is_archive:
        files = tuple(sorted(name for name in members(path) if _is_mesh(name.parts)))
        tree = Tree(absolute.with_suffix(""), path, files)
        wrapper = tree.root.name  # as programs pack a folder
        if files and all(len(file.parts) > 1 and file.parts[0] == wrapper for file in files):
            tree = Tree(tree.root / wrapper, path / wrapper, tuple(PurePosixPath(*file.parts[1:]) for file in files))
    elif not os.path.exists(path) and archive_of(path) is None:
        raise MeshError(f"{escape_control(str(path))}: there is no such file or folder. Check the path.")
    elif path.suffix.lower() not in SUFFIXES:
        raise MeshError(
            f"{escape_control(str(path))}: a mesh file must end in one of {', '.join(SUFFIXES)}; this does not. "
            "Convert it."
        )
    else:
        return Tree(absolute.parent, path.parent, (PurePosixPath(path.name),), single=True)
    if not files:
        what = "an archive" if is_archive else "a folder"
        raise MeshError(
            f"{escape_control(str(path))}: {what} must have meshes in it ({', '.join(SUFFIXES)}); it has none."
        )
    return tree


def _with_archives(tree: Tree, zips: Sequence[PurePosixPath]) -> Tree:
    """Return a folder's tree with what archives in it hold, each as if it were unpacked there."""
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
    """Raise MeshError that says why a folder cannot be read."""
    try:
        os.scandir(folder).close()
    except OSError as error:
        raise MeshError(f"{folder}: a folder must be readable; it is not: {error.strerror}.") from None


def _walk(folder: str, prefix: str = "", above: tuple[str, ...] = ()) -> Iterator[str]:
    """Mesh files and archives below a folder; links are followed, but not back to a folder that they lie in."""
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
        # a link to itself is none; of what is no link the folder's own list says what it is
        if os.path.isdir(item.path) if item.is_symlink() else item.is_dir():
            yield from _walk(item.path, f"{prefix}{item.name}/", (*above, real))
        elif _is_mesh((item.name,)) or item.name.lower().endswith(ARCHIVE):
            yield prefix + item.name


def _is_mesh(parts: Sequence[str]) -> bool:
    return os.path.splitext(parts[-1])[1].lower() in SUFFIXES and not any(map(_is_hidden, parts))


def _is_hidden(name: str) -> bool:
    return name.startswith(".") or name == _UNPACKERS_RUBBISH
