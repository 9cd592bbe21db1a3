"""Scenes: meshes in their places, and what is put around a target: ground, street, room, or a file's.

Placed(mesh, "car", moved(to=(12, 0, 0)))     a mesh in its place
Scene.joined([...])                           many, as one mesh; whose face is whose
KINDS                                         the table of scenes drawn from a seed
"""

from zbuf_occlude.scenes.kinds import KINDS
from zbuf_occlude.scenes.scene import Placed, Scene, moved

__all__ = ["KINDS", "Placed", "Scene", "moved"]


def __dir__() -> list[str]:
    return list(__all__)
