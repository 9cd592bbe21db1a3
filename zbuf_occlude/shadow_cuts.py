"""Triangles cut along the shadows that other faces throw on them, seen from an eye: exactly, by planes through the eye.

What a face hides of another lies within the cone of the eye and the part of it that is nearer. A cone's sides are
planes, so what is left of a triangle is a few convex polygons. Triangles before which many faces lie are quartered
first. The faces before a triangle come from the boxes of `exact`.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.exact.bvh import Bvh, build_bvh
from zbuf_occlude.exact.layout import LEAF, UPPER
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.jit.compiler import inner, njit
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
TOUCHING = 1e-12
"""Radii of the mesh's bounding sphere: what is nearer to a face's plane lies in it."""
DEEP = 300.0
"""Contact tolerances: a face that comes so far before another is cut off where it meets that, a shallower one where
the tolerance begins. So a silhouette does not leave strips as narrow as the tolerance on the faces behind it."""
FLAT = 1e-3
"""Contact tolerances: an eye so near to a face's plane lies in it."""
SLIVER = 1e-11
"""Share of a triangle: smaller polygons are dropped."""

COVERED, TOO_MANY = -1, -2


def cut_by_shadows(mesh: Mesh, eyes: FloatArray, contact: float) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return what one of the eyes (k, 3) sees at least: triangles (n, 3, 3), of which face each is, their areas (n,).

    Exact but for rounding: cuts lie where the shadows' edges do. Of a face seen edge-on nothing is seen. `contact` is
    the contact tolerance, world units.
    """
    return _cut_faces(mesh, build_bvh(mesh, contact), eyes)


def seen_shares(mesh: Mesh, eyes: FloatArray, contact: float) -> FloatArray:
    """Return the share of each face's area that each eye (k, 3) sees, (k, f), exact but for rounding.

    NaN for a face without area or seen edge-on, and for all faces where the eye lies on one.
    """
    bvh, shares = build_bvh(mesh, contact), np.empty((len(eyes), len(mesh.faces)))
    for eye, share in zip(eyes, shares, strict=True):
        _, face_ids, areas = _cut_faces(mesh, bvh, eye[None])
        seen = np.bincount(face_ids, areas, minlength=len(mesh.faces))
        share[:] = np.where(_has_a_side(mesh, eye, contact), seen / np.where(mesh.areas > 0, mesh.areas, 1), np.nan)
    return shares


def _has_a_side(mesh: Mesh, eye: FloatArray, contact: float) -> BoolArray:
    """Which faces (f,) an eye sees from one side; none where it lies on a face: in its plane, and in its box."""
    corners = mesh.corners - eye
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sizes, reach = np.linalg.norm(normals, axis=1), np.linalg.norm(corners[:, 0], axis=1)
    heights = np.abs(np.einsum("fi,fi->f", normals, corners[:, 0]))
    within = (corners.min(axis=1) <= contact) & (corners.max(axis=1) >= -contact)
    lies_on = (heights <= FLAT * contact * sizes) & within.all(axis=1)
    return (heights > EDGE_ON * sizes * reach) & ~lies_on.any()


def _cut_faces(mesh: Mesh, bvh: Bvh, eyes: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
    tree = bvh.boxes, bvh.children, bvh.n_children, bvh.face_ids, bvh.vertices, bvh.faces, bvh.depth
    scene = bvh.centre, bvh.scale, bvh.world_contact
    face_ids = np.arange(len(mesh.faces) if len(eyes) else 0, dtype=np.int32)
    corners = mesh.corners[face_ids]
    parts, of_face = [np.empty((0, 3, 3))], [np.empty(0, dtype=np.int32)]
    with ThreadPoolExecutor(n_threads()) as pool:
        while len(corners):
            length = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
            may_quarter = length * bvh.scale > SHORTEST
            blocks = [slice(first, first + BLOCK) for first in range(0, len(corners), BLOCK)]
            cut = [pool.submit(_cut, tree, scene, eyes, corners[i], face_ids[i], may_quarter[i]) for i in blocks]
            rest = np.zeros(len(corners), dtype=bool)
            for block, each in zip(blocks, cut, strict=True):
                seen, rows, rest[block] = each.result()
                parts.append(seen)
                of_face.append(face_ids[block][rows])
            corners, face_ids = _quartered(corners[rest]), np.repeat(face_ids[rest], 4)
    found = np.concatenate(parts)
    areas = 0.5 * np.linalg.norm(np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0]), axis=1)
    return found, np.concatenate(of_face), areas


def _quartered(corners: FloatArray) -> FloatArray:
    """Four triangles for each one, (4 n, 3, 3), wound alike; neighbours get the same midpoints."""
    a, b, c = np.moveaxis(corners, 1, 0)
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.stack([np.stack(part, axis=1) for part in parts], axis=1).reshape(-1, 3, 3)


@njit(cache=True, nogil=True, _nrt=True)
def _cut(tree, scene, eyes, corners, own, may_quarter):
    """Return the seen parts of triangles, of which each is, and which are to be quartered first.

    Polygons wait on a stack, each for an eye's cones from one on. What a cone takes away waits for the next eye.
    """
    is_quartered = np.zeros(len(corners), np.bool_)
    faces, depth = tree[5], tree[6]
    parts, rows, n_parts = np.empty((1024, 3, 3)), np.empty(1024, np.int32), 0
    cones, n_sides = np.empty((1024, 4, 4)), np.empty(1024, np.int64)
    firsts, lasts = np.empty(len(eyes), np.int64), np.empty(len(eyes), np.int64)
    polygons, states = np.empty((64, ROOM, 3)), np.empty((64, 3), np.int64)  # how many corners, eye, cone
    polygon, inside, outside = np.empty((ROOM, 3)), np.empty((ROOM, 3)), np.empty((ROOM, 3))
    stack, planes = np.empty((LEAF - 1) * depth + LEAF, np.int32), np.empty((5, 4))
    for row in range(len(corners)):
        n_before, n_cones, n_asked, n_waiting = n_parts, 0, 0, 1
        size = _area(corners[row], 3)
        _copy(corners[row], 0, 3, polygons[0], 0)
        states[0, 0], states[0, 1], states[0, 2] = 3, 0, 0
        while n_waiting > 0:
            if n_waiting + 6 > len(polygons):
                polygons = np.concatenate((polygons, np.empty_like(polygons)))
                states = np.concatenate((states, np.empty_like(states)))
            n_waiting -= 1
            n, eye, i = states[n_waiting, 0], states[n_waiting, 1], states[n_waiting, 2]
            _copy(polygons[n_waiting], 0, n, polygon, 0)
            if eye == n_asked:  # the first polygon that waits for this eye
                most = MOST if may_quarter[row] else len(faces)
                cones, n_sides, n_found = _cones_before(
                    tree, scene, eyes[eye], corners[row], own[row], most, cones, n_sides, n_cones, stack, planes, inside
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
            while i < lasts[eye] and _is_apart(polygon, n, corners[row, 0], cones[i], n_sides[i]):
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


@inner
def _wait(polygon, n, eye, cone, n_eyes, polygons, states, n_waiting):
    """Put a polygon on the stack, if there is such an eye; return how many wait there."""
    if eye == n_eyes:
        return n_waiting
    _copy(polygon, 0, n, polygons[n_waiting], 0)
    states[n_waiting, 0], states[n_waiting, 1], states[n_waiting, 2] = n, eye, cone
    return n_waiting + 1


@njit(_nrt=True)
def _cones_before(tree, scene, eye, corners, own, most, cones, n_sides, n_cones, stack, planes, part):
    """Append the cones of the faces before a triangle; return these arrays, and how many, or `COVERED` or `TOO_MANY`.

    `planes` becomes the three through the eye and the triangle's sides, the triangle's own, and the one through the eye
    that is parallel to it; what hides something lies on the positive side of all.
    """
    boxes, children, n_children, leaves, vertices, faces, _ = tree
    # all places count from the triangle's first corner: from a far eye on, they would lose their last digits
    origin = corners[0]
    a, b, c, eye = (0.0, 0.0, 0.0), minus(corners[1], origin), minus(corners[2], origin), minus(eye, origin)
    normal, reach = cross(b, c), np.sqrt(dot(eye, eye))
    height, size = dot(normal, eye), np.sqrt(dot(normal, normal))
    if abs(height) <= EDGE_ON * size * reach:
        return cones, n_sides, COVERED
    sign, height = (1.0 if height > 0.0 else -1.0), abs(height)
    touching = TOUCHING * size / scene[1]
    near = max(height * scene[2] / reach, touching)
    for i, (first, second) in enumerate(((a, b), (b, c), (c, a))):
        _through(eye, first, second, -sign, planes[i])
    for axis in range(3):
        planes[3, axis], planes[4, axis] = sign * normal[axis], -sign * normal[axis]
    planes[3, 3], planes[4, 3] = -near, height
    stack[0], n_stack, n_found = 0, 1, 0
    while n_stack > 0:
        n_stack -= 1
        node = stack[n_stack]
        for child in range(n_children[node]):
            if _box_is_out(boxes, node, child, scene, origin, planes):
                continue
            below = children[LEAF * node + child]
            if below >= 0:
                stack[n_stack] = below
                n_stack += 1
                continue
            for lane in range(LEAF):
                face = leaves[~below, lane]
                if face < 0 or face == own:
                    continue
                p = minus(vertices[faces[face, 0]], origin)
                q = minus(vertices[faces[face, 1]], origin)
                r = minus(vertices[faces[face, 2]], origin)
                heights = dot(planes[3], p), dot(planes[3], q), dot(planes[3], r)
                highest = max(heights[0], heights[1], heights[2])
                if highest <= near:
                    continue
                end = 0.0 if highest > DEEP * near else near
                is_nearer = min(heights[0], heights[1], heights[2]) >= end - touching
                before = _before(p, q, r, b, c, eye, planes, is_nearer)
                if before == 0:
                    continue
                if before == 2:
                    return cones, n_sides, COVERED
                if n_found == most:
                    return cones, n_sides, TOO_MANY
                if n_cones + n_found == len(cones):
                    cones = np.concatenate((cones, np.empty_like(cones)))
                    n_sides = np.concatenate((n_sides, np.empty_like(n_sides)))
                at = n_cones + n_found
                n_sides[at] = _cone(p, q, r, eye, heights, end, touching, part, cones[at])
                n_found += 1
    return cones, n_sides, n_found


@inner
def _copy(polygon, first, last, target, at):
    """Copy corners from one to another to a place of a polygon."""
    for i in range(first, last):
        for axis in range(3):
            target[at + i - first, axis] = polygon[i, axis]


@inner
def _through(eye, first, second, sign, plane):
    """Write the plane through the eye and two places: its normal, and the constant that is added."""
    normal = cross(minus(first, eye), minus(second, first))
    for axis in range(3):
        plane[axis] = sign * normal[axis]
    plane[3] = -sign * dot(normal, first)


@inner
def _side(plane, place):
    """On which side of a plane a place lies, and how far, in lengths of the plane's normal."""
    return dot(plane, place) + plane[3]


@inner
def _box_is_out(boxes, node, child, scene, origin, planes):
    """Whether a node's child lies wholly outside one of the planes around what hides a triangle."""
    centre, scale = scene[0], scene[1]
    for i in range(5):
        highest = planes[i, 3]
        for axis in range(3):
            end = boxes[6 * node + axis + (UPPER if planes[i, axis] > 0.0 else 0), child]
            highest += planes[i, axis] * (end / scale + centre[axis] - origin[axis])
        if highest < 0.0:
            return True
    return False


@inner
def _before(p, q, r, b, c, eye, planes, is_nearer):
    """Whether a face that is nearer, wholly or in part, may hide something of a triangle: 0 no, 1 perhaps, 2 all."""
    for i in range(5):
        if i != 3 and max(_side(planes[i], p), _side(planes[i], q), _side(planes[i], r)) <= 0.0:
            return 0
    sign = _winding(p, q, r, eye)
    covers = is_nearer and sign != 0.0
    for first, second in ((p, q), (q, r), (r, p)):
        normal = cross(minus(first, eye), minus(second, first))
        constant = dot(normal, first)
        one, two, three = -sign * constant, sign * (dot(normal, b) - constant), sign * (dot(normal, c) - constant)
        if max(one, two, three) <= 0.0:
            return 0
        covers &= min(one, two, three) >= 0.0
    return 2 if covers else 1


@inner
def _winding(p, q, r, eye):
    """1 where the eye sees a face wound with the clock, -1 where against it, 0 where edge-on."""
    volume = dot(cross(minus(q, p), minus(r, p)), minus(p, eye))
    return 1.0 if volume > 0.0 else (-1.0 if volume < 0.0 else 0.0)


@inner
def _cone(p, q, r, eye, heights, end, touching, part, cone):
    """Write the planes through the eye and the sides of what of a face is nearer than `end`; return how many.

    A corner that touches the end stays: a cut right beside it would have no direction.
    """
    corners, n, sign = (p, q, r), 0, _winding(p, q, r, eye)
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
    for i in range(n):
        _through(eye, part[i], part[(i + 1) % n], sign, cone[i])
    return n


@inner
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


@inner
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


@inner
def _area(polygon, n):
    """Twice the area of a convex polygon."""
    area = 0.0
    for i in range(1, n - 1):
        normal = cross(minus(polygon[i], polygon[0]), minus(polygon[i + 1], polygon[0]))
        area += np.sqrt(dot(normal, normal))
    return area


@inner
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
