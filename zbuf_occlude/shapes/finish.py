"""What real CAD files do to a shape: mixed winding, unshared vertices, faces drawn twice, any unit, any origin."""

import numpy as np

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.shapes.draw import Draw
from zbuf_occlude.shapes.kit import MeshPart

FEWEST_FACES = 200


def finished(part: MeshPart, draw: Draw) -> tuple[FloatArray, IntArray]:
    """Turn a modelled part into the vertices (v, 3) and faces (f, 3) of a file.

    Notes
    -----
    Faces are quartered at their edges' midpoints until there are `FEWEST_FACES`; winding turns over for none of the
    faces, for a run of them or for any; vertices are shared as modelled or every face has its own three, as in many
    files of ModelNet; at times a run of faces is there twice. The unit is anything from 0.05 to 500 times the
    modelled one, coordinates are single precision; the shape rests on z = 0 or is centred at the origin. The front
    stays towards -y.
    """
    # all is drawn before anything depends on the number of faces, so that another detail changes nothing else
    winding, start = draw.pick(("modelled", "modelled", "run", "any")), draw.between(0.0, 0.5)
    twice, first = draw.chance(0.15), draw.between(0.0, 1.0)
    unshared, centred = draw.chance(0.35), draw.chance(0.5)
    unit = float(np.exp(draw.between(np.log(0.05), np.log(500.0))))
    points, faces = part.points, part.faces
    while len(faces) < FEWEST_FACES:
        points, faces = quartered(points, faces)
    n = len(faces)
    if winding == "run":
        run = slice(int(start * n), int(2 * start * n))
        faces = np.concatenate([faces[: run.start], faces[run, ::-1], faces[run.stop :]])
    elif winding == "any":
        faces = np.where(draw.rng.random(n)[:, None] < 0.5, faces[:, ::-1], faces)
    if twice:
        again = int(first * n)
        faces = np.concatenate([faces, faces[again : again + n // 40]])
    if unshared:
        points, faces = points[faces].reshape(-1, 3), np.arange(3 * len(faces), dtype=np.int32).reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    middle = (low + high) / 2
    origin = middle if centred else np.array([middle[0], middle[1], low[2]])
    # single precision, as files have it; it also makes the last bits alike on all processors
    return ((points - origin) * unit).astype(np.float32).astype(np.float64), faces


def quartered(points: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Divide every triangle into four at the midpoints of its edges; the surface stays."""
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    unique, which = np.unique(edges, axis=0, return_inverse=True)
    middles = which.reshape(-1, 3) + len(points)
    a, b, c = faces.T
    ab, bc, ca = middles.T
    corners = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    divided = np.concatenate([np.stack(corner, axis=1) for corner in corners])
    return np.concatenate([points, points[unique].mean(axis=1)]), divided.astype(np.int32)
