"""Scenes: placed meshes, and the surroundings of a target: ground, street, room, or a file's objects.

Placed(mesh, "car", moved(to=(12, 0, 0)))     a mesh and its pose
Scene.joined([...])                           many, as one mesh, with the object of each face
KINDS                                         the kinds of scenes drawn from a seed
"""

from zbuf_occlude.sensors.scenes.kinds import KINDS
from zbuf_occlude.sensors.scenes.scene import Placed, Scene, moved

__all__ = ["KINDS", "Placed", "Scene", "moved"]


def __dir__() -> list[str]:
    return list(__all__)
