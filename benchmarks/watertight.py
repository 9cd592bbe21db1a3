"""Lines that must meet a surface, and how many pass through it: `exact` and `oracle`, with `embree` beside them.

    python benchmarks/watertight.py [--meshes FOLDER ...] [--methods exact embree] [--most-faces 20000] [--seed 0]

Closed meshes, turned and shifted: rays from eyes inside to every corner, to a place on every edge, and anywhere.
Pictures and noise-free scans, meshed again by neighbours: rays of the same picture that all six neighbours surround.
Corners about which all faces are seen from one side. Meshes come from the folders; shapes are built in. Exit status 1
where `exact` or `oracle` let a line through.
"""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from common import DATA, row, run

import zbuf_occlude as zo
from zbuf_occlude.base.errors import OccludeError
from zbuf_occlude.meshes import shapes
from zbuf_occlude.meshes.shapes import solids

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.solids import uv_sphere
from tests.watertight import eyes_inside, is_closed, meshed, pinhole, rays_outwards, surrounded_vertices, turning

SHAPES = [(name, number) for number in (1, 2) for name in shapes.CLASSES][:10]
WIDTH = 320
Lines = tuple[zo.Mesh, np.ndarray, np.ndarray]
"""A mesh, an eye (3,), directions (n, 3) that meet the mesh."""


def main(
    *,
    meshes: Sequence[str] = (str(DATA / "furniture"), str(DATA / "modelnet"), str(DATA / "scans")),
    methods: Sequence[str] = ("exact", "embree"),
    most_faces: int = 20_000,
    seed: int = 0,
) -> int:
    paths = sorted(
        path for folder in meshes for path in Path(folder).rglob("*.*") if path.suffix in (".obj", ".off", ".ply")
    )
    loaded = [mesh for mesh in map(_load, paths) if mesh is not None and len(mesh.faces) <= most_faces]
    row("lines that must meet a surface", "lines", *methods)
    row("---", *["---:"] * (1 + len(methods)))
    leaks = 0
    for name, lines in (
        ("closed meshes, from inside", _from_inside(loaded, seed)),
        ("pictures meshed again", _pictures(loaded[:: max(1, len(loaded) // 3)][:3])),
        ("scans meshed again", _scans(loaded[:: max(1, len(loaded) // 3)][:3])),
        ("corners seen all around", _corners(loaded)),
    ):
        n, passed = 0, dict.fromkeys(methods, 0)
        for mesh, eye, directions in lines:
            n += len(directions)
            for method in methods:
                with zo.prepare(mesh, method) as occluder:
                    passed[method] += int((occluder.first_hits(eye[None], directions).face_ids < 0).sum())
        row(name, f"{n:,}", *(f"{passed[method]:,}" for method in methods))
        leaks += sum(passed[method] for method in methods if method in ("exact", "oracle"))
    return int(leaks > 0)


def _load(path: Path) -> zo.Mesh | None:
    try:
        return zo.load_mesh(path).normalized()
    except OccludeError:
        return None


def _turned(mesh: zo.Mesh, rng: np.random.Generator) -> zo.Mesh:
    return mesh.rotated(np.linalg.qr(rng.normal(size=(3, 3)))[0]).transformed(rng.uniform(0.5, 2.0), rng.normal(size=3))


def _from_inside(loaded: Sequence[zo.Mesh], seed: int) -> Iterator[Lines]:
    rng = np.random.default_rng(seed)
    built_in = [solids.icosphere(level) for level in range(5)] + [solids.box(), uv_sphere(40)]
    for mesh in (_turned(each, rng) for each in [*built_in, *loaded] if is_closed(each)):
        for eye in eyes_inside(mesh, rng):
            yield mesh, eye, rays_outwards(mesh, eye, rng)


def _again(mesh: zo.Mesh, eye: np.ndarray, directions: np.ndarray, width: int) -> Lines:
    with zo.prepare(mesh, "exact") as occluder:
        distances = occluder.first_hits(eye[None], directions).distances
    again, around = meshed(eye, directions, distances, width)
    return again, eye, directions[around]


def _pictures(loaded: Sequence[zo.Mesh]) -> Iterator[Lines]:
    for mesh in [*(shapes.make(*shape).normalized() for shape in SHAPES), *loaded]:
        eye = np.array([1.3, 1.1, 0.9])
        yield _again(mesh, eye, pinhole(WIDTH, 240, -eye), WIDTH)


def _scans(loaded: Sequence[zo.Mesh]) -> Iterator[Lines]:
    rng, elevations = np.random.default_rng(1), np.radians(np.linspace(-25.0, 15.0, 64))
    room = _turned(solids.box(), rng)
    yield _again(room, room.centre + 0.1 * room.longest_side * rng.uniform(-1, 1, 3), turning(900, elevations), 900)
    for mesh in [*(shapes.make(*shape).normalized() for shape in SHAPES), *loaded]:
        yield _again(mesh, np.array([0.9, 0.7, 0.2]), turning(900, elevations), 900)


def _corners(loaded: Sequence[zo.Mesh]) -> Iterator[Lines]:
    for mesh in loaded:
        eye = mesh.centre + np.array([1.1, 1.7, 0.8]) * mesh.longest_side
        vertices = surrounded_vertices(mesh, eye)
        if len(vertices):
            yield mesh, eye, vertices - eye


if __name__ == "__main__":
    run(main, __doc__, methods=[m.name for m in zo.METHODS if not m.ray_casting_unsupported_reason])
