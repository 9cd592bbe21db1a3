"""Faces that an eye sees wholly or not at all: proved, by the edges at which what hides them may end.

What hides a face ends, seen from the eye, only at an edge whose faces all lie on one side of the plane through it and
the eye, or where another face touches or pierces it. A face is uniform where no such edge passes through the
tetrahedron of the eye and the face, and nothing touches it. Then one of its points answers for all.
"""

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.jit.compiler import njit
from zbuf_occlude.jit.vec3 import cross, dot, minus

ROUNDING = 1e-14
"""Bounds the error of the volume of three vectors, over the product of their lengths: 90 units in the last place."""
FLAT = 1e-3
"""Contact tolerances: a vertex so near to a face's plane lies in it."""
CLEAR = 10.0
"""Contact tolerances: as far above a face's middle a neighbour that is folded over it must be."""


def uniform_faces(mesh: Mesh, eyes: FloatArray, contact: float) -> BoolArray:
    """Prove which faces each eye sees wholly or not at all, (k, f); False is no proof of the opposite.

    Proved is the answer of an exact method at every point of the face to which no other face is nearer than the contact
    tolerance, `contact` diagonals. Vertices at equal places are one. Of an eye on a face, or very far away, nothing is
    proved. Time grows as faces times the edges of the silhouette.
    """
    contact *= mesh.diagonal
    _, places = np.unique(mesh.vertices, axis=0, return_inverse=True)
    faces = places.reshape(-1)[mesh.faces].astype(np.int64)
    vertices = np.empty((faces.max() + 1, 3))
    vertices[faces.ravel()] = mesh.vertices[mesh.faces.ravel()]
    flat = mesh.areas == 0.0
    touched = _touched(vertices, faces, flat, *_along(mesh), contact)
    edges, firsts, opposite = _edges(faces[~flat])
    found = np.zeros((len(eyes), len(faces)), dtype=bool)
    for eye, uniform in zip(eyes, found, strict=True):
        if _on_a_face(vertices[faces[~flat]] - eye, contact):
            continue
        ends = vertices[edges[_may_end(vertices - eye, edges, firsts, opposite)]] - eye
        uniform[:] = ~(touched | flat | _crossed(vertices - eye, faces, flat, ends, contact))
    return found


def _on_a_face(corners: FloatArray, contact: float) -> bool:
    """Whether the eye, the origin, may lie on a face (f, 3, 3): in its plane by rounding, and in its box."""
    volumes = np.abs(np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])))
    sizes = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    farthest = np.linalg.norm(corners, axis=2).max(axis=1)
    near = volumes <= np.maximum(4.0 * ROUNDING * farthest**3, FLAT * contact * sizes)
    slack = max(contact, ROUNDING * float(farthest.max(initial=0.0)))
    return bool((near & ((corners.min(axis=1) <= slack) & (corners.max(axis=1) >= -slack)).all(axis=1)).any())


def _along(mesh: Mesh) -> tuple[NDArray[np.intp], FloatArray, FloatArray]:
    """Return the faces in the order of the low ends of their boxes along the longest axis; the boxes (f, 3) each."""
    low, high = mesh.corners.min(axis=1), mesh.corners.max(axis=1)
    axis = int(np.ptp(mesh.bounds, axis=0).argmax())
    return np.argsort(low[:, axis], kind="stable"), np.roll(low, -axis, axis=1), np.roll(high, -axis, axis=1)


def _edges(faces: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Return each edge's vertices (e, 2), where its faces begin in the last (e + 1,), and their third vertices."""
    ends = np.concatenate([np.sort(faces[:, [i, (i + 1) % 3]], axis=1) for i in range(3)])
    third = np.concatenate([faces[:, (i + 2) % 3] for i in range(3)])
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    ends, third = ends[order], third[order]
    firsts = np.flatnonzero(np.append(True, (np.diff(ends, axis=0) != 0).any(axis=1)))
    return ends[firsts], np.append(firsts, len(ends)), third


@njit(cache=True)
def _length(vector):
    return np.sqrt(dot(vector, vector))


@njit(cache=True, _nrt=True)
def _may_end(at, edges, firsts, opposite):
    """Which edges (e,) do not surely have faces on both sides of the plane through them and the eye, the origin."""
    found = np.ones(len(edges), np.bool_)
    for i in range(len(edges)):
        p, q = at[edges[i, 0]], at[edges[i, 1]]
        normal, bound = cross(p, q), ROUNDING * _length(p) * _length(q)
        left = right = False
        for j in range(firsts[i], firsts[i + 1]):
            side, error = dot(normal, at[opposite[j]]), bound * _length(at[opposite[j]])
            left |= side > error
            right |= side < -error
        found[i] = not (left and right)
    return found


@njit(cache=True, _nrt=True)
def _crossed(at, faces, flat, ends, contact):
    """Which faces (f,) an edge (n, 2, 3) may pass before, within the face's outline; or that are seen edge-on.

    The eye is the origin.
    """
    found = np.zeros(len(faces), np.bool_)
    planes, slack = np.empty((4, 3)), np.empty(4)
    lengths = np.empty(len(ends))
    for i in range(len(ends)):
        lengths[i] = max(_length(ends[i, 0]), _length(ends[i, 1]))
    for face in range(len(faces)):
        if flat[face]:
            continue
        a, b, c = at[faces[face, 0]], at[faces[face, 1]], at[faces[face, 2]]
        sides = (_length(a), _length(b), _length(c))
        normal = cross(minus(b, a), minus(c, a))
        volume, farthest = dot(cross(a, b), c), max(sides[0], sides[1], sides[2])
        sign = 1.0 if volume > 0.0 else -1.0
        # a face in front by this, over the length of `normal`, is nearer than the contact tolerance at no point
        margin = 0.5 * contact * abs(volume) / farthest
        if abs(volume) <= 4.0 * ROUNDING * farthest**3 or margin < 2.0 * FLAT * contact * _length(normal):
            found[face] = True
            continue
        for i, (first, second) in enumerate(((a, b), (b, c), (c, a))):
            plane = cross(first, second)
            slack[i] = ROUNDING * _length(first) * _length(second)
            for axis in range(3):
                planes[i, axis] = sign * plane[axis]
        for axis in range(3):
            planes[3, axis] = -sign * normal[axis]
        slack[3] = ROUNDING * farthest**2 * 4.0
        for i in range(len(ends)):
            low, high = 0.0, 1.0
            for j in range(4):
                start = dot(planes[j], ends[i, 0]) + slack[j] * lengths[i]
                end = dot(planes[j], ends[i, 1]) + slack[j] * lengths[i]
                if j == 3:
                    offset = abs(volume) - margin + slack[3] * farthest
                    start, end = start + offset, end + offset
                if start <= 0.0 and end <= 0.0:
                    low, high = 1.0, 0.0
                    break
                if start <= 0.0:
                    low = max(low, start / (start - end))
                elif end <= 0.0:
                    high = min(high, start / (start - end))
            if low <= high + 1e-12:
                found[face] = True
                break
    return found


@njit(cache=True, _nrt=True)
def _touched(vertices, faces, flat, order, low, high, contact):
    """Which faces (f,) may have another nearer than the contact tolerance, but neighbours along edges and at corners.

    `order` sorts the boxes (f, 3) by their lower ends along the first axis.
    """
    found = np.zeros(len(faces), np.bool_)
    for rank in range(len(order)):
        one = order[rank]
        for next_rank in range(rank + 1, len(order)):
            other = order[next_rank]
            if low[other, 0] > high[one, 0] + contact:
                break
            apart = flat[one] or flat[other] or (found[one] and found[other])
            for axis in range(1, 3):
                apart |= low[other, axis] > high[one, axis] + contact
                apart |= low[one, axis] > high[other, axis] + contact
            if not apart and _near(vertices, faces[one], faces[other], contact):
                found[one] = found[other] = True
    return found


@njit(cache=True)
def _near(vertices, one, other, contact):
    """Whether two faces may be nearer than the contact tolerance, otherwise than as neighbours in a surface are."""
    n_shared, shared, its = 0, 0, 0
    for i in range(3):
        for j in range(3):
            if one[i] == other[j]:
                n_shared, shared, its = n_shared + 1, i, j
    if n_shared == 3:
        return False
    if n_shared == 2:
        return _folds(vertices, one, other, contact) or _folds(vertices, other, one, contact)
    if n_shared == 1:
        return _pierces(vertices, one, shared, other, its, contact) or _pierces(
            vertices, other, its, one, shared, contact
        )
    a, b, c = vertices[one[0]], vertices[one[1]], vertices[one[2]]
    d, e, f = vertices[other[0]], vertices[other[1]], vertices[other[2]]
    first, second = (minus(b, a), minus(c, b), minus(a, c)), (minus(e, d), minus(f, e), minus(d, f))
    normal = cross(first[0], first[1])
    size, step = _length(normal), FLAT * contact
    heights = (dot(normal, minus(d, a)), dot(normal, minus(e, a)), dot(normal, minus(f, a)))
    if max(abs(heights[0]), abs(heights[1]), abs(heights[2])) <= step * size:
        return False  # in one plane: neither is before the other
    if _gap(normal, a, b, c, d, e, f) > contact or _gap(cross(second[0], second[1]), a, b, c, d, e, f) > contact:
        return False
    for i in range(3):
        for j in range(3):
            if _gap(cross(first[i], second[j]), a, b, c, d, e, f) > contact:
                return False
    return True


@njit(cache=True)
def _gap(axis, a, b, c, d, e, f):
    """Return how far apart two triangles are along an axis, at least; 0 or less where they overlap."""
    length = _length(axis)
    if length == 0.0:
        return 0.0
    one, two, three = dot(axis, a), dot(axis, b), dot(axis, c)
    four, five, six = dot(axis, d), dot(axis, e), dot(axis, f)
    over = min(four, five, six) - max(one, two, three)
    under = min(one, two, three) - max(four, five, six)
    return max(over, under) / length


@njit(cache=True)
def _folds(vertices, one, other, contact):
    """Whether a face that shares an edge with another lies over that, nearer than `CLEAR` tolerances to its middle."""
    third = its = 0
    for i in range(3):
        if one[i] != other[0] and one[i] != other[1] and one[i] != other[2]:
            third = i
        if other[i] != one[0] and other[i] != one[1] and other[i] != one[2]:
            its = i
    a, b = vertices[one[(third + 1) % 3]], vertices[one[(third + 2) % 3]]
    edge, inner, outer = minus(b, a), minus(vertices[one[third]], a), minus(vertices[other[its]], a)
    normal = cross(edge, inner)
    size, inwards = _length(normal), cross(normal, edge)
    height, over = abs(dot(normal, outer)) / size, dot(inwards, outer)
    if over <= 0.0 or height <= FLAT * contact:
        return False
    return height * dot(inwards, inner) < 3.0 * CLEAR * contact * over


@njit(cache=True)
def _pierces(vertices, one, shared, other, its, contact):
    """Whether a face that shares a corner with another may cut through that, along a line from the corner.

    Or lie over it, nearer than `CLEAR` tolerances to its middle.
    """
    a = vertices[one[shared]]
    b, c = minus(vertices[one[(shared + 1) % 3]], a), minus(vertices[one[(shared + 2) % 3]], a)
    p, q = minus(vertices[other[(its + 1) % 3]], a), minus(vertices[other[(its + 2) % 3]], a)
    normal = cross(b, c)
    step = FLAT * contact * _length(normal)
    height_p, height_q = dot(normal, p), dot(normal, q)
    if max(abs(height_p), abs(height_q)) <= step:
        return False
    over = _in_wedge(b, c, p, normal) or _in_wedge(b, c, q, normal)
    across = cross(p, q)
    over = over or _in_wedge(p, q, b, across) or _in_wedge(p, q, c, across)
    slope = max(abs(height_p) / _length(p), abs(height_q) / _length(q))
    middle = _length((b[0] + c[0], b[1] + c[1], b[2] + c[2])) / 3.0
    if over and slope * middle < CLEAR * contact * _length(normal):
        return True
    if min(height_p, height_q) > step or max(height_p, height_q) < -step:
        return False
    share = height_p / (height_p - height_q)
    line = (p[0] + share * (q[0] - p[0]), p[1] + share * (q[1] - p[1]), p[2] + share * (q[2] - p[2]))
    return _in_wedge(b, c, line, normal)


@njit(cache=True)
def _in_wedge(b, c, line, normal):
    """Whether a line from a corner may lie, seen along the normal, between the edges b and c that meet there."""
    bound = -1e-6 * _length(line) * _length(normal) * max(_length(b), _length(c))
    return dot(cross(b, line), normal) > bound and dot(cross(line, c), normal) > bound
