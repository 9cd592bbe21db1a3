"""What answers, data and times depend on: versions of Python and packages, in every manifest and row; the cores."""

import os
import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version

PACKAGES = ("zbuf-occlude", "numpy", "numba", "moderngl", "trimesh", "h5py", "pyrender", "embreex", "open3d")


@cache
def versions() -> dict[str, str]:
    """Return them by name; of packages that are not installed none."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:  # an extra
            continue
    return found


def n_cores() -> int:
    """Return how many cores this process may use; where the system does not say, how many there are."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
