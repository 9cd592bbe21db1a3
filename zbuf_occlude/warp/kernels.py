"""Kernels of lines of sight and rays, one source for CPU and CUDA: float32 boxes choose faces, float64 decides.

A Warp BVH holds the faces' boxes in scene units: the mesh's centre is 0 and its longest side 1. A line begins where it
enters a ball about the scene: there float32 errs by less than `WIDER` on every axis. The boxes are wider by that. Each
face whose box is met is then asked by the definition, in world units and in the order of `geometry.predicates`.
"""

import warp as wp

# a contracted product is not the negative of its mirror image: edges that two faces share would leak
wp.set_module_options({"enable_backward": False, "fuse_fp": False})

Vectors = wp.array(dtype=wp.vec3d)
Integers = wp.array(dtype=wp.int32)

BALL = wp.constant(wp.float64(0.867))
"""Radius about the scene's centre: half the diagonal of a cube, rounded up."""
WIDER = wp.constant(wp.float64(6e-7))
"""Scene units. A start lies within 1.23 of the centre, so a box is within 1.73 of it on each axis. The slab test takes
differences, reciprocals and products of rounded numbers: 2^-24 (4 x 1.73 + 1.23) = 4.9e-7. `STEEPEST` and the rounding
of the box add 6e-8. The oracle's own boxes are wider by 1e-6 at least."""
STEEPEST = wp.constant(wp.float64(1e-8))
"""Components of a direction count as at least this, so that none has an infinite reciprocal: 2.6e-8 at a ray's end."""
LATER = wp.constant(wp.float64(1e-6))
"""Scene units. A line is followed so much farther than it need be, for the rounding of distances to float32."""
FAR = wp.constant(wp.float64(1000.0))
"""Diagonals from the centre. Points beyond are held against every face: there the definition's own rounding, 1e-16
times the distance squared, outgrows `WIDER`. Callers let rays from beyond begin nearer."""
ZERO, HALF = wp.constant(wp.float64(0.0)), wp.constant(wp.float64(0.5))
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
def have_one_sign(u: wp.float64, v: wp.float64, w: wp.float64) -> wp.bool:
    """Whether none of three numbers has the other sign."""
    return (u >= ZERO and v >= ZERO and w >= ZERO) or (u <= ZERO and v <= ZERO and w <= ZERO)


@wp.func
def face_blocks(corners: Vectors, face: int, eye: wp.vec3d, point: wp.vec3d, contact: wp.float64) -> wp.bool:
    """Whether a face blocks a line of sight: `geometry.predicates.blocks`."""
    a, b, c = corners[3 * face], corners[3 * face + 1], corners[3 * face + 2]
    d, a_, b_, c_ = point - eye, a - point, b - point, c - point
    u, v, w = wp.dot(d, wp.cross(b_, c_)), wp.dot(d, wp.cross(c_, a_)), wp.dot(d, wp.cross(a_, b_))
    if not have_one_sign(u, v, w):
        return False
    n = wp.cross(b - a, c - a)
    slope = wp.dot(d, n)
    if slope == ZERO or u + v + w == ZERO:
        return False
    height = wp.dot(point - a, n)
    if slope < ZERO:
        height, slope = -height, -slope
    return height * wp.sqrt(wp.dot(d, d)) > contact * slope and height < slope


@wp.func
def face_meets(corners: Vectors, face: int, origin: wp.vec3d, direction: wp.vec3d) -> wp.float64:
    """Return how many times `direction` away a face meets a ray, infinity for none: `geometry.predicates.meeting`."""
    a, b, c = corners[3 * face], corners[3 * face + 1], corners[3 * face + 2]
    a_, b_, c_ = a - origin, b - origin, c - origin
    u = wp.dot(direction, wp.cross(b_, c_))
    v = wp.dot(direction, wp.cross(c_, a_))
    w = wp.dot(direction, wp.cross(a_, b_))
    n = wp.cross(b - a, c - a)
    slope = wp.dot(direction, n)
    if not have_one_sign(u, v, w) or slope == ZERO or u + v + w == ZERO:
        return wp.float64(wp.inf)
    fraction = wp.dot(a_, n) / slope
    return wp.where(fraction > ZERO, fraction, wp.float64(wp.inf))


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
    visible: wp.array2d(dtype=wp.bool),
) -> None:
    """Fill in which of n points each of k eyes sees; own: the points' own faces, -1 for none."""
    k, i = wp.tid()
    place = placement_in(bounds)
    eye, point = eyes[k], points[i]
    tau = contact * place.diagonal
    distance = wp.length(eye - point)
    unit = (eye - point) / wp.max(distance, TINY)
    seen, face = wp.bool(True), wp.int32(0)
    if wp.max(wp.abs(point - place.centre)) > FAR * place.diagonal:
        while seen and 3 * face < corners.shape[0]:
            seen = face == own[i] or not face_blocks(corners, face, eye, point, tau)
            face += 1
    else:
        limit = wp.float32(distance / place.side - skipped(place, point, unit) + LATER)
        query = _candidates(bvh, place, point, unit)
        while seen and wp.bvh_query_next(query, face, limit):
            seen = face == own[i] or not face_blocks(corners, face, eye, point, tau)
    visible[k, i] = seen


@wp.kernel
def fill_first_hits(
    bvh: wp.uint64,
    corners: Vectors,
    bounds: Vectors,
    origins: Vectors,
    directions: Vectors,
    face_ids: Integers,
    distances: wp.array(dtype=wp.float64),
) -> None:
    """Fill in the face that each of n rays meets first, -1 for none, and its eye distance.

    One origin serves all. None is farther than `FAR`; directions are of usual length (`arrays.SHORTEST`).
    """
    i = wp.tid()
    place = placement_in(bounds)
    origin = origins[wp.where(origins.shape[0] == 1, 0, i)]
    direction = directions[i]
    length = wp.length(direction)
    unit = direction / length
    before = skipped(place, origin, unit)
    nearest, first, face = wp.float64(wp.inf), wp.int32(-1), wp.int32(0)
    limit = wp.float32(wp.inf)
    query = _candidates(bvh, place, origin, unit)
    while wp.bvh_query_next(query, face, limit):
        found = face_meets(corners, face, origin, direction)
        if found < nearest or (found == nearest and face < first):
            nearest, first = found, face
            limit = wp.float32(nearest * length / place.side - before + LATER)
    face_ids[i] = first
    distances[i] = nearest * length
