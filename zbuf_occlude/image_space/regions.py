"""Regions: parts of the surface of which an eye sees either all or nothing, so that one search answers for each.

Let a point move over the surface. What hides it is some face before it, and whether a face g does changes only where
the point passes, as the eye sees it, an edge of g, or where its own place and g come within the contact tolerance.
Where two faces share that edge and continue each other in the image, the other goes on hiding it. So visibility changes
only behind *contours*: edges at which the surface ends, branches, or folds back as the eye sees it. A region is what
can be reached from a face through edges that are no contours, over faces that are

* clear (`solids.clear`): no other face comes within the tolerance but those of the fans around their corners. Of a
  fan that does not cross itself and has no contour, each face is seen beside the others, and hides nothing of them;
* touched in the image by no contour, unless that lies behind their plane;
* not seen at a grazing angle.

What is known of a region is known of the corners of its faces, and is spread from there over the faces that contours do
touch: to each point for which none passes between it and the corner. So it is over faces that others come close to,
where these (`solids.barriers`) do not. Where a fan folds at a contour, the one leaf hides the other but for a strip
along the fold, no wider than what keeps away from contours anyhow, since leaves of sharp folds (`solids.clear.SHARP`)
are not clear.

References
----------
Appel: The notion of quantitative invisibility and the machine rendering of solids. ACM 1967, doi:10.1145/800196.806007.
He counts what hides a point, and follows the count along edges; here faces are followed and only "none" matters.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from zbuf_occlude.arrays import IntArray
from zbuf_occlude.image_space.contours import PAD, TWICE, image_of, meet, touch
from zbuf_occlude.image_space.projection import ZERO
from zbuf_occlude.image_space.scene import Float32
from zbuf_occlude.image_space.sides import has
from zbuf_occlude.lanes import absolute, first_lane, greater, maximum, minimum, select, splat

NOWHERE, UNKNOWN, TOUCHED = -1, -2, -3
"""Numbers of a face that belongs to no region, of one not yet numbered, and of the first that contours touch."""

BLIND = -2
"""In place of a corner's region: a contour ends there, which is between it and everything."""

OPEN, VISIBLE, HIDDEN, MIXED, TURNED, PARTLY = 0, 1, 2, 3, 4, 5
"""What is known of a face: nothing; what is of its region (which ought not to be mixed); that it is turned away; what
can be spread over it."""

SMALL = 4
"""Regions of fewer faces are not worth a search of their own."""

MOST = 12
"""A face that more contours and barriers touch is left to the search."""

LONGER = np.float32(2.8)
"""A distance d before an eye outside is in the image at most this times d / w."""

MET = 128
"""A cluster about which more contours lie is left to the search."""


class Regions(NamedTuple):
    """A thread's workspace for m clusters, 200 bytes a face in all with `Contours`."""

    front: NDArray[np.int64]  # (m,) see `sides.find_sides`
    back: NDArray[np.int64]  # (m,)
    numbers: IntArray  # (16 m,) region of each row, or TOUCHED - i where contours touch it
    states: NDArray[np.int8]  # (16 m,) what is known of each row
    stack: IntArray  # (16 m,)
    known: IntArray  # (16 m,) of each region
    asked: IntArray  # (16 m,) of each region a row that has points
    vertices: IntArray  # (n vertices,) region of a face around each, NOWHERE where there is none, or BLIND
    rows: IntArray  # (8 m,) of the faces that contours touch; NOWHERE where these were too many
    images: Float32  # (8 m, 6) x and y of their corners
    segments: Float32  # (8 m, MOST, 5) x and y of both ends of contours and barriers, and how far these reach
    counts: IntArray  # (8 m,) how many
    corners: NDArray[np.int8]  # (8 m,) bits 0 to 2 for corners known to be seen, 3 to 5 for those known to be hidden
    met: IntArray  # (MET,) contours about the current cluster
    masks: IntArray  # (MET,) of the faces that they touch


@njit
def make_regions(n_clusters, n_vertices, following):  # type: ignore[no-untyped-def]
    """Allocate; only the sides and states where regions are not to be followed."""
    n, t = 16 * n_clusters if following else 0, 8 * n_clusters if following else 0
    return Regions(
        np.zeros(n_clusters, dtype=np.int64),
        np.zeros(n_clusters, dtype=np.int64),
        np.empty(n, dtype=np.int32),
        np.empty(16 * n_clusters, dtype=np.int8),
        np.empty(n, dtype=np.int32),
        np.empty(n, dtype=np.int32),
        np.empty(n, dtype=np.int32),
        np.empty(n_vertices if following else 0, dtype=np.int32),
        np.empty(t, dtype=np.int32),
        np.empty((t, 6), dtype=np.float32),
        np.empty((t, MOST, 5), dtype=np.float32),
        np.empty(t, dtype=np.int32),
        np.empty(t, dtype=np.int8),
        np.empty(MET, dtype=np.int32),
        np.empty(MET, dtype=np.int32),
    )


@njit(_nrt=False)
def find_regions(scene, surface, row_starts, rectangles, eye, frame, contours, regions):  # type: ignore[no-untyped-def]
    """Number the regions that an eye outside sees; return how many.

    Parameters
    ----------
    scene, surface : Scene and Surface
    row_starts : (16 m,) int32
        As in `Packets`.
    rectangles : (6, ...) float32
        Of the clusters, see `projection.project_boxes`.
    eye, frame, contours
        See `contours.touch`.
    regions : Regions
        Its sides must be found; the rest is filled in.
    """
    numbers, n_touched = regions.numbers, 0
    for cluster in range(len(scene.used)):
        front, back = regions.front[cluster], regions.back[cluster]
        facing = front | (back & ~surface.solid[cluster])
        eligible, fenced = facing & (surface.clear[cluster] | surface.fenced[cluster]), facing & surface.fenced[cluster]
        first = 16 * cluster
        for lane in range(16):
            numbers[first + lane] = UNKNOWN if (eligible >> lane) & 1 else NOWHERE
        if not eligible:
            continue
        rectangle = (rectangles[0, cluster], rectangles[1, cluster], rectangles[2, cluster], rectangles[3, cluster])
        n = meet(cluster, rectangle, contours, regions.met)
        if n < 0 or n_touched + 16 > len(regions.rows):
            numbers[first : first + 16] = NOWHERE
            continue
        if n:
            touch(scene, cluster, eligible, eye, frame, contours, regions.met, n, regions.masks)
        for j in range(n):
            found = np.int64(regions.masks[j])
            while found:
                row = first + first_lane(found)
                found &= found - 1
                contour = regions.met[j]
                x, y = contours.images[contour, 0], contours.images[contour, 1]
                n_touched = _note(
                    regions, row, n_touched, x, y, contours.images[contour, 2], contours.images[contour, 3], PAD
                )
        while fenced:
            row = first + first_lane(fenced)
            fenced &= fenced - 1
            for j in range(surface.barrier_starts[row], surface.barrier_starts[row + 1]):
                barrier = surface.barriers[j]
                px, py, pw = image_of(barrier[0], barrier[1], barrier[2], frame)
                qx, qy, qw = image_of(barrier[3], barrier[4], barrier[5], frame)
                pad = PAD + LONGER * barrier[6] / (min(pw, qw) - barrier[6])
                n_touched = _note(regions, row, n_touched, px, py, qx, qy, pad)
    regions.vertices[:] = NOWHERE
    n = 0
    for seed in range(len(numbers)):
        if numbers[seed] == UNKNOWN:
            worth, n_touched = _flood(surface, row_starts, seed, n, n_touched, regions)
            n += worth
    for i in range(contours.totals[0]):
        edge = contours.edges[i]
        regions.vertices[surface.edge_vertices[edge, 0]] = regions.vertices[surface.edge_vertices[edge, 1]] = BLIND
    for i in range(n_touched):
        row = max(regions.rows[i], 0)
        cluster, lane = row // 16, row & 15
        for j in range(3):
            corner = scene.corners[cluster, j]
            x, y, _ = image_of(corner[0, lane], corner[1, lane], corner[2, lane], frame)
            regions.images[i, 2 * j], regions.images[i, 2 * j + 1] = x, y
    for i in range(n_touched):
        _reach_corners(surface, regions, i)
    for i in range(n_touched - 1, -1, -1):
        _reach_corners(surface, regions, i)
    return n


@njit(_nrt=False, forceinline=True)
def _note(regions, row, n_touched, px, py, qx, qy, pad):  # type: ignore[no-untyped-def]
    """Note what touches a face; return how many faces are touched."""
    numbers = regions.numbers
    if numbers[row] == UNKNOWN:
        numbers[row] = TOUCHED - n_touched
        regions.rows[n_touched], regions.counts[n_touched] = row, 0
        n_touched += 1
    if numbers[row] <= TOUCHED:
        i = TOUCHED - numbers[row]
        n = regions.counts[i]
        if n == MOST:
            numbers[row], regions.rows[i] = NOWHERE, NOWHERE
        else:
            segment = regions.segments[i, n]
            segment[0], segment[1], segment[2], segment[3], segment[4] = px, py, qx, qy, pad
            regions.counts[i] = n + 1
    return n_touched


@njit(_nrt=False, forceinline=True)
def _flood(surface, row_starts, seed, number, n_touched, regions):  # type: ignore[no-untyped-def]
    """Give a face's region its number, if it is worth one (1, else 0); its faces count as touched, if not."""
    numbers, stack = regions.numbers, regions.stack
    numbers[seed], stack[0] = number, seed
    done, n, asked = 0, 1, -1
    while done < n:
        row = stack[done]
        done += 1
        if asked < 0 and row_starts[row + 1] > row_starts[row]:
            asked = row
        front = has(regions.front, row)
        for i in range(3):
            beside = surface.neighbours[row, i]
            if beside >= 0 and numbers[beside] == UNKNOWN and has(regions.front, beside) == front:
                numbers[beside] = number
                stack[n] = beside
                n += 1
    worth = n >= SMALL and asked >= 0
    if worth:
        regions.asked[number], regions.known[number] = asked, OPEN
    for i in range(n):
        row = stack[i]
        if worth:
            for j in range(3):
                regions.vertices[surface.vertices[row, j]] = number
        elif n_touched < len(regions.rows):
            numbers[row] = TOUCHED - n_touched
            regions.rows[n_touched], regions.counts[n_touched] = row, 0
            n_touched += 1
        else:
            numbers[row] = NOWHERE
    return np.int64(worth), n_touched


@njit(_nrt=False, forceinline=True)
def _reach_corners(surface, regions, touched):  # type: ignore[no-untyped-def]
    """Spread what is known of a touched face's corners to its other corners, as `spread` does to points."""
    row = regions.rows[touched]
    if row == NOWHERE:
        return
    unknown = np.int64(0)
    for other in range(3):
        unknown |= np.int64(regions.vertices[surface.vertices[row, other]] == NOWHERE) << other
    if not unknown:
        return
    images = regions.images[touched]
    x = select(1, splat(images[0]), select(2, splat(images[2]), splat(images[4])))
    y = select(1, splat(images[1]), select(2, splat(images[3]), splat(images[5])))
    for known in range(3):
        region = regions.vertices[surface.vertices[row, known]]
        if region >= 0 and unknown:
            free = _unobstructed(regions, touched, known, x, y, unknown)
            unknown &= ~free
            for other in range(3):
                if (free >> other) & 1:
                    regions.vertices[surface.vertices[row, other]] = region


@njit(_nrt=False, forceinline=True)
def find_corners(surface, regions, touched):  # type: ignore[no-untyped-def]
    """Look up which corners of a face that contours touch are known to be seen or hidden; return whether any."""
    corners, row = np.int64(0), regions.rows[touched]
    for i in range(3):
        region = regions.vertices[surface.vertices[row, i]]
        if region >= 0:
            known = regions.known[region]
            corners |= (np.int64(known == VISIBLE) << i) | (np.int64(known == HIDDEN) << (3 + i))
    regions.corners[touched] = corners
    return corners != 0


@njit(_nrt=False, forceinline=True)
def spread(regions, touched, x, y, mask):  # type: ignore[no-untyped-def]
    """Answer for points of a face that contours touch, where none is between them and a corner known to be seen or not.

    Parameters
    ----------
    regions : Regions
    touched : int
        Which of the faces in ``regions.rows``.
    x, y : vectors
        16 points in the image.
    mask : int
        Which of them are meant; they lie on the face.

    Returns
    -------
    visible, hidden : int
        Masks of those that are known now.
    """
    visible, hidden, corners = 0, 0, np.int64(regions.corners[touched])
    for i in range(3):
        seen, unseen, free = (corners >> i) & 1, (corners >> (3 + i)) & 1, mask & ~(visible | hidden)
        if free and (seen | unseen):
            free = _unobstructed(regions, touched, i, x, y, free)
            if seen:
                visible |= free
            else:
                hidden |= free
    return visible, hidden


@njit(_nrt=False, forceinline=True)
def _unobstructed(regions, touched, i, x, y, free):  # type: ignore[no-untyped-def]
    """Of a mask of 16 points in the image, those that nothing noted of a face lies between and its i-th corner."""
    vx, vy = regions.images[touched, 2 * i], regions.images[touched, 2 * i + 1]
    dx, dy = splat(vx) - x, splat(vy) - y
    length = absolute(dx) + absolute(dy)
    for j in range(regions.counts[touched]):
        segment = regions.segments[touched, j]
        px, py, qx, qy, pad = segment[0], segment[1], segment[2], segment[3], TWICE * segment[4]
        # point and corner to the same side of the line through it ...
        ex, ey = qx - px, qy - py
        far = abs(px - vx) + abs(py - vy) + abs(qx - vx) + abs(qy - vy)
        guard = pad * (abs(ex) + abs(ey) + far)
        at = splat(ex * (vy - py) - ey * (vx - px))
        height = splat(ex) * (y - splat(py)) - splat(ey) * (x - splat(px))
        apart = greater(minimum(at, height), splat(guard)) | greater(splat(-guard), maximum(at, height))
        if free & ~apart:
            # ... or both its ends to the same side of the line through them
            band = (length + splat(far)) * splat(pad)
            first = dx * (splat(py) - y) - dy * (splat(px) - x)
            second = dx * (splat(qy) - y) - dy * (splat(qx) - x)
            apart |= greater(minimum(first, second), band) | greater(splat(ZERO) - band, maximum(first, second))
            free &= apart
            if not free:
                break
    return free
