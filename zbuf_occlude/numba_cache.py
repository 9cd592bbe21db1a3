"""A folder for numba's compiled functions where neither the package's own nor the user's can be written."""

import atexit
import os
import shutil
import tempfile
from pathlib import Path


def ensure_writable() -> None:
    """Point NUMBA_CACHE_DIR at a new temporary folder when numba would find no folder to write into, and fail.

    That is so where an administrator installed the package and homes are read-only or missing. The folder is inherited
    by workers and removed when this process ends: functions are then compiled again in each run. (Not a fixed name
    below /tmp: whoever else may write there could have this process run what they left.)
    """
    given = os.environ.get("NUMBA_CACHE_DIR")
    users = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    places = [given, os.path.join(os.path.dirname(__file__), "__pycache__"), os.path.join(users, "numba")]
    if not any(_is_writable(place) for place in places if place):
        folder = tempfile.mkdtemp(prefix="zbuf_occlude-numba-")
        os.environ["NUMBA_CACHE_DIR"] = folder
        atexit.register(_remove, folder, os.getpid())


def _is_writable(place: str) -> bool:
    """Whether a folder can be written, or made and then written."""
    path = Path(os.path.abspath(place))
    existing = next(one for one in (path, *path.parents) if one.exists())
    return existing.is_dir() and os.access(existing, os.W_OK | os.X_OK)


def _remove(folder: str, owner: int) -> None:
    if os.getpid() == owner:  # and not a forked child of it
        shutil.rmtree(folder, ignore_errors=True)
