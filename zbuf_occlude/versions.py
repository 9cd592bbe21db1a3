"""Versions of Python and of the packages that answers, data and times depend on; every manifest and row has them."""

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
