"""Visible parts of triangles: exact cuts along the shadows of other faces from an eye, by planes through the eye.

The part of a face that is nearer to the eye than another face hides the inside of its cone with the apex at the eye.
The sides of a cone are planes, so the visible part of a triangle is a set of convex polygons. Triangles with many faces
before them are quartered first. The faces before a triangle are found with the hierarchy of `exact`.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from zbuf_occlude.base.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.base.jit.compiler import device_function, njit
from zbuf_occlude.base.jit.simd import (
    dot3,
    first_lane,
    load,
    load_scalar,
    load_scalar3,
    maximum,
    muladd,
    not_less,
    splat,
    splat3,
)
from zbuf_occlude.base.jit.threads import n_threads
from zbuf_occlude.base.jit.vec3 import cross, dot, minus
from zbuf_occlude.engines.exact.bvh import Bvh, build_bvh, corners_in_leaf, corners_of
from zbuf_occlude.engines.exact.layout import LEAF, UPPER, ZERO
from zbuf_occlude.geometry.mesh import Mesh

BLOCK = 512
"""Triangles per block of a thread."""
MAX_BEFORE = 1024
"""Maximum faces before a triangle; with more it is quartered."""
MIN_QUARTERED = 1 / 128
"""Shortest edge of a triangle that is quartered, in radii of the mesh's bounding sphere."""
MAX_CORNERS = 8
"""Maximum corners of a polygon; with more it is halved."""
CORNER_ROOM = MAX_CORNERS + 5
"""Maximum corners of a polygon after cuts by the four sides of a cone."""
EDGE_ON = 1e-12
"""Sine of the angle between line of sight and face up to which the face is edge-on and nothing of it is seen."""
CERTAIN = 1e-9
"""Least sine of that angle, and least height of a face over its longest edge, for which rounding decides nothing."""
TOUCHING = 1e-12
"""Distance from a face's plane, in radii of the mesh's bounding sphere, up to which a point lies in the plane."""
DEEP_TOLERANCES = 300.0
"""Height of a face over another, in contact tolerances, above which it hides up to where both meet; a lower face hides
from the tolerance on. So silhouettes leave no strips as narrow as the tolerance on the faces behind."""
FLAT_TOLERANCES = 1e-3
"""Distance from a face's plane, in contact tolerances, up to which an eye lies in the plane."""
SLIVER = 1e-11
"""Share of a triangle's area up to which polygons are dropped."""

WALLS = 5
"""Number of planes around the space before a triangle: three through the eye and the sides, the triangle's plane, and
the parallel one through the eye."""
MARGIN = np.float32(4e-6)
"""Margin of tests against walls, in radii of the mesh's bounding sphere; float32 errs by a fifth of it."""

COVERED, TOO_MANY = -1, -2
NOTHING, SOME, ALL = 0, 1, 2


def cut_by_shadows(mesh: Mesh, eyes: FloatArray, contact: float) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return the parts that at least one of the eyes (k, 3) sees: triangles (n, 3, 3), face ids (n,) and areas (n,).

    Exact except for rounding: the cuts are the edges of the shadows. Nothing of a face seen edge-on is visible.
    `contact` is the contact tolerance, world units.
    """
    return _cut_faces(mesh, build_bvh(mesh, contact), eyes)


def seen_shares(mesh: Mesh, eyes: FloatArray, contact: float) -> FloatArray:
    """Return the share of each face's area that each eye (k, 3) sees, (k, f), exact except for rounding.

    It is NaN for a face that is not `CERTAIN`, and for all faces if the eye lies on one.
    """
    bvh, shares = build_bvh(mesh, contact), np.empty((len(eyes), len(mesh.faces)))
    for eye, share in zip(eyes, shares, strict=True):
        _, face_ids, areas = _cut_faces(mesh, bvh, eye[None])
        seen = np.bincount(face_ids, areas, minlength=len(mesh.faces))
        share[:] = np.where(_has_a_side(mesh, eye, contact), seen / np.where(mesh.areas > 0, mesh.areas, 1), np.nan)
    return shares


def _has_a_side(mesh: Mesh, eye: FloatArray, contact: float) -> BoolArray:
    """Return which faces (f,) an eye certainly sees from one side; none if it lies on a face, in its plane and box."""
    corners, sizes = mesh.corners - eye, 2.0 * mesh.areas
    distance = np.linalg.norm(corners[:, 0], axis=1)
    heights = np.abs(np.einsum("fi,fi->f", mesh.face_normals, corners[:, 0]))
    within = (corners.min(axis=1) <= contact) & (corners.max(axis=1) >= -contact)
    lies_on = (heights <= FLAT_TOLERANCES * contact * sizes) & within.all(axis=1)
    return (heights > CERTAIN * sizes * distance) & (sizes > CERTAIN * _longest_edges(corners) ** 2) & ~lies_on.any()


def _cut_faces(mesh: Mesh, bvh: Bvh, eyes: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
    face_ids = np.arange(len(mesh.faces) if len(eyes) else 0, dtype=np.int32)
    corners = mesh.corners[face_ids]
    parts, of_face = [np.empty((0, 3, 3))], [np.empty(0, dtype=np.int32)]
    with ThreadPoolExecutor(n_threads()) as pool:
        while len(corners):
            may_quarter = _longest_edges(corners) * bvh.scale > MIN_QUARTERED
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
    """Return the length of the longest edge of each triangle (n, 3, 3), (n,)."""
    return np.asarray(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1))


def _quartered(corners: FloatArray) -> FloatArray:
    """Divide each triangle into four, (4 n, 3, 3), with the same winding; neighbours get the same midpoints."""
    a, b, c = np.moveaxis(corners, 1, 0)
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.stack([np.stack(part, axis=1) for part in parts], axis=1).reshape(-1, 3, 3)


@njit(cache=True, nogil=True, _nrt=True)
def _cut(bvh, eyes, corners, own, may_quarter):
    """Return the visible parts of triangles, the row of each part, and which triangles must be quartered first.

    A stack holds polygons, each with the eye and the first of its cones to be tested. The part of a polygon that a cone
    hides is tested for the next eye.
    """
    is_quartered = np.zeros(len(corners), np.bool_)
    parts, rows, n_parts = np.empty((1024, 3, 3)), np.empty(1024, np.int32), 0
    cones, n_sides, shadows = np.empty((1024, 4, 4)), np.empty(1024, np.int64), np.empty((1024, 4))
    firsts, lasts = np.empty(len(eyes), np.int64), np.empty(len(eyes), np.int64)
    polygons, states = np.empty((64, CORNER_ROOM, 3)), np.empty((64, 3), np.int64)  # number of corners, eye, cone
    polygon, inside, outside = np.empty((CORNER_ROOM, 3)), np.empty((CORNER_ROOM, 3)), np.empty((CORNER_ROOM, 3))
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
            if eye == n_asked:  # the first polygon for this eye
                most = MAX_BEFORE if may_quarter[row] else len(bvh.faces)
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
            if n > MAX_CORNERS:
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
                if n_parts + CORNER_ROOM > len(parts):
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
    """Push a polygon, if there is such an eye; return the size of the stack."""
    if eye == n_eyes:
        return n_waiting
    _copy(polygon, 0, n, polygons[n_waiting], 0)
    states[n_waiting, 0], states[n_waiting, 1], states[n_waiting, 2] = n, eye, cone
    return n_waiting + 1


@njit(_nrt=True)
def _cones_before(bvh, eye, corners, own, most, found, n_cones, stack, walls, part, axes):
    """Append the cones of the faces before a triangle; return the arrays, and the number, `COVERED` or `TOO_MANY`.

    `walls` receives the planes around the space between the triangle and the eye.
    """
    cones, n_sides, shadows = found
    # all positions are relative to the triangle's first corner: relative to a far eye they would lose digits
    origin = corners[0]
    a, b, c, eye = (0.0, 0.0, 0.0), minus(corners[1], origin), minus(corners[2], origin), minus(eye, origin)
    normal, distance = cross(b, c), np.sqrt(dot(eye, eye))
    size = np.sqrt(dot(normal, normal))
    if abs(dot(normal, eye)) <= EDGE_ON * size * distance:
        return (cones, n_sides, shadows), COVERED
    sign = 1.0 if dot(normal, eye) > 0.0 else -1.0
    normal = sign * normal[0], sign * normal[1], sign * normal[2]
    height = dot(normal, eye)
    touching = TOUCHING * size / bvh.scale
    near = max(height * bvh.world_contact / distance, touching)
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
                at, end = n_cones + n_found, 0.0 if highest > DEEP_TOLERANCES * near else near
                n_sides[at], hidden = _cone(p, q, r, b, c, eye, heights, end, touching, part, cones[at])
                if hidden == ALL:
                    return (cones, n_sides, shadows), COVERED
                if hidden == SOME:
                    _cast_shadow(part, n_sides[at], eye, normal, height, axes, shadows[at])
                    n_found += 1
    return (cones, n_sides, shadows), n_found


@device_function
def _put_wall(bvh, origin, normal, constant, walls, i):
    """Write a plane in scene space and float32, with a normal of length 1 or 0; `constant` is relative to `origin`."""
    length = np.sqrt(dot(normal, normal))
    inverse = 1.0 / length if length > 0.0 else 0.0
    for axis in range(3):
        walls[4 * i + axis] = normal[axis] * inverse
    away = (dot(normal, minus(bvh.centre, origin)) + constant) * inverse * bvh.scale
    walls[4 * i + 3] = min(max(away, -4.0), 4.0)  # the scene is within 1 of its centre


@device_function
def _children_within(bvh, node, walls):
    """Return the mask of a node's children, except those wholly behind a wall by more than the float32 error."""
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
    """Return the mask of a leaf's faces, except those wholly behind a wall by more than the float32 error."""
    mask, (a, b, c) = bvh.used[leaf], corners_in_leaf(bvh, leaf)
    for i in range(WALLS):
        across, away = splat3(load_scalar3(walls, 4 * i, 1)), load_scalar(walls, 4 * i + 3)
        highest = maximum(dot3(a, across), maximum(dot3(b, across), dot3(c, across)))
        mask &= not_less(highest + away, splat(-MARGIN))
    return mask


@device_function
def _copy(polygon, first, last, target, at):
    """Copy corners first to last - 1 to a polygon, from corner `at` on."""
    for i in range(first, last):
        for axis in range(3):
            target[at + i - first, axis] = polygon[i, axis]


@device_function
def _through(eye, first, second, sign, plane):
    """Write the plane through the eye and two positions: its normal, and its constant."""
    normal = cross(minus(first, eye), minus(second, first))
    for axis in range(3):
        plane[axis] = sign * normal[axis]
    plane[3] = -sign * dot(normal, first)


@device_function
def _side(plane, position):
    """Return the signed distance of a position from a plane, times the length of the plane's normal."""
    return dot(plane, position) + plane[3]


@device_function
def _cone(p, q, r, b, c, eye, heights, end, touching, part, cone):
    """Write the planes through the eye and the sides of the part of a face pqr that is above `end`.

    Return their number, and whether the part may hide nothing, some or all of the triangle 0, b, c. A corner that
    touches `end` is kept: a cut right beside it would have no direction.
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
    """Return two axes of a triangle's plane, of length 1 or 0."""
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
    """Write the bounds of a part's shadow along two axes of the triangle's plane, widened; infinite near the eye."""
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
        position = part[i, 0] + share * x, part[i, 1] + share * y, part[i, 2] + share * z
        for j, axis in enumerate(axes):
            at = dot(axis, position)
            slack = 1e-9 * (abs(position[0]) + abs(position[1]) + abs(position[2]))
            shadow[2 * j] = min(shadow[2 * j], at - slack)
            shadow[2 * j + 1] = max(shadow[2 * j + 1], at + slack)


@device_function
def _box_of(polygon, n, origin, axes):
    """Return the bounds of a polygon along two axes."""
    low, high, left, right = np.inf, -np.inf, np.inf, -np.inf
    for i in range(n):
        position = minus(polygon[i], origin)
        u, v = dot(axes[0], position), dot(axes[1], position)
        low, high, left, right = min(low, u), max(high, u), min(left, v), max(right, v)
    return low, high, left, right


@device_function
def _are_apart(box, other):
    return (box[0] > other[1]) | (box[1] < other[0]) | (box[2] > other[3]) | (box[3] < other[2])


@device_function
def _is_apart(polygon, n, origin, cone, n_sides):
    """Return whether a polygon lies outside one of a cone's sides."""
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
    """Split a convex polygon by a plane; return the number of corners of each part."""
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
                position = polygon[i, axis] + share * (polygon[j, axis] - polygon[i, axis])
                inside[n_inside, axis] = outside[n_outside, axis] = position
            n_inside += 1
            n_outside += 1
    return n_inside, n_outside


@device_function
def _area(polygon, n):
    """Return twice the area of a convex polygon."""
    area = 0.0
    for i in range(1, n - 1):
        normal = cross(minus(polygon[i], polygon[0]), minus(polygon[i + 1], polygon[0]))
        area += np.sqrt(dot(normal, normal))
    return area


@device_function
def _put(polygon, n, least, row, parts, rows, n_parts):
    """Append a polygon's triangles; return the number of triangles."""
    for i in range(1, n - 1):
        normal = cross(minus(polygon[i], polygon[0]), minus(polygon[i + 1], polygon[0]))
        if np.sqrt(dot(normal, normal)) > least:
            _copy(polygon, 0, 1, parts[n_parts], 0)
            _copy(polygon, i, i + 2, parts[n_parts], 1)
            rows[n_parts] = row
            n_parts += 1
    return n_parts
