"""Where numba keeps compiled functions: a folder that can be written, of these sources; a note of what is there."""

import atexit
import hashlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path


def ensure_writable() -> None:
    """Point NUMBA_CACHE_DIR at a new temporary folder when numba would find no folder to write into, and fail.

    That is so where an administrator installed the package and homes are read-only or missing. The folder is inherited
    by workers and removed when this process ends: functions are then compiled again in each run. (Not a fixed name
    below /tmp: whoever else may write there could have this process run what they left.)
    """
    if _place() is None:
        folder = tempfile.mkdtemp(prefix="zbuf_occlude-numba-")
        os.environ["NUMBA_CACHE_DIR"] = folder
        atexit.register(_remove, folder, os.getpid())


def forget_stale() -> None:
    """Remove what was compiled of other sources than these.

    numba compiles a function anew when its own file changed, not when the file of one that was compiled into it did:
    after an update it would answer as before.
    """
    place = _place()
    if place is None:
        return
    sources, here = _sources(), os.path.dirname(os.path.abspath(__file__))
    note = Path(place, f"zbuf_occlude-{hashlib.sha1(here.encode()).hexdigest()}.sources")
    with suppress(OSError):
        if note.exists() and note.read_text() == sources:
            return
        for folder in {os.path.dirname(os.path.abspath(source)) for source in _files()}:
            below = f"{os.path.basename(folder)}_{hashlib.sha1(folder.encode()).hexdigest()}"  # numba's name of it
            for kept in (Path(folder, "__pycache__"), Path(place, below)):
                for compiled in kept.glob("*.nb[ic]"):
                    compiled.unlink(missing_ok=True)
        note.parent.mkdir(parents=True, exist_ok=True)
        note.write_text(sources)


def is_compiled(job: str) -> bool:
    """Whether everything that a job needs was compiled here, of these sources, for this processor (`note_compiled`)."""
    note = _note(job)
    return note is not None and note.exists() and note.read_text() == _stamp()


def note_compiled(job: str) -> None:
    """Note that everything a job needs is compiled; without the note the next run looks again, no more."""
    note = _note(job)
    if note is not None:
        with suppress(OSError):
            note.parent.mkdir(parents=True, exist_ok=True)
            note.write_text(_stamp())


def _note(job: str) -> Path | None:
    from llvmlite.binding import get_host_cpu_name  # late, for the package is light to import

    place = _place()
    return None if place is None else Path(place, f"zbuf_occlude-{job}-{get_host_cpu_name()}.compiled")


def _stamp() -> str:
    """Change when numba or a source does."""
    return f"numba {version('numba')}, {_sources()}"


def _sources() -> str:
    """Change when a source does."""
    found = sorted((path, os.stat(path)) for path in _files())
    text = "".join(f"{path} {status.st_mtime_ns} {status.st_size}\n" for path, status in found)
    return f"sources {hashlib.sha1(text.encode(errors='surrogateescape')).hexdigest()}"


def _files() -> Iterator[str]:
    """The package's sources."""
    for folder, _, names in os.walk(os.path.dirname(os.path.abspath(__file__))):
        yield from (os.path.join(folder, name) for name in names if name.endswith(".py"))


def _place() -> str | None:
    """The first folder that numba will find it can write into."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    users = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    places = [given, os.path.join(os.path.dirname(__file__), "__pycache__"), os.path.join(users, "numba")]
    return next((place for place in places if place and _is_writable(place)), None)


def _is_writable(place: str) -> bool:
    """Whether a folder can be written, or made and then written."""
    path = Path(os.path.abspath(place))
    existing = next(one for one in (path, *path.parents) if one.exists())
    return existing.is_dir() and os.access(existing, os.W_OK | os.X_OK)


def _remove(folder: str, owner: int) -> None:
    if os.getpid() == owner:  # and not a forked child of it
        shutil.rmtree(folder, ignore_errors=True)
