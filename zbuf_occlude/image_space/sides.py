"""Sides: which faces an eye sees from the one side of their surface, which from the other."""

import numpy as np
from numba import njit

from zbuf_occlude.image_space.backs import GRAZING
from zbuf_occlude.image_space.projection import FAR, ONE, ZERO
from zbuf_occlude.lanes import greater, load, muladd, splat


@njit(_nrt=False)
def find_sides(scene, surface, eye, front, back):  # type: ignore[no-untyped-def]
    """Tell the faces seen from their outer side from those seen from their inner one, for an eye outside.

    Parameters
    ----------
    scene, surface : Scene and Surface
    eye : tuple of 3 float32, scene space
    front, back : (m,) int64
        Receive masks of the clusters' faces; in neither are those seen at a `GRAZING` angle.
    """
    limit = GRAZING * (ONE + abs(eye[0]) + abs(eye[1]) + abs(eye[2]))
    for cluster in range(len(scene.used)):
        base = cluster * 64
        height = muladd(load(scene.planes, base + 32), splat(eye[2]), splat(ZERO) - load(scene.planes, base + 48))
        height = muladd(load(scene.planes, base + 16), splat(eye[1]), height)
        height = muladd(load(scene.planes, base), splat(eye[0]), height)
        before, behind = greater(height, splat(limit)), greater(splat(-limit), height)
        outer, inner = surface.outer[cluster], surface.inner[cluster]
        front[cluster] = (before & outer) | (behind & inner)
        back[cluster] = (behind & outer) | (before & inner)


@njit(_nrt=False)
def drop_turned(scene, surface, back, rectangles):  # type: ignore[no-untyped-def]
    """Empty the rectangles of clusters that are turned away from an eye outside, or buried; see `backs`."""
    for cluster in range(len(scene.used)):
        unneeded = (back[cluster] & surface.solid[cluster]) | surface.buried[cluster]
        if unneeded & scene.used[cluster] == scene.used[cluster]:
            rectangles[0, cluster], rectangles[1, cluster] = FAR, -FAR


@njit(_nrt=False, forceinline=True)
def has(masks, row):  # type: ignore[no-untyped-def]
    """Whether a row's bit is set in the clusters' masks: 0 or 1."""
    return (masks[row // 16] >> np.int64(row & 15)) & 1
