"""How the irregular z-buffer's work is cut for the hardware at hand."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Shape:
    """How work is cut for the hardware; no answer depends on it.

    Attributes
    ----------
    threads : int
        Of a work group.
    per_thread : int
        Points of a thread, at most 31.
    strands : int
        Threads that share a point and divide its triangles; divides `threads`.
    triangles : int
        Listed before the points test them.
    """

    threads: int
    per_thread: int
    strands: int
    triangles: int

    @property
    def packet(self) -> int:
        """Points of a packet."""
        return self.threads // self.strands * self.per_thread


Shapes = tuple[tuple[float, Shape], ...]
"""Points a face from which on a shape is the best, and the shape; the last from 0 on."""

SOFTWARE: Shapes = ((0.4, Shape(8, 16, 1, 24)), (0.05, Shape(8, 1, 2, 24)), (0.0, Shape(8, 1, 8, 24)))
"""For llvmpipe: one vector to a group, and many points per thread to make up for its slow shared memory."""

HARDWARE: Shapes = (
    (20.0, Shape(32, 2, 1, 16)),
    (4.0, Shape(32, 1, 1, 16)),
    (0.7, Shape(32, 1, 2, 16)),
    (0.05, Shape(32, 1, 8, 16)),
    (0.0, Shape(32, 1, 32, 16)),
)
"""For a GPU: one warp to a group, little shared memory so that many groups are in flight, and the packets for which
the fewest operations were counted: small ones where points are sparse, or each would look at too many faces."""


def best_shape(shapes: Shapes, n_points: int, n_faces: int) -> Shape:
    """Choose by how many points come to a face."""
    return next(shape for least, shape in shapes if n_points >= least * n_faces)
