"""Triangles through trimesh, for what it reads as it is meant: ASCII STL that is not one record a line."""

import warnings
from io import BytesIO

import numpy as np

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.errors import MeshError
from zbuf_occlude.meshes.polygons import Ints
from zbuf_occlude.meshes.text import as_doubles


def read_triangles(data: bytes, file_type: str) -> tuple[FloatArray, Ints]:
    """Let trimesh read a file that has passed its format's guards; return vertices (v, 3) and triangles (f, 3).

    Everything that trimesh raises becomes a MeshError, and so do triangles of vertices that are missing.
    """
    import trimesh  # late, for its import takes half a second

    try:
        # vertices that are no numbers or overflow are judged later; NumPy need not warn of them
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # what older NumPy says of text that is no number
            scene = trimesh.load_scene(BytesIO(data), file_type=file_type, process=False)
            scene.graph.repair_rigid = None  # the file's transforms as they are
            for part in scene.geometry.values():
                # before they are joined, for then one part's missing vertex is another's first
                if len(part.faces) and not 0 <= part.faces.min() <= part.faces.max() < len(part.vertices):
                    n = len(part.vertices)
                    raise MeshError(
                        f"triangles must refer to the {n} vertices of their part by 0 to {n - 1}; "
                        f"one refers to {part.faces.max()}. Is the file damaged?"
                    )
            mesh = scene.to_mesh()
            return as_doubles(mesh.vertices), np.array(mesh.faces, dtype=np.int64)
    except (MeshError, MemoryError):
        raise
    except Exception as error:  # what a library does on damaged bytes is not ours to list
        said = " ".join(f"{type(error).__name__}: {error}".split())[:100]
        raise MeshError(f"it must be sound; trimesh cannot read it ({said}). Is it damaged?") from None
