"""Where meshes come from: files, folders of files, and (in `shapes`) built-in families."""

from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry
from zbuf_occlude.meshes.load import load_mesh

__all__ = ["MeshCollection", "MeshEntry", "load_mesh"]
