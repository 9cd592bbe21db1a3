"""The scene: faces in clusters, points in packets, as the search takes them."""

from zbuf_occlude.image_space.scene.packets import Packets, make_packets
from zbuf_occlude.image_space.scene.scene import Scene, make_scene

__all__ = ["Packets", "Scene", "make_packets", "make_scene"]
