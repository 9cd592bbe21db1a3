"""Slots: the set-ups of the clusters that a thread met last, so that each is made once a frame where memory allows."""

from numba import njit

from zbuf_occlude.image_space.projection import set_up

SLOTS = 4096
"""Set-ups kept at a time, 900 bytes each; a power of two."""


@njit(_nrt=False, forceinline=True)
def slot_of(scene, cluster, frame, window, eye, reach, space, epoch):  # type: ignore[no-untyped-def]
    """Slot that holds a cluster's set-up for this frame, after setting it up if none does."""
    slot = cluster & (len(space.tags) - 1)
    tag = epoch * len(scene.used) + cluster
    if space.tags[slot] != tag:
        space.doubtful[slot] = set_up(
            scene, cluster, frame, window, eye, reach, space.slots, slot, space.slot_rectangles
        )
        space.tags[slot] = tag
    return slot
