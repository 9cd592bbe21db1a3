"""What needs no search of its own: points that turn their back, and points of regions that one search answers for."""

import numpy as np
from numba import njit

from zbuf_occlude.image_space.chunks import search_chunks
from zbuf_occlude.image_space.packet_search import write
from zbuf_occlude.image_space.packets import PACKET
from zbuf_occlude.image_space.projection import ONE, ZERO, project_packet
from zbuf_occlude.image_space.regions import (
    HIDDEN,
    MIXED,
    OPEN,
    PARTLY,
    TOUCHED,
    TURNED,
    VISIBLE,
    spread,
)
from zbuf_occlude.lanes import ALL, count_lanes, divide, first_lane, splat


@njit(_nrt=False)
def ask_regions(  # type: ignore[no-untyped-def]
    scene, points, n_regions, frame, window, eye, world_eye, space, regions, epoch, answer
):
    """Learn of each region whether an eye outside sees it, by searching for the first points of one of its faces."""
    n_asked = 0
    for region in range(n_regions):
        space.decided[points.first_packets[regions.asked[region]]] = ALL
    for region in range(n_regions):
        packet = points.first_packets[regions.asked[region]]
        if space.decided[packet] == ALL:
            space.left[n_asked] = packet
            n_asked += 1
        space.decided[packet] &= ~_points_of(points, packet, regions.asked[region])
    search_chunks(scene, points, n_asked, frame, window, eye, world_eye, ONE, False, space, epoch, answer)
    for region in range(n_regions):
        packet = points.first_packets[regions.asked[region]]
        asked = _points_of(points, packet, regions.asked[region])
        visible, hidden = False, False
        while asked:
            seen = answer[points.order[packet * PACKET + first_lane(asked)]]
            asked &= asked - 1
            visible |= seen
            hidden |= not seen
        regions.known[region] = MIXED if visible and hidden else (VISIBLE if visible else HIDDEN)


@njit(_nrt=False, forceinline=True)
def _points_of(points, packet, row):  # type: ignore[no-untyped-def]
    """Mask of a packet's points on a face."""
    found = np.int64(0)
    for run in range(points.run_starts[packet], points.run_starts[packet + 1]):
        if points.run_rows[run] == row:
            found |= np.int64(points.run_masks[run])
    return found


@njit(_nrt=False)
def find_states(scene, surface, n_regions, regions):  # type: ignore[no-untyped-def]
    """Say of each face in one byte what is known of its points: fills ``regions.states``."""
    states = regions.states
    for cluster in range(len(scene.used)):
        turned = regions.back[cluster] & surface.solid[cluster]
        for lane in range(16):
            states[16 * cluster + lane] = TURNED if (turned >> lane) & 1 else OPEN
    if n_regions:
        for row in range(len(states)):
            number = regions.numbers[row]
            if number >= 0:
                states[row] = regions.known[number]
            elif number <= TOUCHED:
                states[row] = PARTLY


@njit(_nrt=False)
def settle(surface, points, first, last, frame, space, regions, answer):  # type: ignore[no-untyped-def]
    """Decide what can be of the packets first to last; list the others.

    Parameters
    ----------
    surface, points : Surface and Packets
    first, last : int
    frame : (12,) float32
    space : Workspace
        Receives `decided` and `left`.
    regions : Regions
    answer : (n,) bool
        Receives False.

    Returns
    -------
    n_left, n_undecided : int
        How many packets are left, and how many points in them.
    """
    n_left, n_undecided = 0, 0
    for packet in range(first, last):
        there = min(points.n_points - packet * PACKET, PACKET)
        if there <= 0:
            break
        turned, hidden, visible, projected = np.int64(0), np.int64(0), np.int64(0), False
        x, y = splat(ZERO), splat(ZERO)
        for run in range(points.run_starts[packet], points.run_starts[packet + 1]):
            row, mask = points.run_rows[run], np.int64(points.run_masks[run])
            state = regions.states[row] if row >= 0 else OPEN
            if state == TURNED:
                turned |= mask
            elif state == HIDDEN:
                hidden |= mask
            elif state == VISIBLE:
                visible |= mask
            elif state == PARTLY:
                if not projected:
                    x, y, w = project_packet(points, packet * PACKET, frame)
                    inverse = divide(splat(ONE), w)
                    x, y, projected = x * inverse, y * inverse, True
                seen, unseen = spread(surface, regions, TOUCHED - regions.numbers[row], x, y, mask)
                visible |= seen
                hidden |= unseen
        turned &= points.backed[packet]
        if turned and points.beside[packet] >= 0:
            turned = _turned_beside(points, packet, turned, regions)
        hidden |= turned
        space.decided[packet] = hidden | visible
        if hidden:
            write(points, packet * PACKET, hidden, answer)
        undecided = ((1 << there) - 1) & ~(hidden | visible)
        if undecided:
            space.left[n_left] = packet
            n_left += 1
            n_undecided += count_lanes(undecided)
    return n_left, n_undecided


@njit(_nrt=False)
def leave_all(points, first, last, space):  # type: ignore[no-untyped-def]
    """List the packets first to last, of which nothing is decided; return what `settle` returns."""
    n_left = 0
    for packet in range(first, last):
        if packet * PACKET < points.n_points:
            space.left[n_left], space.decided[packet] = packet, 0
            n_left += 1
    return n_left, min(last * PACKET, points.n_points) - first * PACKET


@njit(_nrt=False)
def _turned_beside(points, packet, turned, regions):  # type: ignore[no-untyped-def]
    """Of a mask of points, those for which the face beside their own is turned away, too."""
    found, rest = 0, turned
    while rest:
        lane = first_lane(rest)
        rest &= rest - 1
        row = points.beside_rows[points.beside[packet] + lane]
        if row >= 0 and regions.states[row] == TURNED:
            found |= 1 << lane
    return found
