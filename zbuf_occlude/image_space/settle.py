"""What needs no search of its own: points in solids or turned away, and those that a region answers for."""

import numpy as np
from numba import njit

from zbuf_occlude.image_space.chunks import search_chunks
from zbuf_occlude.image_space.packets import PACKET, WORD
from zbuf_occlude.image_space.projection import ONE, project_packet
from zbuf_occlude.image_space.regions import (
    HIDDEN,
    MIXED,
    OPEN,
    PARTLY,
    TOUCHED,
    TURNED,
    VISIBLE,
    find_corners,
    spread,
)
from zbuf_occlude.lanes import ALL, count_lanes, divide, first_lane, splat

EVERY = np.int64(-1)
"""All bits of a word."""


@njit(_nrt=False)
def ask_regions(  # type: ignore[no-untyped-def]
    scene, points, n_regions, frame, window, eye, world_eye, space, regions, epoch, answer
):
    """Learn of each region whether an eye outside sees it, by searching for the first points of one of its faces."""
    n_asked = 0
    for region in range(n_regions):
        space.decided[_first_packet(points, regions.asked[region])] = ALL
    for region in range(n_regions):
        packet = _first_packet(points, regions.asked[region])
        if space.decided[packet] == ALL:
            space.left[n_asked] = packet
            n_asked += 1
        space.decided[packet] &= ~_first_points(points, regions.asked[region])
    search_chunks(scene, points, n_asked, frame, window, eye, world_eye, ONE, False, space, epoch, answer)
    for region in range(n_regions):
        packet, asked = _first_packet(points, regions.asked[region]), _first_points(points, regions.asked[region])
        visible, hidden = False, False
        while asked:
            seen = answer[points.order[packet * PACKET + first_lane(asked)]]
            asked &= asked - 1
            visible |= seen
            hidden |= not seen
        regions.known[region] = MIXED if visible and hidden else (VISIBLE if visible else HIDDEN)


@njit(_nrt=False, forceinline=True)
def _first_packet(points, row):  # type: ignore[no-untyped-def]
    """The first packet that has a point of a face."""
    return points.row_starts[row] // PACKET


@njit(_nrt=False, forceinline=True)
def _first_points(points, row):  # type: ignore[no-untyped-def]
    """Mask of this packet's points on the face."""
    first = points.row_starts[row] % PACKET
    last = min(first + points.row_starts[row + 1] - points.row_starts[row], PACKET)
    return (1 << last) - (1 << first)


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
            elif number <= TOUCHED and find_corners(surface, regions, TOUCHED - number):
                states[row] = PARTLY


@njit(_nrt=False)
def settle(points, first, last, frame, space, regions, answer):  # type: ignore[no-untyped-def]
    """Decide what can be of the packets first to last; list the others.

    Parameters
    ----------
    points : Packets
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
    begin, end = first * PACKET, min(last * PACKET, points.n_points)
    if begin >= end:
        return 0, 0
    n_words = -(-end // WORD)
    for word in range(begin // WORD, n_words):
        space.decided_words[word] = space.hidden_words[word] = points.buried[word]
    for i in range(_place(points.taken, points.own[begin]), _place(points.taken, points.own[end - 1] + 1)):
        row = points.taken[i]
        state = regions.states[row]
        if state == OPEN:
            continue
        first_point, last_point = max(points.row_starts[row], begin), min(points.row_starts[row + 1], end)
        if state == PARTLY:
            _spread_over(points, row, first_point, last_point, frame, space, regions)
        else:
            _mark(points, state, first_point, last_point, space, regions)
    n_left, n_undecided = 0, 0
    for word in range(begin // WORD, n_words):
        _write_word(points, word, space.hidden_words[word], answer)
        undecided = ~space.decided_words[word]
        if WORD * word + WORD > end:
            undecided &= (1 << (end - WORD * word)) - 1
        if undecided:
            n_undecided += count_lanes(undecided)
            for i in range(WORD // PACKET):
                if (undecided >> (PACKET * i)) & ALL:
                    space.left[n_left] = word * (WORD // PACKET) + i
                    n_left += 1
    return n_left, n_undecided


@njit(_nrt=False)
def _place(ascending, value):  # type: ignore[no-untyped-def]
    """How many numbers of an ascending array are less than a value."""
    low, high = 0, len(ascending)
    while low < high:
        middle = (low + high) // 2
        if ascending[middle] < value:
            low = middle + 1
        else:
            high = middle
    return low


@njit(_nrt=False, forceinline=True)
def _mark(points, state, first, last, space, regions):  # type: ignore[no-untyped-def]
    """Note what is known of the points first to last, all on a face of this state."""
    for word in range(first // WORD, -(-last // WORD)):
        mask = EVERY
        if word == first // WORD:
            mask <<= first % WORD
        if word == (last - 1) // WORD:
            mask &= ~((EVERY << 1) << ((last - 1) % WORD))
        if state == TURNED:
            mask &= points.backed[word]
            twofold = mask & points.twofold[word]
            if twofold:
                mask &= ~_facing_beside(points, word, twofold, regions)
        space.decided_words[word] |= mask
        if state != VISIBLE:
            space.hidden_words[word] |= mask


@njit(_nrt=False)
def _facing_beside(points, word, twofold, regions):  # type: ignore[no-untyped-def]
    """Of a word's points, those for which the face beside their own is not turned away."""
    found = 0
    while twofold:
        bit = first_lane(twofold)
        twofold &= twofold - 1
        row = points.beside_rows[word * WORD + bit]
        if row < 0 or regions.states[row] != TURNED:
            found |= 1 << bit
    return found


@njit(_nrt=False)
def _spread_over(points, row, first, last, frame, space, regions):  # type: ignore[no-untyped-def]
    """Spread what is known of a face's corners over its points, which are those from first to last."""
    for base in range(first, last, PACKET):
        start = min(base, len(points.own) - PACKET)
        x, y, w = project_packet(points, start, frame)
        inverse = divide(splat(ONE), w)
        meant = ((1 << min(last - base, PACKET)) - 1) << (base - start)
        seen, unseen = spread(regions, TOUCHED - regions.numbers[row], x * inverse, y * inverse, meant)
        _enter(space.decided_words, start, seen | unseen)
        _enter(space.hidden_words, start, unseen)


@njit(_nrt=False, forceinline=True)
def _enter(words, start, mask):  # type: ignore[no-untyped-def]
    """Set the bits of a mask of 16 from some point on."""
    words[start // WORD] |= mask << (start % WORD)
    if start % WORD > WORD - PACKET:
        words[start // WORD + 1] |= mask >> (WORD - start % WORD)


@njit(_nrt=False, forceinline=True)
def _write_word(points, word, hidden, answer):  # type: ignore[no-untyped-def]
    """Enter a word's hidden points into the caller's order."""
    if hidden == EVERY:
        for i in range(word * WORD, (word + 1) * WORD):
            answer[points.order[i]] = False
        return
    while hidden:
        answer[points.order[word * WORD + first_lane(hidden)]] = False
        hidden &= hidden - 1


@njit(_nrt=False)
def leave_all(points, first, last, space):  # type: ignore[no-untyped-def]
    """List the packets first to last, of which nothing is decided; return what `settle` returns."""
    n_left = 0
    for packet in range(first, last):
        if packet * PACKET < points.n_points:
            space.left[n_left], space.decided[packet] = packet, 0
            n_left += 1
    return n_left, min(last * PACKET, points.n_points) - first * PACKET
