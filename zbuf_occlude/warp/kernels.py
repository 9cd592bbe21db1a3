"""Kernels of lines of sight and rays, one source for CPU and CUDA: float32 boxes choose faces, float64 decides.

A Warp BVH holds the faces' boxes in scene units: the mesh's centre is 0 and its longest side 1. A line begins where it
enters a ball about the scene: there float32 errs by less than `WIDER` on every axis. The boxes are wider by that. Each
face whose box is met is then tested in float64, world units, with the error bounds of `geometry.determinants`. Lines
that these leave in doubt are counted and marked.
"""

import warp as wp

# the CPU's answers and CUDA's are then the same numbers
wp.set_module_options({"enable_backward": False, "fuse_fp": False})

Vectors = wp.array(dtype=wp.vec3d)
Integers = wp.array(dtype=wp.int32)

BALL = wp.constant(wp.float64(0.867))
"""Radius about the scene's centre: half the diagonal of a cube, rounded up."""
WIDER = wp.constant(wp.float64(6e-7))
"""Scene units. A start lies within 1.23 of the centre, so a box is within 1.73 of it on each axis. The slab test takes
differences, reciprocals and products of rounded numbers: 2^-24 (4 x 1.73 + 1.23) = 4.9e-7. `STEEPEST` and the rounding
of the box add 6e-8. """
STEEPEST = wp.constant(wp.float64(1e-8))
"""Components of a direction count as at least this, so that none has an infinite reciprocal: 2.6e-8 at a ray's end."""
LATER = wp.constant(wp.float64(1e-6))
"""Scene units. A line is followed so much farther than it need be, for the rounding of distances to float32."""
FAR = wp.constant(wp.float64(1000.0))
"""Diagonals from the centre. Points and rays' origins beyond are left in doubt: where their lines enter the ball is too
inexact."""
IN_DOUBT = wp.constant(wp.int32(2))
UNDECIDED = wp.constant(wp.int32(-2))
FILTER, UNDERFLOW = wp.constant(wp.float64(1e-15)), wp.constant(wp.float64(1e-150))
CLEAR = wp.constant(wp.float64(2.0**30))
UNSURE = wp.constant(wp.float64(1e-6))
"""Relative distance from the contact tolerance below which the meeting point is in doubt."""
ROUNDING = wp.constant(wp.float64(1e-15))
ZERO, HALF, ONE = wp.constant(wp.float64(0.0)), wp.constant(wp.float64(0.5)), wp.constant(wp.float64(1.0))
TINY = wp.constant(wp.float64(1e-200))
"""Lengths below it count as this, so that no division overflows."""


@wp.struct
class Placement:
    """Where a mesh is, world units."""

    centre: wp.vec3d
    side: wp.float64
    diagonal: wp.float64


@wp.func
def placement_in(bounds: Vectors) -> Placement:
    """Return where the mesh is whose box has these two corners."""
    extent = bounds[1] - bounds[0]
    place = Placement()
    place.centre = HALF * (bounds[0] + bounds[1])
    place.side = wp.max(wp.max(extent), TINY)
    place.diagonal = wp.length(extent)
    return place


@wp.func
def skipped(place: Placement, origin: wp.vec3d, unit: wp.vec3d) -> wp.float64:
    """Return how far along a line it enters the ball, scene units; 0 where it begins inside."""
    return wp.max(-wp.dot(origin - place.centre, unit) / place.side - BALL, ZERO)


@wp.func
def single(a: wp.vec3d) -> wp.vec3:
    """Return a vector in float32."""
    return wp.vec3(wp.float32(a[0]), wp.float32(a[1]), wp.float32(a[2]))


@wp.func
def steep(u: wp.float64) -> wp.float64:
    """Return a component of a unit vector, not nearer to 0 than `STEEPEST`."""
    return wp.where(u < ZERO, wp.min(u, -STEEPEST), wp.max(u, STEEPEST))


@wp.func
def _candidates(bvh: wp.uint64, place: Placement, origin: wp.vec3d, unit: wp.vec3d):
    """Return the query for the faces whose boxes a line meets."""
    start = (origin - place.centre) / place.side + skipped(place, origin, unit) * unit
    return wp.bvh_query_ray(bvh, single(start), single(wp.vec3d(steep(unit[0]), steep(unit[1]), steep(unit[2]))))


@wp.func
def filtered(x: wp.vec3d, y: wp.vec3d, z: wp.vec3d) -> wp.vec2d:
    """Return the determinant x . (y x z) and a bound on its error: `geometry.determinants.filtered`."""
    p, s = y[1] * z[2], y[2] * z[1]
    q, t = y[2] * z[0], y[0] * z[2]
    r, v = y[0] * z[1], y[1] * z[0]
    permanent = (
        wp.abs(x[0]) * (wp.abs(p) + wp.abs(s))
        + wp.abs(x[1]) * (wp.abs(q) + wp.abs(t))
        + wp.abs(x[2]) * (wp.abs(r) + wp.abs(v))
    )
    return wp.vec2d(x[0] * (p - s) + x[1] * (q - t) + x[2] * (r - v), FILTER * permanent + UNDERFLOW)


@wp.func
def is_clear(value: wp.vec2d) -> wp.bool:
    """Whether a value exceeds its error so far that it may be divided by."""
    return wp.abs(value[0]) > CLEAR * value[1]


@wp.func
def passes(origin: wp.vec3d, direction: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d) -> int:
    """Return whether a line passes through a closed face: 0, 1, or `IN_DOUBT`."""
    u = filtered(direction, b - origin, c - b)
    v = filtered(direction, c - origin, a - c)
    w = filtered(direction, a - origin, b - a)
    above = u[0] > u[1] or v[0] > v[1] or w[0] > w[1]
    below = u[0] < -u[1] or v[0] < -v[1] or w[0] < -w[1]
    if above and below:
        return 0
    if wp.abs(u[0]) > u[1] and wp.abs(v[0]) > v[1] and wp.abs(w[0]) > w[1]:
        return 1
    return IN_DOUBT


@wp.func
def face_blocks(corners: Vectors, face: int, eye: wp.vec3d, point: wp.vec3d, contact: wp.float64) -> int:
    """Return whether a face blocks a line of sight (`geometry.predicates.blocks`): 0, 1, or `IN_DOUBT`."""
    a, b, c = corners[3 * face], corners[3 * face + 1], corners[3 * face + 2]
    d = point - eye
    side = passes(point, d, a, b, c)
    if side == 0:
        return 0
    near, far = filtered(point - a, b - a, c - a), filtered(eye - a, b - a, c - a)
    if (near[0] > near[1] and far[0] > far[1]) or (near[0] < -near[1] and far[0] < -far[1]):
        return 0
    if not (is_clear(near) and is_clear(far)):
        return IN_DOUBT
    farther, nearest = wp.abs(near[0]) * wp.length(d), contact * (wp.abs(near[0]) + wp.abs(far[0]))
    if farther < nearest * (ONE - UNSURE):
        return 0
    if side == 1 and farther > nearest * (ONE + UNSURE):
        return 1
    return IN_DOUBT


@wp.func
def face_meets(corners: Vectors, face: int, origin: wp.vec3d, direction: wp.vec3d) -> wp.vec3d:
    """Return where a face meets a ray (`geometry.predicates.ray_triangle_t`), as multiples of its direction.

    Returns
    -------
    vec3d
        At least, at most, and 1 where the face is met for certain; infinity, infinity and 0 where it is not met.
    """
    a, b, c = corners[3 * face], corners[3 * face + 1], corners[3 * face + 2]
    endless = wp.float64(wp.inf)
    side = passes(origin, direction, a, b, c)
    if side == 0:
        return wp.vec3d(endless, endless, ZERO)
    height, slope = filtered(a - origin, b - a, c - a), filtered(direction, b - a, c - a)
    if not (is_clear(height) and is_clear(slope)):
        return wp.vec3d(ZERO, endless, ZERO)
    at = height[0] / slope[0]
    if at < ZERO:
        return wp.vec3d(endless, endless, ZERO)
    error = at * (height[1] / wp.abs(height[0]) + slope[1] / wp.abs(slope[0]) + ROUNDING)
    return wp.vec3d(at - error, at + error, wp.where(side == 1, ONE, ZERO))


@wp.kernel
def fill_boxes(
    corners: Vectors, bounds: Vectors, lower: wp.array(dtype=wp.vec3), upper: wp.array(dtype=wp.vec3)
) -> None:
    """Fill in the boxes of the faces, scene units."""
    face = wp.tid()
    place = placement_in(bounds)
    a = (corners[3 * face] - place.centre) / place.side
    b = (corners[3 * face + 1] - place.centre) / place.side
    c = (corners[3 * face + 2] - place.centre) / place.side
    wider = wp.vec3d(WIDER, WIDER, WIDER)
    lower[face] = single(wp.min(wp.min(a, b), c) - wider)
    upper[face] = single(wp.max(wp.max(a, b), c) + wider)


@wp.kernel
def fill_visible(
    bvh: wp.uint64,
    corners: Vectors,
    bounds: Vectors,
    contact: wp.float64,
    points: Vectors,
    own: Integers,
    eyes: Vectors,
    visible: wp.array2d(dtype=wp.uint8),
    n_undecided: Integers,
) -> None:
    """Fill in which of n points each of k eyes sees, 0, 1 or `IN_DOUBT`; own: the points' own faces, -1 for none."""
    k, i = wp.tid()
    place = placement_in(bounds)
    eye, point = eyes[k], points[i]
    tau = contact * place.diagonal
    distance = wp.length(eye - point)
    unit = (eye - point) / wp.max(distance, TINY)
    answer, face, seen = wp.int32(1), wp.int32(0), wp.int32(1)
    if wp.max(wp.abs(point - place.centre)) > FAR * place.diagonal:
        answer = IN_DOUBT
    else:
        limit = wp.float32(distance / place.side - skipped(place, point, unit) + LATER)
        query = _candidates(bvh, place, point, unit)
        while answer != 0 and wp.bvh_query_next(query, face, limit):
            if face != own[i]:
                seen = face_blocks(corners, face, eye, point, tau)
                if seen == 1:
                    answer = 0
                elif seen == IN_DOUBT:
                    answer = IN_DOUBT
    visible[k, i] = wp.uint8(answer)
    if answer == IN_DOUBT:
        wp.atomic_add(n_undecided, 0, 1)


@wp.kernel
def fill_first_hits(
    bvh: wp.uint64,
    corners: Vectors,
    bounds: Vectors,
    origins: Vectors,
    directions: Vectors,
    face_ids: Integers,
    distances: wp.array(dtype=wp.float64),
    n_undecided: Integers,
) -> None:
    """Fill in the face that each of n rays meets first, -1 for none, `UNDECIDED` in doubt, and its eye distance.

    One origin serves all. Directions are of usual length (`arrays.SHORTEST`); one without a length meets nothing.
    """
    i = wp.tid()
    place = placement_in(bounds)
    origin = origins[wp.where(origins.shape[0] == 1, 0, i)]
    direction = directions[i]
    length = wp.length(direction)
    unit = direction / length
    before = skipped(place, origin, unit)
    # of the nearest face so far, and of the nearest that may be nearer
    least, most, doubtful = wp.float64(wp.inf), wp.float64(wp.inf), wp.float64(wp.inf)
    first, face = wp.int32(-1), wp.int32(0)
    limit = wp.float32(wp.inf)
    if not (length > ZERO and length < doubtful):
        limit = wp.float32(ZERO)
    elif wp.max(wp.abs(origin - place.centre)) > FAR * place.diagonal:
        doubtful = ZERO
    else:
        query = _candidates(bvh, place, origin, unit)
        while wp.bvh_query_next(query, face, limit):
            found = face_meets(corners, face, origin, direction)
            if found[2] == ONE and found[1] < least:
                least, most, first = found[0], found[1], face
                limit = wp.float32(most * length / place.side - before + LATER)
            elif found[0] <= most:
                doubtful = wp.min(doubtful, found[0])
    distances[i] = wp.where(first < 0, wp.float64(wp.inf), HALF * (least + most) * length)
    if doubtful <= most and doubtful < wp.float64(wp.inf):
        first = UNDECIDED
        wp.atomic_add(n_undecided, 0, 1)
    face_ids[i] = first
