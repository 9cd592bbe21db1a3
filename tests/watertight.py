"""Lines that must meet a surface: from inside closed meshes, and those of a picture or a scan that was meshed again."""

import numpy as np

import zbuf_occlude as zo
from zbuf_occlude.base.arrays import BoolArray, FloatArray

N_EYES = 20
"""Eyes inside a closed mesh."""


def is_closed(mesh: zo.Mesh) -> bool:
    """Whether each edge, by its corners' positions, runs as often one way as the other."""
    _, ids = np.unique(mesh.vertices, axis=0, return_inverse=True)
    faces = ids.reshape(-1)[mesh.faces]
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    both, inverse = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    balance = np.bincount(inverse.reshape(-1), np.where(edges[:, 0] < edges[:, 1], 1, -1), minlength=len(both))
    return bool((balance == 0).all())


def windings(mesh: zo.Mesh, positions: FloatArray) -> FloatArray:
    """How many times a closed mesh surrounds each position, (n,): the sum of its faces' solid angles over 4 pi."""
    found = np.empty(len(positions))
    for i, position in enumerate(positions):
        a, b, c = (mesh.corners - position).transpose(1, 0, 2)
        x, y, z = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
        volume = np.einsum("fi,fi->f", a, np.cross(b, c))
        sums = x * y * z + (a * b).sum(axis=1) * z + (b * c).sum(axis=1) * x + (c * a).sum(axis=1) * y
        found[i] = np.arctan2(volume, sums).sum() / (2.0 * np.pi)
    return found


def eyes_inside(mesh: zo.Mesh, rng: np.random.Generator, n_eyes: int = N_EYES) -> FloatArray:
    """Up to n positions that a closed mesh surrounds."""
    tried = rng.uniform(*mesh.bounds, (40 * n_eyes, 3))[: max(40, 2_000_000 // len(mesh.faces))]
    return tried[np.abs(windings(mesh, tried)) > 0.5][:n_eyes]


def rays_outwards(mesh: zo.Mesh, eye: FloatArray, rng: np.random.Generator, n_random: int = 5000) -> FloatArray:
    """Directions from an eye to all corners, to a place on each edge, and anywhere, (n, 3)."""
    a, b, c = mesh.corners.transpose(1, 0, 2)
    begin, end = np.concatenate([a, b, c]), np.concatenate([b, c, a])
    on_edges = begin + rng.random((len(begin), 1)) * (end - begin)
    directions = np.concatenate([np.unique(mesh.corners.reshape(-1, 3), axis=0) - eye, on_edges - eye])
    return np.concatenate([directions[directions.any(axis=1)], rng.normal(size=(n_random, 3))])


def pinhole(width: int, height: int, forward: FloatArray) -> FloatArray:
    """Directions of a picture's pixels, row after row, (height width, 3); the field of view is 53 degrees wide."""
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    u, v = np.meshgrid(np.arange(width) + 0.5 - width / 2, np.arange(height) + 0.5 - height / 2)
    return (forward + (u[..., None] * right + v[..., None] * np.cross(right, forward)) / width).reshape(-1, 3)


def turning(columns: int, elevations: FloatArray) -> FloatArray:
    """Directions of a spinning sensor, ring after ring, (rings columns, 3)."""
    angle = np.linspace(0.0, 2.0 * np.pi, columns, endpoint=False)
    level = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
    rings = [np.cos(e) * level + np.sin(e) * np.array([0.0, 0.0, 1.0]) for e in elevations]
    return np.concatenate(rings)


def meshed(origin: FloatArray, directions: FloatArray, distances: FloatArray, width: int) -> tuple[zo.Mesh, BoolArray]:
    """Mesh a grid of returns by neighbours; return the mesh, and which rays all six neighbours surround."""
    n, rows = len(directions), len(directions) // width
    returned = np.isfinite(distances)
    units = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    vertices = origin + np.where(returned, distances, 0.0)[:, None] * units
    first = (np.arange(rows - 1)[:, None] * width + np.arange(width - 1)).reshape(-1)
    corners = first[:, None] + np.array([[0, 1, width], [1, width + 1, width]]).reshape(-1)
    faces = corners.reshape(-1, 3)
    faces = faces[returned[faces].all(axis=1)]
    around = np.bincount(faces.reshape(-1), minlength=n) == 6
    return zo.Mesh(vertices, faces), around


def surrounded_vertices(mesh: zo.Mesh, eye: FloatArray) -> FloatArray:
    """Vertices (n, 3) all about which faces lie, all of them seen by an eye from one side."""
    _, ids = np.unique(mesh.vertices, axis=0, return_inverse=True)
    faces, n = ids.reshape(-1)[mesh.faces], int(ids.max()) + 1
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    both, inverse, counts = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    balance = np.bincount(inverse.reshape(-1), np.where(edges[:, 0] < edges[:, 1], 1, -1), minlength=len(both))
    is_inner = np.ones(n, dtype=bool)
    is_inner[both[(counts != 2) | (balance != 0)]] = False  # faces that run one way there may be folded over each other
    heights = np.einsum("fi,fi->f", mesh.face_normals, eye - mesh.corners[:, 0])
    sides = np.sign(heights) * (np.abs(heights) > 1e-6 * mesh.areas * mesh.diagonal)
    low, high = np.ones(n), -np.ones(n)
    for corner in faces.T:
        np.minimum.at(low, corner, sides)
        np.maximum.at(high, corner, sides)
    chosen = is_inner & (low == high) & (low != 0.0)
    positions = np.empty((n, 3))
    positions[ids.reshape(-1)] = mesh.vertices
    return positions[chosen]
