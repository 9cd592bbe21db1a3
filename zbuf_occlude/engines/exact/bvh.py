"""Bounding volume hierarchy: leaves of up to 16 neighbouring faces, nodes of up to 16 children.

Scene space is world space moved and scaled so that the mesh fits into the unit sphere.
"""

import math
from typing import NamedTuple

import numpy as np

from zbuf_occlude.base.arrays import FloatArray, IntArray, set_readonly
from zbuf_occlude.base.jit.compiler import always_inline
from zbuf_occlude.base.jit.pointer import pointer_to
from zbuf_occlude.base.jit.simd import load3
from zbuf_occlude.base.jit.threads import n_blocks, next_task, parallel_for, parallel_kernel
from zbuf_occlude.base.jit.vec3 import plus
from zbuf_occlude.base.precompiler import Compilation
from zbuf_occlude.engines.exact.layout import (
    FIRST_CORNER,
    FIRST_EDGE,
    LEAF,
    SECOND_EDGE,
    TRIANGLE_ROWS,
    UPPER,
    Float32,
    Int64,
    aligned,
)
from zbuf_occlude.engines.exact.leaves import Leaves, divide_into_leaves, fill_leaf, new_leaf_scratch
from zbuf_occlude.engines.exact.nodes import grow, new_tree
from zbuf_occlude.geometry.mesh import Mesh

MIN_REACH = 1e-300
"""Least distance of a corner from the centre, world units, that is scaled to 1: its inverse is finite."""
BLOCK_LEAVES = 64
"""Leaves that a thread fills at a time."""
THREAD_LEAVES = 2 * BLOCK_LEAVES
"""Minimum leaves per extra thread; below this, waking it costs more."""


class Bvh(NamedTuple):
    """Prepared mesh. A face's *row* is 16 x its leaf + its lane in the leaf."""

    centre: FloatArray  # (3,) world space
    scale: float  # scene units per world unit
    contact: float  # the contact tolerance, scene units
    face_ids: IntArray  # (m leaves, 16) faces of each leaf, -1 where there is none
    rows: IntArray  # (f + 1,) row of each face, -1 for one that cannot block; the last entry, -1, stands for no face
    triangles: Float32  # (m, 10, 16) rows `FIRST_CORNER` to `LEAST` of each face, scene space
    planes: Float32  # (m, 4, 16) unit normal and offset of each face: n . p = offset on it
    used: Int64  # (m,) mask of the lanes of each leaf that hold a face
    weak: Int64  # (m,) mask of the faces of each leaf without a float32 plane (`WEAK_NORMAL`)
    box: Float32  # (6,) box of all faces: lower and upper corner
    boxes: Float32  # (6 n, 16) boxes of the children of n nodes; node i starts at row 6 i, node 0 is the root. Boxes of
    # unused lanes are empty, from `F32_MAX` to -`F32_MAX`, so that no ray enters them.
    children: IntArray  # (16 n,) node of each child, or ~leaf
    n_children: IntArray  # (n,) number of children of each node, which fill the first of its 16 lanes
    depth: int  # nodes on the longest path from the root to a leaf
    vertices: FloatArray  # (v, 3) world space
    faces: IntArray  # (f, 3)
    world_contact: float


def build_bvh(mesh: Mesh, contact: float) -> Bvh:
    """Build the hierarchy of a mesh; `contact` is the contact tolerance in world units.

    Notes
    -----
    O(f log f), about 70 bytes per face.

    Faces whose corners lie on one line are left out: by definition (`geometry.predicates.blocks`) they block nothing.
    """
    # the centre is rounded, so the box may reach farther from it than half its diagonal
    reach = math.hypot(*np.abs(mesh.bounds - mesh.centre).max(axis=0))
    scale = 1.0 / max(reach, MIN_REACH) if reach > 0.0 else 1.0
    return _fill(mesh, scale, contact, divide_into_leaves(mesh, scale))


def _fill(mesh: Mesh, scale: float, contact: float, leaves: Leaves) -> Bvh:
    """Return the hierarchy over given leaves: one thread grows the nodes while others fill the leaves."""
    n_leaves = len(leaves.starts) - 1
    bvh, tree = new_bvh(mesh.vertices, mesh.faces, mesh.centre, scale, contact, n_leaves), new_tree(n_leaves)
    bvh.rows[leaves.left_out] = bvh.rows[-1] = -1
    parallel_for(_fill_blocks, n_blocks(n_leaves, THREAD_LEAVES), bvh, leaves, tree, own=new_leaf_scratch)
    n, depth = (int(total) for total in tree.totals)
    boxes = aligned(n * 6, LEAF)
    boxes[:] = tree.boxes[: n * 6]
    children, n_children = tree.children[: n * LEAF].copy(), tree.n_children[:n].copy()
    box = np.concatenate([tree.rows[:UPPER], -tree.rows[UPPER : 2 * UPPER]])
    return bvh._replace(box=box, boxes=boxes, children=children, n_children=n_children, depth=depth)


@parallel_kernel
def _fill_blocks(tasks, bvh, leaves, tree, scratch):
    """Grow the nodes, which takes longest and is therefore the first task, and fill blocks of leaves."""
    bvh_at, leaves_at, tree_at, scratch_at = pointer_to(bvh), pointer_to(leaves), pointer_to(tree), pointer_to(scratch)
    n_leaves = len(leaves.starts) - 1
    block = next_task(tasks) - 1
    while BLOCK_LEAVES * block < n_leaves:
        if block < 0:
            grow(leaves.rows, tree_at)
        for leaf in range(max(BLOCK_LEAVES * block, 0), min(BLOCK_LEAVES * (block + 1), n_leaves)):
            fill_leaf(bvh_at, leaves_at, leaf, scratch_at)
        block = next_task(tasks) - 1


def new_bvh(
    vertices: FloatArray, faces: IntArray, centre: FloatArray, scale: float, contact: float, n_leaves: int
) -> Bvh:
    """Allocate the hierarchy of a mesh, without nodes."""
    return Bvh(
        centre=np.array(centre),
        scale=scale,
        contact=contact * scale,
        face_ids=np.empty((n_leaves, LEAF), dtype=np.int32),
        rows=np.empty(len(faces) + 1, dtype=np.int32),
        triangles=aligned(n_leaves, TRIANGLE_ROWS, LEAF),
        planes=np.empty((n_leaves, 4, LEAF), dtype=np.float32),
        used=np.empty(n_leaves, dtype=np.int64),
        weak=np.empty(n_leaves, dtype=np.int64),
        box=np.empty(6, dtype=np.float32),
        boxes=np.empty((0, LEAF), dtype=np.float32),
        children=np.empty(0, dtype=np.int32),
        n_children=np.empty(0, dtype=np.int32),
        depth=0,
        vertices=vertices,
        faces=faces,
        world_contact=contact,
    )


def empty_bvh() -> Bvh:
    """Return the hierarchy of a mesh without faces, whose arrays have the types of any other's."""
    no_vertices, no_faces = set_readonly(np.empty((0, 3))), set_readonly(np.empty((0, 3), dtype=np.int32))
    return new_bvh(no_vertices, no_faces, np.zeros(3), 1.0, 0.0, 0)


def compile_build() -> None:
    """Compile the filling of leaves, by a hierarchy without leaves, then the division, by a mesh of one face."""
    mesh, nothing = Mesh(np.eye(3), np.arange(3, dtype=np.int32)[None]), np.empty(0, dtype=np.int32)
    _fill(mesh, 1.0, 0.0, Leaves(nothing, np.zeros(1, dtype=np.int64), aligned(0), nothing))
    divide_into_leaves(mesh, 1.0)


@always_inline
def corners_of(bvh, face):
    """Return the corners of a face, world space."""
    a, b, c = bvh.faces[face, 0], bvh.faces[face, 1], bvh.faces[face, 2]
    return _vertex(bvh, a), _vertex(bvh, b), _vertex(bvh, c)


@always_inline
def corners_in_leaf(bvh, leaf):
    """Return the corners of the 16 faces of a leaf, float32, scene space; they err by less than 4 u."""
    base, triangles = leaf * TRIANGLE_ROWS * LEAF, bvh.triangles
    a = load3(triangles, base + FIRST_CORNER * LEAF, LEAF)
    ab, ac = load3(triangles, base + FIRST_EDGE * LEAF, LEAF), load3(triangles, base + SECOND_EDGE * LEAF, LEAF)
    return a, plus(a, ab), plus(a, ac)


@always_inline
def _vertex(bvh, i):
    return bvh.vertices[i, 0], bvh.vertices[i, 1], bvh.vertices[i, 2]


BUILDING = Compilation(_fill_blocks, compile_build)
