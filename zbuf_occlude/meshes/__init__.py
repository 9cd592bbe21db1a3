"""Meshes from files, folders and archives."""

from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry
from zbuf_occlude.meshes.load import load_mesh

__all__ = ["MeshCollection", "MeshEntry", "load_mesh"]
