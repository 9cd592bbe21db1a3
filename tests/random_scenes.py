"""Random scenes that are hard for visibility: meshes, points and eyes from a seed and a number, and a count of errors.

Soups, slivers, touching and duplicate faces, one huge face beside tiny ones, boxes, spheres, spiky, flat, nested and
self-crossing solids, sheets in one plane and standing on each other. Points near edges, behind corners, far away. Eyes
near, up to 1e12 diagonals away, inside the bounding sphere, on the axes, in the plane of a face and on the line of an
edge. Scales 1e-3 to 1e3, some scenes 1e6 times their size from the origin.
"""

from collections.abc import Callable

import numpy as np

import zbuf_occlude as zo
from tests.rational import first_hit, sees
from zbuf_occlude import Mesh, SurfacePoints, sample_surface
from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.meshes import shapes
from zbuf_occlude.meshes.shapes import refined, solids
from zbuf_occlude.sensors import Sensor, look_at
from zbuf_occlude.visibility.interface import CONTACT, VisibilityQuery
from zbuf_occlude.visibility.methods.oracle import prepare as prepare_oracle

FARTHEST = 12.0
"""Power of ten of the farthest eyes and points, in diagonals of the mesh."""

CONTACTS = (0.0, 1e-7, 1e-5, 1e-3, 1e-2)
"""Contact tolerances that an exact method must be right at."""


def triangles(corners: FloatArray) -> Mesh:
    return Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def soup(rng: np.random.Generator) -> Mesh:
    n = int(rng.integers(1, 500))
    size = 10.0 ** rng.uniform(-2.5, 0.0)
    return triangles(rng.uniform(-1, 1, (n, 1, 3)) + size * rng.normal(size=(n, 3, 3)))


def slivers(rng: np.random.Generator) -> Mesh:
    n, width = int(rng.integers(2, 300)), 10.0 ** rng.uniform(-7.0, -2.0)
    along = rng.normal(size=(n, 1, 3)) * np.array([0.0, 1.0, rng.uniform(0.5, 1.0)])[None, :, None]
    return triangles(rng.uniform(-1, 1, (n, 1, 3)) + along + width * rng.normal(size=(n, 3, 3)))


def touching(rng: np.random.Generator) -> Mesh:
    """Boxes on a coarse grid: they share faces, edges and corners."""
    boxes = []
    for _ in range(int(rng.integers(2, 12))):
        box = solids.box()
        boxes.append(box.corners * rng.integers(1, 3, 3) + rng.integers(-2, 3, 3))
    return triangles(np.concatenate(boxes).astype(np.float64))


def duplicates(rng: np.random.Generator) -> Mesh:
    """Every face twice, some also moved by less or more than the contact tolerance."""
    mesh = soup(rng)
    shift = 10.0 ** rng.uniform(-9.0, -3.0) * rng.normal(size=(len(mesh.faces), 1, 3))
    return triangles(np.concatenate([mesh.corners, mesh.corners[:, [1, 2, 0]], mesh.corners + shift]))


def huge_and_tiny(rng: np.random.Generator) -> Mesh:
    tiny = rng.uniform(-0.5, 0.5, (400, 1, 3)) + 0.01 * rng.normal(size=(400, 3, 3))
    return triangles(np.concatenate([tiny, 50.0 * rng.normal(size=(int(rng.integers(1, 3)), 3, 3))]))


def sphere(rng: np.random.Generator) -> Mesh:
    return solids.icosphere(int(rng.integers(1, 4)))


def spiky(rng: np.random.Generator) -> Mesh:
    """Balls whose vertices are moved in and out: closed, folded sharply, some wound inwards, each for itself sound."""
    balls = []
    for _ in range(int(rng.integers(1, 4))):
        ball = solids.icosphere(int(rng.integers(1, 4)))
        radii = 1.0 + rng.uniform(0.0, 0.9) * rng.uniform(-1.0, 1.0, len(ball.vertices))
        corners = (ball.vertices * radii[:, None])[ball.faces] * rng.uniform(0.2, 1.0) + 0.5 * rng.normal(size=3)
        balls.append(corners[:, ::-1] if rng.random() < 0.3 else corners)
    return triangles(np.concatenate(balls))


def flat(rng: np.random.Generator) -> Mesh:
    """Plates and wedges about as thin as the contact tolerance, and thicker."""
    plate = refined(solids.box(), 200).vertices.copy()
    faces = refined(solids.box(), 200).faces
    plate[:, 2] *= 10.0 ** rng.uniform(-6.0, -1.0)
    if rng.random() < 0.5:
        plate[:, 2] *= plate[:, 0] - plate[:, 0].min() + 10.0 ** rng.uniform(-5.0, -1.0)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return triangles((plate @ turn)[faces])


def crossed(rng: np.random.Generator) -> Mesh:
    """A ball that is mirrored beyond a plane, and so crosses itself, in or beside another."""
    ball = solids.icosphere(3)
    at = rng.uniform(-0.9, 0.9)
    mirrored = ball.vertices * np.where([True, False, False], ball.vertices[:, 2:] - at, 1.0)
    other = ball.vertices * rng.uniform(0.2, 0.6) + rng.uniform(0.0, 1.0, 3)
    return triangles(np.concatenate([mirrored[ball.faces], other[ball.faces]]))


def bodies(rng: np.random.Generator) -> Mesh:
    """Furniture and vehicles of parts that touch or run through each other, with some faces missing or wound anyhow."""
    name = SHAPES[rng.integers(len(SHAPES))]
    mesh = shapes.make(name, int(rng.integers(1000)))
    faces = mesh.faces[rng.random(len(mesh.faces)) > rng.choice([0.0, 0.0, 0.01])]
    some = rng.random(len(faces)) < rng.choice([0.0, 0.3])
    faces[some] = faces[some][:, ::-1]
    return Mesh(mesh.vertices, faces)


def waves(rng: np.random.Generator) -> Mesh:
    """Sheets in waves, one above the other, which fold back as seen from most sides, and end."""
    n, corners = int(rng.integers(4, 20)), []
    u, v = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n), indexing="ij")
    for _ in range(int(rng.integers(1, 3))):
        a, b, c = rng.uniform(0.0, 6.0, 3)
        sheet = np.stack([u + 0.3 * np.sin(b * v), v, 0.5 * np.sin(a * u + c) * np.cos(b * v)], axis=-1)
        sheet = (sheet + rng.normal(0.0, 0.3, 3)).reshape(-1, 3)
        first = (n * np.arange(n - 1)[:, None] + np.arange(n - 1)).reshape(-1)
        faces = np.concatenate([first[:, None] + [0, 1, n], first[:, None] + [1, n + 1, n]])
        corners.append(sheet[faces])
    return triangles(np.concatenate(corners))


def folds(rng: np.random.Generator) -> Mesh:
    """An open sheet folded once or more, sharply: leaves over each other that share an edge, or but a corner."""
    n, angle = int(rng.integers(2, 8)), np.radians(10.0 ** rng.uniform(-1.0, 1.3))
    u, v = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1), indexing="ij")
    first = ((n + 1) * np.arange(n)[:, None] + np.arange(n)).reshape(-1)
    faces = np.concatenate([first[:, None] + [0, 1, n + 1], first[:, None] + [1, n + 2, n + 1]])
    leaves = []
    for i in range(int(rng.integers(2, 4))):
        along = u * np.where(rng.random() < 0.5, 1.0, v)  # a leaf, or one that narrows to a corner
        sheet = np.stack([along * np.cos(i * angle), v, along * np.sin(i * angle)], axis=-1)
        leaves.append(sheet.reshape(-1, 3)[faces])
    corners = np.concatenate(leaves)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return triangles(corners[area > 1e-9])


def coplanar(rng: np.random.Generator) -> Mesh:
    """Sheets of a few faces in two or three planes, side by side, overlapping, and standing on each other's edges."""
    n, sheets = int(rng.integers(1, 4)), []
    u, v = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1), indexing="ij")
    first = ((n + 1) * np.arange(n)[:, None] + np.arange(n)).reshape(-1)
    faces = np.concatenate([first[:, None] + [0, 1, n + 1], first[:, None] + [1, n + 2, n + 1]])
    for _ in range(int(rng.integers(2, 7))):
        sheet = np.stack([u, v, np.zeros_like(u)], axis=-1).reshape(-1, 3)[faces]
        sheets.append(np.roll(sheet, rng.integers(3), axis=2) + rng.integers(-1, 2, 3))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0] if rng.random() < 0.7 else np.eye(3)
    return triangles(np.concatenate(sheets) @ turn)


KINDS = (
    soup,
    slivers,
    touching,
    duplicates,
    huge_and_tiny,
    sphere,
    spiky,
    flat,
    crossed,
    bodies,
    waves,
    folds,
    coplanar,
)
SHAPES = ("table", "chair", "lamp", "car", "airplane")


def eyes_about(mesh: Mesh, points: SurfacePoints, rng: np.random.Generator) -> FloatArray:
    """Eyes about the mesh, far, inside, on an axis; others near it.

    A hair above a point; in a face's plane, on an edge's line; beside a corner and almost in the plane of its face.
    """
    directions = rng.normal(size=(6, 3))
    directions[5] = np.eye(3)[rng.integers(3)] * rng.choice([-1.0, 1.0])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    reach = mesh.diagonal * np.array([rng.uniform(0.6, 2.0), 4.0, 10.0 ** rng.uniform(1, FARTHEST), 0.3, 0.0, 2.0])
    eyes = mesh.centre + reach[:, None] * directions
    k = rng.integers(len(points))
    eyes[4] = points.positions[k] + 10.0 ** rng.uniform(-5, -1) * mesh.diagonal * points.normals[k]
    a, b, c = mesh.corners[rng.integers(len(mesh.faces))]
    along, other = _unit(b - a), _unit(c - a)
    angle, away = rng.uniform(0.0, 2.0 * np.pi), mesh.diagonal * rng.uniform(1.0, 4.0)
    sideways = _unit(np.cos(angle) * along + np.sin(angle) * other)
    size = float(np.linalg.norm(b - a))
    beside = a + size * (
        10.0 ** rng.uniform(-6, -1) * sideways + 10.0 ** rng.uniform(-10, -5) * _unit(np.cross(along, other))
    )
    return np.concatenate([eyes, [a + away * sideways, a + away * along, beside]])


def _unit(vector: FloatArray) -> FloatArray:
    return vector / max(float(np.linalg.norm(vector)), 1e-300)


def near_edges(mesh: Mesh, points: SurfacePoints, rng: np.random.Generator) -> SurfacePoints:
    """Move half of the points towards an edge or a corner of their face, to 1e-7 to 1e-3 diagonals."""
    corners = mesh.corners[points.face_ids]
    weights = rng.dirichlet([1.0, 1.0, 1.0], len(points))
    weights[:, 1] *= rng.random(len(points)) > 0.3
    weights /= weights.sum(axis=1, keepdims=True)
    target = (corners * np.where(rng.random((len(points), 1)) < 0.7, [1.0, 0.0, 0.0], weights)[..., None]).sum(axis=1)
    away = points.positions - target
    lengths = np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-300)
    near = np.minimum(10.0 ** rng.uniform(-7.0, -3.0, (len(points), 1)) * mesh.diagonal, lengths)
    moved = np.where(rng.random((len(points), 1)) < 0.5, target + away * near / lengths, points.positions)
    return SurfacePoints(moved, points.face_ids, points.normals)


def behind_corners(mesh: Mesh, points: SurfacePoints, eye: FloatArray, rng: np.random.Generator) -> SurfacePoints:
    """Move a tenth of the points behind a corner or a place on an edge, as an eye sees it, to the last digit."""
    positions, face_ids = points.positions.copy(), points.face_ids.copy()
    moved = rng.random(len(points)) < 0.1
    a, b, _ = mesh.corners[rng.integers(len(mesh.faces), size=moved.sum())].transpose(1, 0, 2)
    aim = np.where(rng.random((len(a), 1)) < 0.5, a, a + rng.random((len(a), 1)) * (b - a))
    positions[moved] = eye + (aim - eye) * (1.0 + 10.0 ** rng.uniform(-3, 1, (len(a), 1)))
    face_ids[moved] = -1
    return SurfacePoints(positions, face_ids, points.normals)


def scene(seed: int, index: int) -> tuple[Mesh, SurfacePoints, FloatArray, str]:
    """Make one scene; the same numbers give the same scene."""
    rng = np.random.default_rng([seed, index])
    kind = KINDS[index % len(KINDS)]
    mesh = kind(rng)
    scale = 10.0 ** rng.uniform(-3.0, 3.0)
    away = 10.0 if rng.random() < 0.8 else 1e6
    mesh = mesh.transformed(scale, scale * rng.uniform(-away, away, 3))
    points = sample_surface(mesh, n_points=int(rng.integers(50, 400)), seed=rng)
    if rng.random() < 0.5:
        points = near_edges(mesh, points, rng)
    if rng.random() < 0.2:
        reach = mesh.diagonal * 10.0 ** rng.choice([0.0, rng.uniform(-3.0, FARTHEST)], (200, 1))
        points = SurfacePoints.free(mesh.centre + reach * rng.normal(size=(200, 3)))
        points = SurfacePoints(points.positions, points.face_ids, np.tile([0.0, 0.0, 1.0], (200, 1)))
    eyes = eyes_about(mesh, points, rng)
    return mesh, behind_corners(mesh, points, eyes[rng.integers(len(eyes))], rng), eyes, kind.__name__


def wrong_answers(
    prepare: Callable[..., VisibilityQuery], seed: int, index: int, contact: float = CONTACT, n_checked: int = 40
) -> tuple[int, int]:
    """Count, for one scene, pairs of eye and point answered unlike rational arithmetic, and how many were asked.

    `prepare` is asked as ``prepare(mesh, contact=contact)``. Answers that the oracle disagrees with are all checked, of
    the others `n_checked`.
    """
    mesh, points, eyes, _ = scene(seed, index)
    oracle = prepare_oracle(mesh, contact=contact)
    with prepare(mesh, contact=contact) as occluder:
        answer = occluder.visible(points, eyes)
    disputed = answer != oracle.visible(points, eyes)
    some = np.random.default_rng([seed, index, 2]).integers(answer.size, size=n_checked)
    checked = np.union1d(np.flatnonzero(disputed), some)
    return sum(
        sees(mesh, eyes[k], points.positions[i], int(points.face_ids[i]), oracle.contact) != answer[k, i]
        for k, i in zip(*np.unravel_index(checked, answer.shape), strict=True)
    ), answer.size


def wrong_answers_of(method: str, seed: int, index: int, contact: float = CONTACT) -> tuple[int, int]:
    """Count for a method of the table."""
    return wrong_answers(lambda mesh, contact: zo.prepare(mesh, method, contact=contact), seed, index, contact)


def rays_of(seed: int, index: int) -> tuple[Mesh, FloatArray, FloatArray]:
    """Make rays into one scene, (n, 3) each: fans from its eyes; to points, corners, edges; along axes; anyhow."""
    mesh, points, eyes, _ = scene(seed, index)
    rng = np.random.default_rng([seed, index, 1])
    corners = mesh.corners[rng.integers(len(mesh.faces), size=40)]
    targets = np.concatenate([points.positions[:100], corners[:, 0], 0.5 * (corners[:, 0] + corners[:, 1])])
    origins = eyes[rng.integers(len(eyes), size=len(targets) + 60)]
    directions = rng.normal(size=origins.shape)
    directions[: len(targets)] = targets - origins[: len(targets)]
    axes = rng.random(len(origins)) < 0.1
    directions[axes] = np.eye(3)[rng.integers(3, size=axes.sum())] * rng.choice([-1.0, 1.0], (axes.sum(), 1))
    for k in range(len(eyes)):
        fan = fan_of(targets[rng.integers(len(targets))] - eyes[k], 10.0 ** rng.uniform(-4.0, 0.0), rng)
        origins, directions = (
            np.concatenate([np.tile(eyes[k], (len(fan), 1)), origins]),
            np.concatenate([fan, directions]),
        )
    lengths = np.linalg.norm(directions, axis=1)
    some = lengths > 0.0
    return mesh, origins[some], directions[some] * 10.0 ** rng.uniform(-3, 3, (some.sum(), 1))


def fan_of(towards: FloatArray, width: float, rng: np.random.Generator) -> FloatArray:
    """Eight rows of 32 directions about one, this wide; some rows so narrow that they are all but one direction."""
    axis = _unit(towards) if towards.any() else np.array([0.0, 0.0, 1.0])
    across = _unit(np.cross(axis, rng.normal(size=3)))
    u, v = np.meshgrid(np.linspace(-width, width, 8), np.linspace(-width, width, 32), indexing="ij")
    v[rng.random(8) < 0.1] *= 1e-6
    return (axis + u[..., None] * np.cross(axis, across) + v[..., None] * across).reshape(-1, 3)


def wrong_rays_of(method: str, seed: int, index: int, n_checked: int = 40) -> tuple[int, int]:
    """Count, for one scene, rays answered unlike rational arithmetic, and how many were asked.

    Each ray is asked twice: among all, and among those that begin where it does. Rays that the oracle answers otherwise
    are all checked, of the others `n_checked`. The face must be the same, and the distance within 1e-8.
    """
    mesh, origins, directions = rays_of(seed, index)
    truth = prepare_oracle(mesh).first_hits(origins, directions)
    begins, which = np.unique(origins, axis=0, return_inverse=True)
    groups = [(origins, np.arange(len(origins)))]
    groups += [(begins[k : k + 1], np.flatnonzero(which.ravel() == k)) for k in range(len(begins))]
    some = np.random.default_rng([seed, index, 3]).integers(len(directions), size=n_checked)
    wrong = np.zeros(len(directions), dtype=bool)
    with zo.prepare(mesh, method) as occluder:
        for begin, mine in groups:
            found = occluder.first_hits(begin, directions[mine])
            checked = (found.face_ids != truth.face_ids[mine]) | np.isin(mine, some)
            for i in np.flatnonzero(checked):
                face, t = first_hit(mesh, origins[mine[i]], directions[mine[i]])
                distance = float(t) * float(np.linalg.norm(directions[mine[i]])) if face >= 0 else np.inf
                same = face == found.face_ids[i] and np.isclose(found.distances[i], distance, rtol=1e-8, atol=0.0)
                wrong[mine[i]] |= not same
    return int(wrong.sum()), len(directions)


def wrong_returns_of(method: str, seed: int, index: int) -> tuple[int, int]:
    """Count, for one scene scanned by two eyes, returns unlike the oracle's, and the oracle's.

    A return differs that only one of the two scans has, or of which they name another face.
    """
    mesh, _, eyes, _ = scene(seed, index)
    rng = np.random.default_rng([seed, index])
    baseline = rng.normal(size=3) * mesh.diagonal * 0.2
    directions = np.concatenate([np.full((150, 1), 1.0), rng.uniform(-0.5, 0.5, (150, 2))], axis=1)
    sensor = Sensor("random", "list", {"directions": directions.tolist()}).with_numbers(
        baseline=baseline.tolist(), noise=0
    )
    pose = look_at(eyes[0], mesh.centre)
    both = np.stack([np.full(len(directions), -1)] * 2)
    for faces, name in zip(both, (method, "oracle"), strict=True):
        found = zo.scan(mesh, sensor, pose, method=name)
        faces[found.columns] = found.face_ids
    return int((both[0] != both[1]).sum()), int((both[1] >= 0).sum())
