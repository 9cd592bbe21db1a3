"""The numbers that several kernels share: how many things go together, and what the rows of their arrays hold."""

import numpy as np

from zbuf_occlude.jit.simd import N_LANES, N_WIDE

CLUSTER = N_LANES
"""Faces of a cluster, and children of a node: they are tested side by side."""

PACKET = N_WIDE
"""Points of a packet: tested side by side, too; in two registers, so that a look at a cluster, and each branch that
nobody can predict, is for more."""

CHUNK = 8
"""Packets of a chunk, which share a list of clusters."""

CHUNK_POINTS = CHUNK * PACKET

GROUP = N_LANES
"""Chunks whose boxes are projected side by side."""

# rows of (6, n) boxes: lower and upper corner; an axis' upper bound is UPPER rows below its lower one
UPPER = 3

# rows of (6, n) rectangles: bounds of x / w and y / w, the place in the image, and of w
LEFT, RIGHT, BOTTOM, TOP, NEAREST, FARTHEST = range(6)

# rows of a cluster's set-up, one lane for each face
EDGES = 0  # A, B, C of three edge functions A x + B y + C, in units of their error; all are >= 0 within the face
NORMAL = 9  # unit normal and offset: n . p - offset is positive on the eye's side
CONTACT = 13  # contact tolerance times the eye's distance from the plane
SETUP_ROWS = 14

ROUNDOFF = np.float32(2.0**-24)
"""Of float32: the largest relative error of an operation."""

COORDINATE_ERROR = np.float32(8.0) * ROUNDOFF
"""Of a projected coordinate, for a point with reach 1 (`search.setup` derives these)."""

EDGE_ERROR = np.float32(80.0) * ROUNDOFF
"""Of an edge function, as a share of the size of its face, for a point with reach / w = 1."""

PLANE_ERROR = np.float32(12.0) * ROUNDOFF
"""Of a point's distance from a plane, for a point with reach 1."""

ENDLESS = np.float32(3e38)
ZERO, HALF, ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)
