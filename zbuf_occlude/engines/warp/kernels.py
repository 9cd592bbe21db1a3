"""Kernels for lines of sight and rays, one source for CPU and CUDA: float32 boxes select faces, float64 decides.

A Warp BVH holds the faces' boxes in scene units: the mesh's centre is 0 and its longest side 1. A line starts where it
enters a ball about the scene. From there float32 errs by less than `BOX_MARGIN` on every axis, by which the boxes are
enlarged. Each face whose box is met is then tested in float64, world units, with the error bounds of
`geometry.determinants`. Lines that these cannot decide are counted and marked.
"""

import warp as wp

# without fused operations CPU and CUDA give identical numbers
wp.set_module_options({"enable_backward": False, "fuse_fp": False})

Vectors = wp.array(dtype=wp.vec3d)
Integers = wp.array(dtype=wp.int32)

BALL = wp.constant(wp.float64(0.867))
"""Radius of the ball about the scene's centre: half the diagonal of a cube, rounded up."""
BOX_MARGIN = wp.constant(wp.float64(6e-7))
"""Margin of the boxes, scene units. A start lies within 1.23 of the centre, so a box is within 1.73 of it on each axis.
The slab test computes differences, reciprocals and products of rounded numbers: 2^-24 (4 x 1.73 + 1.23) = 4.9e-7.
`MIN_COMPONENT` and the rounding of the box add 6e-8."""
MIN_COMPONENT = wp.constant(wp.float64(1e-8))
"""Least size of a direction's components, so that no reciprocal is infinite; it moves a ray's end by 2.6e-8."""
LENGTH_MARGIN = wp.constant(wp.float64(1e-6))
"""Margin of a line's length, scene units, for the rounding of distances to float32."""
MAX_DISTANCE = wp.constant(wp.float64(1000.0))
"""Largest distance of points and origins from the centre, in diagonals: beyond it the entry into the ball is too
inaccurate, and lines are left in doubt."""
IN_DOUBT = wp.constant(wp.int32(2))
UNDECIDED = wp.constant(wp.int32(-2))
FILTER, UNDERFLOW = wp.constant(wp.float64(1e-15)), wp.constant(wp.float64(1e-150))
CLEAR = wp.constant(wp.float64(2.0**30))
UNSURE = wp.constant(wp.float64(1e-6))
"""Relative difference from the contact tolerance below which the meeting point is in doubt."""
ROUNDING = wp.constant(wp.float64(1e-15))
ZERO, HALF, ONE = wp.constant(wp.float64(0.0)), wp.constant(wp.float64(0.5)), wp.constant(wp.float64(1.0))
TINY = wp.constant(wp.float64(1e-200))
"""Least length, so that no division overflows."""


@wp.struct
class Placement:
    """Position and size of a mesh, world units."""

    centre: wp.vec3d
    side: wp.float64
    diagonal: wp.float64


@wp.func
def placement_in(bounds: Vectors) -> Placement:
    """Return the placement of a mesh from the corners of its bounding box."""
    extent = bounds[1] - bounds[0]
    placement = Placement()
    placement.centre = HALF * (bounds[0] + bounds[1])
    placement.side = wp.max(wp.max(extent), TINY)
    placement.diagonal = wp.length(extent)
    return placement


@wp.func
def skipped(placement: Placement, origin: wp.vec3d, unit: wp.vec3d) -> wp.float64:
    """Return the distance along a line at which it enters the ball, scene units; 0 if it starts inside."""
    return wp.max(-wp.dot(origin - placement.centre, unit) / placement.side - BALL, ZERO)


@wp.func
def single(a: wp.vec3d) -> wp.vec3:
    """Return a vector in float32."""
    return wp.vec3(wp.float32(a[0]), wp.float32(a[1]), wp.float32(a[2]))


@wp.func
def steep(u: wp.float64) -> wp.float64:
    """Return a component of a unit vector, with a size of at least `MIN_COMPONENT`."""
    return wp.where(u < ZERO, wp.min(u, -MIN_COMPONENT), wp.max(u, MIN_COMPONENT))


@wp.func
def _candidates(bvh: wp.uint64, placement: Placement, origin: wp.vec3d, unit: wp.vec3d):
    """Return the BVH query for the faces whose boxes a line meets."""
    start = (origin - placement.centre) / placement.side + skipped(placement, origin, unit) * unit
    return wp.bvh_query_ray(bvh, single(start), single(wp.vec3d(steep(unit[0]), steep(unit[1]), steep(unit[2]))))


@wp.func
def filtered_determinant(x: wp.vec3d, y: wp.vec3d, z: wp.vec3d) -> wp.vec2d:
    """Return the determinant x . (y x z) and a bound on its error: `geometry.determinants.filtered_determinant`."""
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
    """Return whether a value is accurate enough as a divisor."""
    return wp.abs(value[0]) > CLEAR * value[1]


@wp.func
def passes(origin: wp.vec3d, direction: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d) -> int:
    """Return whether a line passes through a closed face: 0, 1, or `IN_DOUBT`."""
    u = filtered_determinant(direction, b - origin, c - b)
    v = filtered_determinant(direction, c - origin, a - c)
    w = filtered_determinant(direction, a - origin, b - a)
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
    near, far = filtered_determinant(point - a, b - a, c - a), filtered_determinant(eye - a, b - a, c - a)
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
    """Return bounds of the distance at which a ray meets a face (`geometry.predicates.ray_triangle_t`).

    Returns
    -------
    vec3d
        Lower and upper bound in multiples of the direction, and 1 if the face is certainly met; infinity, infinity and
        0 if it is not met.
    """
    a, b, c = corners[3 * face], corners[3 * face + 1], corners[3 * face + 2]
    endless = wp.float64(wp.inf)
    side = passes(origin, direction, a, b, c)
    if side == 0:
        return wp.vec3d(endless, endless, ZERO)
    height, slope = filtered_determinant(a - origin, b - a, c - a), filtered_determinant(direction, b - a, c - a)
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
    placement = placement_in(bounds)
    a = (corners[3 * face] - placement.centre) / placement.side
    b = (corners[3 * face + 1] - placement.centre) / placement.side
    c = (corners[3 * face + 2] - placement.centre) / placement.side
    margin = wp.vec3d(BOX_MARGIN, BOX_MARGIN, BOX_MARGIN)
    lower[face] = single(wp.min(wp.min(a, b), c) - margin)
    upper[face] = single(wp.max(wp.max(a, b), c) + margin)


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
    """Fill in whether each of k eyes sees each of n points, 0, 1 or `IN_DOUBT`; own: the points' faces, -1 for none."""
    k, i = wp.tid()
    placement = placement_in(bounds)
    eye, point = eyes[k], points[i]
    tau = contact * placement.diagonal
    distance = wp.length(eye - point)
    unit = (eye - point) / wp.max(distance, TINY)
    answer, face, seen = wp.int32(1), wp.int32(0), wp.int32(1)
    if wp.max(wp.abs(point - placement.centre)) > MAX_DISTANCE * placement.diagonal:
        answer = IN_DOUBT
    else:
        limit = wp.float32(distance / placement.side - skipped(placement, point, unit) + LENGTH_MARGIN)
        query = _candidates(bvh, placement, point, unit)
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
    """Fill in the first face that each of n rays meets, -1 for none, `UNDECIDED` in doubt, and its distance.

    A single origin serves all rays. Directions have safe norms (`arrays.SHORTEST`); a zero direction meets nothing.
    """
    i = wp.tid()
    placement = placement_in(bounds)
    origin = origins[wp.where(origins.shape[0] == 1, 0, i)]
    direction = directions[i]
    length = wp.length(direction)
    unit = direction / length
    before = skipped(placement, origin, unit)
    # bounds of the distance of the nearest face so far, and the least distance of faces that may be nearer
    least, most, doubtful = wp.float64(wp.inf), wp.float64(wp.inf), wp.float64(wp.inf)
    first, face = wp.int32(-1), wp.int32(0)
    limit = wp.float32(wp.inf)
    if not (length > ZERO and length < doubtful):
        limit = wp.float32(ZERO)
    elif wp.max(wp.abs(origin - placement.centre)) > MAX_DISTANCE * placement.diagonal:
        doubtful = ZERO
    else:
        query = _candidates(bvh, placement, origin, unit)
        while wp.bvh_query_next(query, face, limit):
            found = face_meets(corners, face, origin, direction)
            if found[2] == ONE and found[1] < least:
                least, most, first = found[0], found[1], face
                limit = wp.float32(most * length / placement.side - before + LENGTH_MARGIN)
            elif found[0] <= most:
                doubtful = wp.min(doubtful, found[0])
    distances[i] = wp.where(first < 0, wp.float64(wp.inf), HALF * (least + most) * length)
    if doubtful <= most and doubtful < wp.float64(wp.inf):
        first = UNDECIDED
        wp.atomic_add(n_undecided, 0, 1)
    face_ids[i] = first
