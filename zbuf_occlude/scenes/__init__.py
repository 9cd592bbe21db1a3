"""Scenes: meshes in their places, and what is put around a target: ground, street, room, or a file's."""

from zbuf_occlude.scenes.scene import Placed, Scene, moved

__all__ = ["Placed", "Scene", "moved"]
