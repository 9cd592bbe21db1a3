"""Where numba keeps compiled functions: a folder that can be written, and a note of what was compiled there."""

import atexit
import os
import shutil
import tempfile
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
    sources = Path(__file__).parent.rglob("*.py")
    return f"numba {version('numba')}, sources of {max(source.stat().st_mtime_ns for source in sources)}"


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
