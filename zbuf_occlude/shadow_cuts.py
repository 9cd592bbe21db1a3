"""Triangles cut along the shadows that other faces throw on them, seen from an eye: exactly, by planes through the eye.

What a face hides of another lies within the cone of the eye and the part of it that is nearer. A cone's sides are
planes, so what is left of a triangle is a few convex polygons. Triangles before which many faces lie are quartered
first. The faces before a triangle come from the boxes of `exact`.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.exact.bvh import Bvh, build_bvh, corners_of
from zbuf_occlude.exact.layout import LEAF, UPPER, ZERO
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.jit.compiler import device_function, njit
from zbuf_occlude.jit.simd import (
    dot3,
    first_lane,
    load,
    load3,
    load_scalar,
    load_scalar3,
    maximum,
    muladd,
    not_less,
    splat,
    splat3,
)
from zbuf_occlude.jit.threads import n_threads
from zbuf_occlude.jit.vec3 import cross, dot, minus

BLOCK = 512
"""Triangles that a thread cuts at a time."""
MOST = 1024
"""Faces before a triangle: with more it is quartered."""
SHORTEST = 1 / 128
"""Radii of the mesh's bounding sphere: triangles that are shorter are never quartered."""
ROUND = 8
"""Corners of a polygon: with more it is halved."""
ROOM = ROUND + 5
"""Corners of a polygon that the four sides of a cone have cut."""
EDGE_ON = 1e-12
"""Sine of the angle between line of sight and face: below, the face is seen edge-on, and has no side to see."""
CERTAIN = 1e-9
"""Likewise, and height of a face over its longest edge: below, rounding may decide what is seen of the face."""
TOUCHING = 1e-12
"""Radii of the mesh's bounding sphere: what is nearer to a face's plane lies in it."""
DEEP = 300.0
"""Contact tolerances: a face that comes so far before another is cut off where it meets that, a shallower one where
the tolerance begins. So a silhouette does not leave strips as narrow as the tolerance on the faces behind it."""
FLAT = 1e-3
"""Contact tolerances: an eye so near to a face's plane lies in it."""
SLIVER = 1e-11
"""Share of a triangle: smaller polygons are dropped."""

WALLS = 5
"""Of what hides a triangle: through the eye and its three sides, in its plane, and parallel to that through the eye."""
MARGIN = np.float32(4e-6)
"""Radii of the mesh's bounding sphere: what is so near to a wall is not left out; float32 errs by a tenth of it."""

COVERED, TOO_MANY = -1, -2
NOTHING, SOME, ALL = 0, 1, 2


def cut_by_shadows(mesh: Mesh, eyes: FloatArray, contact: float) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return what one of the eyes (k, 3) sees at least: triangles (n, 3, 3), of which face each is, their areas (n,).

    Exact but for rounding: cuts lie where the shadows' edges do. Of a face seen edge-on nothing is seen. `contact` is
    the contact tolerance, world units.
    """
    return _cut_faces(mesh, build_bvh(mesh, contact), eyes)


def seen_shares(mesh: Mesh, eyes: FloatArray, contact: float) -> FloatArray:
    """Return the share of each face's area that each eye (k, 3) sees, (k, f), exact but for rounding.

    NaN for a face that is not `CERTAIN`, and for all faces where the eye lies on one.
    """
    bvh, shares = build_bvh(mesh, contact), np.empty((len(eyes), len(mesh.faces)))
    for eye, share in zip(eyes, shares, strict=True):
        _, face_ids, areas = _cut_faces(mesh, bvh, eye[None])
        seen = np.bincount(face_ids, areas, minlength=len(mesh.faces))
        share[:] = np.where(_has_a_side(mesh, eye, contact), seen / np.where(mesh.areas > 0, mesh.areas, 1), np.nan)
    return shares


def _has_a_side(mesh: Mesh, eye: FloatArray, contact: float) -> BoolArray:
    """Which faces (f,) an eye surely sees from one side; none where it lies on a face: in its plane, and in its box."""
    corners, sizes = mesh.corners - eye, 2.0 * mesh.areas
    reach = np.linalg.norm(corners[:, 0], axis=1)
    heights = np.abs(np.einsum("fi,fi->f", mesh.face_normals, corners[:, 0]))
    within = (corners.min(axis=1) <= contact) & (corners.max(axis=1) >= -contact)
    lies_on = (heights <= FLAT * contact * sizes) & within.all(axis=1)
    return (heights > CERTAIN * sizes * reach) & (sizes > CERTAIN * _longest_edges(corners) ** 2) & ~lies_on.any()


def _cut_faces(mesh: Mesh, bvh: Bvh, eyes: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
    face_ids = np.arange(len(mesh.faces) if len(eyes) else 0, dtype=np.int32)
    corners = mesh.corners[face_ids]
    parts, of_face = [np.empty((0, 3, 3))], [np.empty(0, dtype=np.int32)]
    with ThreadPoolExecutor(n_threads()) as pool:
        while len(corners):
            may_quarter = _longest_edges(corners) * bvh.scale > SHORTEST
            blocks = [slice(first, first + BLOCK) for first in range(0, len(corners), BLOCK)]
            cut = [pool.submit(_cut, bvh, eyes, corners[i], face_ids[i], may_quarter[i]) for i in blocks]
            rest = np.zeros(len(corners), dtype=bool)
            for block, each in zip(blocks, cut, strict=True):
                seen, rows, rest[block] = each.result()
                parts.append(seen)
                of_face.append(face_ids[block][rows])
            corners, face_ids = _quartered(corners[rest]), np.repeat(face_ids[rest], 4)
    found = np.concatenate(parts)
    areas = 0.5 * np.linalg.norm(np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0]), axis=1)
    return found, np.concatenate(of_face), areas


def _longest_edges(corners: FloatArray) -> FloatArray:
    """Length of the longest edge of each triangle (n, 3, 3), (n,)."""
    return np.asarray(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1))


def _quartered(corners: FloatArray) -> FloatArray:
    """Four triangles for each one, (4 n, 3, 3), wound alike; neighbours get the same midpoints."""
    a, b, c = np.moveaxis(corners, 1, 0)
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.stack([np.stack(part, axis=1) for part in parts], axis=1).reshape(-1, 3, 3)


@njit(cache=True, nogil=True, _nrt=True)
def _cut(bvh, eyes, corners, own, may_quarter):
    """Return the seen parts of triangles, of which each is, and which are to be quartered first.

    Polygons wait on a stack, each for an eye's cones from one on. What a cone takes away waits for the next eye.
    """
    is_quartered = np.zeros(len(corners), np.bool_)
    parts, rows, n_parts = np.empty((1024, 3, 3)), np.empty(1024, np.int32), 0
    cones, n_sides, shadows = np.empty((1024, 4, 4)), np.empty(1024, np.int64), np.empty((1024, 4))
    firsts, lasts = np.empty(len(eyes), np.int64), np.empty(len(eyes), np.int64)
    polygons, states = np.empty((64, ROOM, 3)), np.empty((64, 3), np.int64)  # how many corners, eye, cone
    polygon, inside, outside = np.empty((ROOM, 3)), np.empty((ROOM, 3)), np.empty((ROOM, 3))
    stack, walls = np.empty((LEAF - 1) * bvh.depth + LEAF, np.int32), np.empty(WALLS * 4, np.float32)
    for row in range(len(corners)):
        n_before, n_cones, n_asked, n_waiting = n_parts, 0, 0, 1
        size = _area(corners[row], 3)
        _copy(corners[row], 0, 3, polygons[0], 0)
        states[0, 0], states[0, 1], states[0, 2] = 3, 0, 0
        axes = _axes(corners[row])
        while n_waiting > 0:
            if n_waiting + 6 > len(polygons):
                polygons = np.concatenate((polygons, np.empty_like(polygons)))
                states = np.concatenate((states, np.empty_like(states)))
            n_waiting -= 1
            n, eye, i = states[n_waiting, 0], states[n_waiting, 1], states[n_waiting, 2]
            _copy(polygons[n_waiting], 0, n, polygon, 0)
            if eye == n_asked:  # the first polygon that waits for this eye
                most = MOST if may_quarter[row] else len(bvh.faces)
                found = cones, n_sides, shadows
                (cones, n_sides, shadows), n_found = _cones_before(
                    bvh, eyes[eye], corners[row], own[row], most, found, n_cones, stack, walls, inside, axes
                )
                if n_found == TOO_MANY:
                    is_quartered[row], n_parts = True, n_before
                    break
                firsts[eye], lasts[eye] = n_cones, n_cones + n_found
                n_cones += max(n_found, 0)
                n_asked += 1
            if lasts[eye] < firsts[eye]:
                n_waiting = _wait(polygon, n, eye + 1, 0, len(eyes), polygons, states, n_waiting)
                continue
            if n > ROUND:
                half = n // 2
                _copy(polygon, 0, 1, inside, 0)
                _copy(polygon, half, n, inside, 1)
                n_waiting = _wait(inside, n - half + 1, eye, i, len(eyes), polygons, states, n_waiting)
                n = half + 1
            i += firsts[eye]
            box = _box_of(polygon, n, corners[row, 0], axes)
            while i < lasts[eye] and (
                _are_apart(box, shadows[i]) or _is_apart(polygon, n, corners[row, 0], cones[i], n_sides[i])
            ):
                i += 1
            if i == lasts[eye]:
                if n_parts + ROOM > len(parts):
                    parts = np.concatenate((parts, np.empty_like(parts)))
                    rows = np.concatenate((rows, np.empty_like(rows)))
                n_parts = _put(polygon, n, SLIVER * size, row, parts, rows, n_parts)
                continue
            for side in range(n_sides[i]):
                n, n_outside = _split(polygon, n, corners[row, 0], cones[i, side], inside, outside)
                _copy(inside, 0, n, polygon, 0)
                if _area(outside, n_outside) > SLIVER * size:
                    following = i + 1 - firsts[eye]
                    n_waiting = _wait(outside, n_outside, eye, following, len(eyes), polygons, states, n_waiting)
            if _area(polygon, n) > SLIVER * size:
                n_waiting = _wait(polygon, n, eye + 1, 0, len(eyes), polygons, states, n_waiting)
    return parts[:n_parts], rows[:n_parts], is_quartered


@device_function
def _wait(polygon, n, eye, cone, n_eyes, polygons, states, n_waiting):
    """Put a polygon on the stack, if there is such an eye; return how many wait there."""
    if eye == n_eyes:
        return n_waiting
    _copy(polygon, 0, n, polygons[n_waiting], 0)
    states[n_waiting, 0], states[n_waiting, 1], states[n_waiting, 2] = n, eye, cone
    return n_waiting + 1


@njit(_nrt=True)
def _cones_before(bvh, eye, corners, own, most, found, n_cones, stack, walls, part, axes):
    """Append the cones of the faces before a triangle; return these arrays, and how many, or `COVERED` or `TOO_MANY`.

    `walls` become those of what lies before the triangle, as far as the eye.
    """
    cones, n_sides, shadows = found
    # all places count from the triangle's first corner: from a far eye on, they would lose their last digits
    origin = corners[0]
    a, b, c, eye = (0.0, 0.0, 0.0), minus(corners[1], origin), minus(corners[2], origin), minus(eye, origin)
    normal, reach = cross(b, c), np.sqrt(dot(eye, eye))
    size = np.sqrt(dot(normal, normal))
    if abs(dot(normal, eye)) <= EDGE_ON * size * reach:
        return (cones, n_sides, shadows), COVERED
    sign = 1.0 if dot(normal, eye) > 0.0 else -1.0
    normal = sign * normal[0], sign * normal[1], sign * normal[2]
    height = dot(normal, eye)
    touching = TOUCHING * size / bvh.scale
    near = max(height * bvh.world_contact / reach, touching)
    for i, (first, second) in enumerate(((a, b), (b, c), (c, a))):
        side = cross(minus(second, first), minus(first, eye))
        _put_wall(bvh, origin, (sign * side[0], sign * side[1], sign * side[2]), -sign * dot(side, first), walls, i)
    _put_wall(bvh, origin, normal, 0.0, walls, 3)
    _put_wall(bvh, origin, (-normal[0], -normal[1], -normal[2]), height, walls, 4)
    stack[0], n_stack, n_found = 0, 1, 0
    while n_stack > 0:
        n_stack -= 1
        node = stack[n_stack]
        children = _children_within(bvh, node, walls)
        while children:
            below = bvh.children[LEAF * node + first_lane(children)]
            children &= children - 1
            if below >= 0:
                stack[n_stack] = below
                n_stack += 1
                continue
            lanes = _faces_within(bvh, ~below, walls)
            while lanes:
                face = bvh.face_ids[~below, first_lane(lanes)]
                lanes &= lanes - 1
                if face == own:
                    continue
                p, q, r = corners_of(bvh, face)
                p, q, r = minus(p, origin), minus(q, origin), minus(r, origin)
                heights = dot(normal, p), dot(normal, q), dot(normal, r)
                highest = max(heights[0], heights[1], heights[2])
                if highest <= near:
                    continue
                if n_found == most:
                    return (cones, n_sides, shadows), TOO_MANY
                if n_cones + n_found == len(cones):
                    cones = np.concatenate((cones, np.empty_like(cones)))
                    n_sides = np.concatenate((n_sides, np.empty_like(n_sides)))
                    shadows = np.concatenate((shadows, np.empty_like(shadows)))
                at, end = n_cones + n_found, 0.0 if highest > DEEP * near else near
                n_sides[at], hidden = _cone(p, q, r, b, c, eye, heights, end, touching, part, cones[at])
                if hidden == ALL:
                    return (cones, n_sides, shadows), COVERED
                if hidden == SOME:
                    _cast_shadow(part, n_sides[at], eye, normal, height, axes, shadows[at])
                    n_found += 1
    return (cones, n_sides, shadows), n_found


@device_function
def _put_wall(bvh, origin, normal, constant, walls, i):
    """Write a plane, whose constant is about an origin, in scene space and float32, its normal of length 1 or 0."""
    length = np.sqrt(dot(normal, normal))
    inverse = 1.0 / length if length > 0.0 else 0.0
    for axis in range(3):
        walls[4 * i + axis] = normal[axis] * inverse
    away = (dot(normal, minus(bvh.centre, origin)) + constant) * inverse * bvh.scale
    walls[4 * i + 3] = min(max(away, -4.0), 4.0)  # the scene is within 1 of its centre


@device_function
def _children_within(bvh, node, walls):
    """Mask of a node's children that do not lie wholly behind a wall, by more than the error of float32."""
    mask = (np.int64(1) << bvh.n_children[node]) - 1
    for i in range(WALLS):
        highest = splat(load_scalar(walls, 4 * i + 3))
        for axis in range(3):
            across = load_scalar(walls, 4 * i + axis)
            wall = load(bvh.boxes, LEAF * (6 * node + axis + (UPPER if across > ZERO else 0)))
            highest = muladd(wall, splat(across), highest)
        mask &= not_less(highest, splat(-MARGIN))
    return mask


@device_function
def _faces_within(bvh, leaf, walls):
    """Mask of a leaf's faces likewise."""
    mask = bvh.used[leaf]
    for i in range(WALLS):
        across, away = splat3(load_scalar3(walls, 4 * i, 1)), splat(load_scalar(walls, 4 * i + 3))
        highest = dot3(load3(bvh.corners, 9 * LEAF * leaf, LEAF), across, away)
        for corner in range(1, 3):
            highest = maximum(highest, dot3(load3(bvh.corners, (9 * leaf + 3 * corner) * LEAF, LEAF), across, away))
        mask &= not_less(highest, splat(-MARGIN))
    return mask


@device_function
def _copy(polygon, first, last, target, at):
    """Copy corners from one to another to a place of a polygon."""
    for i in range(first, last):
        for axis in range(3):
            target[at + i - first, axis] = polygon[i, axis]


@device_function
def _through(eye, first, second, sign, plane):
    """Write the plane through the eye and two places: its normal, and the constant that is added."""
    normal = cross(minus(first, eye), minus(second, first))
    for axis in range(3):
        plane[axis] = sign * normal[axis]
    plane[3] = -sign * dot(normal, first)


@device_function
def _side(plane, place):
    """On which side of a plane a place lies, and how far, in lengths of the plane's normal."""
    return dot(plane, place) + plane[3]


@device_function
def _cone(p, q, r, b, c, eye, heights, end, touching, part, cone):
    """Write the planes through the eye and the sides of what of a face pqr is nearer than `end`.

    Return how many, and how much they may hide of the triangle 0, b, c. A corner that touches the end stays: a cut
    right beside it would have no direction.
    """
    volume = dot(cross(minus(q, p), minus(r, p)), minus(p, eye))
    corners, n, sign = (p, q, r), 0, (1.0 if volume > 0.0 else -1.0)
    for i in range(3):
        first, second = corners[i], corners[(i + 1) % 3]
        one, two = heights[i] - end, heights[(i + 1) % 3] - end
        if one >= -touching:
            part[n, 0], part[n, 1], part[n, 2] = first
            n += 1
        if (one < -touching and two > touching) or (two < -touching and one > touching):
            share = one / (one - two)
            for axis in range(3):
                part[n, axis] = first[axis] + share * (second[axis] - first[axis])
            n += 1
    hidden = ALL if n > 2 else NOTHING
    for i in range(n):
        _through(eye, part[i], part[(i + 1) % n], sign, cone[i])
        one, two, three = cone[i, 3], _side(cone[i], b), _side(cone[i], c)
        if max(one, two, three) <= 0.0:
            return n, NOTHING
        if min(one, two, three) < 0.0:
            hidden = min(hidden, SOME)
    return n, hidden


@device_function
def _axes(corners):
    """Two axes of a triangle's plane, of length 1 or 0."""
    b, c = minus(corners[1], corners[0]), minus(corners[2], corners[0])
    across = cross(cross(b, c), b)
    return _unit(b), _unit(across)


@device_function
def _unit(vector):
    length = np.sqrt(dot(vector, vector))
    inverse = 1.0 / length if length > 0.0 else 0.0
    return vector[0] * inverse, vector[1] * inverse, vector[2] * inverse


@device_function
def _cast_shadow(part, n, eye, normal, height, axes, shadow):
    """Write the bounds of the shadow of a part, along two axes of the plane that it falls on; widened, or endless."""
    shadow[0] = shadow[2] = np.inf
    shadow[1] = shadow[3] = -np.inf
    for i in range(n):
        above = dot(normal, part[i])
        if above > 0.999 * height:
            shadow[0] = shadow[2] = -np.inf
            shadow[1] = shadow[3] = np.inf
            return
        share = above / (height - above)
        x, y, z = part[i, 0] - eye[0], part[i, 1] - eye[1], part[i, 2] - eye[2]
        place = part[i, 0] + share * x, part[i, 1] + share * y, part[i, 2] + share * z
        for j, axis in enumerate(axes):
            at = dot(axis, place)
            slack = 1e-9 * (abs(place[0]) + abs(place[1]) + abs(place[2]))
            shadow[2 * j] = min(shadow[2 * j], at - slack)
            shadow[2 * j + 1] = max(shadow[2 * j + 1], at + slack)


@device_function
def _box_of(polygon, n, origin, axes):
    """Bounds of a polygon along two axes."""
    low, high, left, right = np.inf, -np.inf, np.inf, -np.inf
    for i in range(n):
        place = minus(polygon[i], origin)
        u, v = dot(axes[0], place), dot(axes[1], place)
        low, high, left, right = min(low, u), max(high, u), min(left, v), max(right, v)
    return low, high, left, right


@device_function
def _are_apart(box, other):
    return (box[0] > other[1]) | (box[1] < other[0]) | (box[2] > other[3]) | (box[3] < other[2])


@device_function
def _is_apart(polygon, n, origin, cone, n_sides):
    """Whether a polygon lies outside one of a cone's sides."""
    if n_sides < 3:
        return True
    for side in range(n_sides):
        highest = -np.inf
        for i in range(n):
            highest = max(highest, _side(cone[side], minus(polygon[i], origin)))
        if highest <= 0.0:
            return True
    return False


@device_function
def _split(polygon, n, origin, plane, inside, outside):
    """Split a convex polygon by a plane; return how many corners each part has."""
    n_inside = n_outside = 0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        one, two = _side(plane, minus(polygon[i], origin)), _side(plane, minus(polygon[j], origin))
        if one >= 0.0:
            _copy(polygon, i, i + 1, inside, n_inside)
            n_inside += 1
        if one <= 0.0:
            _copy(polygon, i, i + 1, outside, n_outside)
            n_outside += 1
        if (one < 0.0 < two) or (two < 0.0 < one):
            share = one / (one - two)
            for axis in range(3):
                place = polygon[i, axis] + share * (polygon[j, axis] - polygon[i, axis])
                inside[n_inside, axis] = outside[n_outside, axis] = place
            n_inside += 1
            n_outside += 1
    return n_inside, n_outside


@device_function
def _area(polygon, n):
    """Twice the area of a convex polygon."""
    area = 0.0
    for i in range(1, n - 1):
        normal = cross(minus(polygon[i], polygon[0]), minus(polygon[i + 1], polygon[0]))
        area += np.sqrt(dot(normal, normal))
    return area


@device_function
def _put(polygon, n, least, row, parts, rows, n_parts):
    """Append a polygon's triangles."""
    for i in range(1, n - 1):
        normal = cross(minus(polygon[i], polygon[0]), minus(polygon[i + 1], polygon[0]))
        if np.sqrt(dot(normal, normal)) > least:
            _copy(polygon, 0, 1, parts[n_parts], 0)
            _copy(polygon, i, i + 2, parts[n_parts], 1)
            rows[n_parts] = row
            n_parts += 1
    return n_parts
