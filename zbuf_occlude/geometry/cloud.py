"""Cloud: base of the public point clouds, with conversion to arrays, files and other libraries' clouds."""

import os
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base import atomic, point_files
from zbuf_occlude.base.arrays import FloatArray, float32_fault
from zbuf_occlude.base.documents import as_new_path
from zbuf_occlude.base.errors import OptionError
from zbuf_occlude.base.extras import importing
from zbuf_occlude.geometry.colors import Bytes

SUFFIXES = (".ply", ".npz", ".pcd", ".npy", ".csv")
"""Suffixes of the files that `Cloud.save` writes."""


class Cloud:
    """Points (n, 3) with unit normals (n, 3) and, if known, colours (n, 3), uint8, sRGB."""

    points: FloatArray
    normals: FloatArray
    colors: Bytes | None

    def __len__(self) -> int:
        return len(self.points)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.array(self.points, dtype=dtype, copy=copy)

    def arrays(self) -> dict[str, Any]:
        """Return all arrays by name: those of a .npz file."""
        found = {"points": self.points, "normals": self.normals, "colors": self.colors}
        return {name: values for name, values in found.items() if values is not None}

    def table(self) -> NDArray[Any]:
        """Return a structured array with one row per point: the columns of the other files."""
        return point_files.columns_of(self.points, self.normals, self.colors)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the cloud to a file in the format of its suffix.

        Parameters
        ----------
        path : path-like
            ``.ply`` (binary) and ``.csv``: the columns of `table`. ``.npy``: `table` as a structured array. ``.npz``:
            `arrays`, by name. ``.pcd``: positions, normals and colours, float32.

        Raises
        ------
        OptionError
            Another suffix.
        OSError
            The file cannot be written.

        Warns
        -----
        UserWarning
            ``.pcd``: the cloud is too far from the origin for float32.
        """
        self._write(path, self.table())

    def _write(self, path: str | os.PathLike[str], table: NDArray[Any]) -> None:
        """Write the cloud as `save` does, with the columns of `table`."""
        path = as_new_path(path, "path")
        suffix = path.suffix.lower()
        if suffix not in SUFFIXES:
            raise OptionError(f"a cloud's file must end in {', '.join(SUFFIXES)}; got {path.name!r}.")
        if suffix == ".npz":
            atomic.write(path, lambda file: np.savez_compressed(file, **self.arrays()))
        elif suffix == ".pcd":
            if reason := float32_fault(self.points):
                warnings.warn(f"{path.name} has float32; its {reason}. .ply, .npy and .csv have float64.", stacklevel=3)
            point_files.write_pcd_columns(path, self.points, self.normals, self.colors)
        elif suffix == ".ply":
            point_files.write_table(path, table)
        elif suffix == ".npy":
            atomic.write(path, lambda file: np.save(file, table))
        else:
            point_files.write_csv(path, table)

    def to_open3d(self) -> Any:
        """Return an ``open3d.geometry.PointCloud`` with points, normals and colours.

        Raises
        ------
        UnavailableError
            Open3D is not installed, or cannot be imported.
        """
        with importing("open3d", f"{type(self).__name__}.to_open3d"):
            import open3d

            vectors, new = open3d.utility.Vector3dVector, open3d.geometry.PointCloud
        cloud = new(vectors(np.array(self.points)))
        cloud.normals = vectors(np.array(self.normals))
        if self.colors is not None:
            cloud.colors = vectors(self.colors / 255.0)
        return cloud

    def to_trimesh(self) -> Any:
        """Return a ``trimesh.PointCloud`` with points and colours; it has no normals."""
        import trimesh

        return trimesh.PointCloud(np.array(self.points), colors=self.colors)
