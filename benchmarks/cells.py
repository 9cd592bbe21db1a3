"""`exact` against ray casters, in a table of cells: a scene of 1,000 to 10,000,000 faces, and what is asked of it.

    python benchmarks/cells.py [FOLDER] [--quick] [--scene PATTERN ...] [--question PATTERN ...] [--repeats 3]
                               [--peer NAME ...] [--tinybvh LIBRARY] [--processors] [--isa avx512|avx2|sse]
                               [--out cells.png]

Scenes are meshes of FOLDER (default: furniture/ in ZBUF_OCCLUDE_DATA), the larger ones subdivided; a terrain; a street
of such meshes. Asked are points from eyes, and first hits: of a picture, of a LiDAR's turn, of rays in no order.
--quick takes a few of both, --scene and --question those whose names match, as *. Each repetition builds all sides from
arrays, and asks all sides each question in turn; rays are cast `RAY_REPEATS` times. Medians count, of the building and
of the answers apart. A cell is *fresh* with the building, else *again*. Its ratio is that of the fastest peer's seconds
to those of `exact`. Peers' rays are made beforehand, which is not counted. Of more than `MAX_PAIRS` pairs of point and
eye, peers answer some eyes, and are taken to be as fast with all. --processors takes seconds of all threads instead of
the clock's: a busy machine changes them less.

--isa limits `exact`, by numba's settings, to an instruction set that the processor has. The peers always take the best
one: their Embree is built without a configuration file, and neither Open3D nor embreex hands it one.

Peers are Open3D, embreex in robust mode on as many threads, Mitsuba's LLVM variants where mitsuba and LLVM are there,
and tinybvh by a library that exports C functions, rays being (n, 7) float32 of origin, direction and length:

    void *build(const float *vertices, const uint32_t *faces, int64_t n_faces);
    void occluded(void *bvh, const float *rays, int64_t n, uint8_t *hidden);
    void first(void *bvh, const float *rays, int64_t n, int32_t *faces);
    void release(void *bvh);
"""

import ctypes
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from fnmatch import fnmatch
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh
from common import DATA, SHORT_OF, Open3D, heads, row, run
from llvmlite import binding
from matplotlib.colors import TwoSlopeNorm

import zbuf_occlude as zo
from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.cores import n_cores
from zbuf_occlude.drawing.pictures import canvas

MAX_PAIRS = 2_000_000
EYES_AWAY = 2.0
"""Distance of eyes from the middle, in longest sides."""
QUICK = (
    ("furniture 10,000", "furniture 100,000", "terrain 200,000", "terrain 2,000,000"),
    ("2,000 x 1", "50,000 x 10", "picture", "turn", "no order"),
)
"""Names of the scenes and questions that --quick asks."""


ISAS: dict[str, tuple[str, ...]] = {"avx512": (), "avx2": ("avx512",), "sse": ("avx", "fma", "f16c", "vaes")}
"""Instruction sets, and how the names of the processor features begin that each lacks."""


class Scene(NamedTuple):
    name: str
    mesh: Callable[[], zo.Mesh]
    stand: tuple[float, float, float]  # where a sensor stands, from the middle, in longest sides


class Question(NamedTuple):
    """Points and eyes, or rays."""

    name: str
    n_points: int
    n_eyes: int
    rays: Callable[[zo.Mesh, FloatArray], tuple[FloatArray, FloatArray]] | None = None  # of a mesh and a stand


# Scenes


def subdivided(mesh: zo.Mesh, n_faces: int) -> zo.Mesh:
    """Divide each face into four, until there are this many or almost."""
    vertices, faces = mesh.vertices, mesh.faces
    while len(faces) * 2 < n_faces:
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    return zo.Mesh(vertices, faces)


def terrain(n_faces: int) -> zo.Mesh:
    """Make hills of many sizes over a square."""
    n = round((n_faces / 2) ** 0.5)
    rng, (x, y) = np.random.default_rng(0), np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n))
    z = np.zeros_like(x)
    for octave in range(1, 9):
        a, b, c, d = rng.uniform(-2.0, 2.0, 4) * 2.0**octave
        z += 0.1 * 0.55**octave * (np.sin(a * x + b * y + c) + np.sin(c * x - d * y + a))
    first = (n * np.arange(n - 1)[:, None] + np.arange(n - 1)).reshape(-1, 1)
    faces = np.concatenate([first + np.array([0, 1, n]), first + np.array([1, n + 1, n])])
    return zo.Mesh(np.stack([x, y, z], axis=-1).reshape(-1, 3), faces)


def street(files: list[Path], n_faces: int) -> zo.Mesh:
    """Scatter meshes, 4 m long each, from 6 to 60 m about the middle of a ground, until there are this many faces."""
    rng, parts, n = np.random.default_rng(0), [], 0
    while n < n_faces:
        mesh = zo.load_mesh(files[len(parts) % len(files)]).normalized()
        turn, place, away = rng.uniform(0, 2 * np.pi), rng.uniform(0, 2 * np.pi), rng.uniform(6, 60)
        rotation = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
        parts.append(4.0 * mesh.corners @ rotation.T + [away * np.cos(place), away * np.sin(place), 0.0])
        n += len(mesh.faces)
    ground = np.array([[-80.0, -80, -2], [80, -80, -2], [80, 80, -2], [-80, 80, -2]])
    corners = np.concatenate([*parts, ground[[[0, 1, 2], [0, 2, 3]]]])
    return zo.Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def scenes(folder: Path) -> list[Scene]:
    files = sorted(path for path in folder.rglob("*") if path.suffix in {".obj", ".off", ".ply", ".stl", ".glb"})

    def real(n_faces: int) -> zo.Mesh:
        sizes = np.array([len(zo.load_mesh(path).faces) for path in files])
        start = n_faces / 4.0 ** max(0, round(np.log(n_faces / sizes.max()) / np.log(4.0)))
        return subdivided(zo.load_mesh(files[int(np.abs(np.log(sizes / start)).argmin())]), n_faces)

    hundreds = [10**digits for digits in range(3, 8)]
    return [  # a mesh is made when it is its turn
        *(Scene(f"furniture {n:,}", partial(real, n), (0.9, 0.1, 0.2)) for n in hundreds),
        *(Scene(f"terrain {n:,}", partial(terrain, n), (0.0, 0.0, 0.15)) for n in (200_000, 2_000_000, 8_000_000)),
        *(Scene(f"street {n:,}", partial(street, files, n), (0.0, 0.0, 0.0)) for n in (30_000, 1_000_000)),
    ]


# Questions


def picture(mesh: zo.Mesh, stand: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cast the rays of a 640 x 480 camera, f 575, from 1.8 longest sides away."""
    x, y = np.meshgrid(np.arange(640) - 319.5, np.arange(480) - 239.5)
    forward, right, up = np.array([[-0.8, 0.0, -0.6], [0.0, -1.0, 0.0], [-0.6, 0.0, 0.8]])
    directions = 575.0 * forward + x[..., None] * right - y[..., None] * up
    return (mesh.centre - 1.8 * mesh.longest_side * forward)[None], directions.reshape(-1, 3)


def turn(mesh: zo.Mesh, stand: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cast a turn of a VLS-128 in steps of 0.2 degrees."""
    return stand[None], zo.sensors.make("vls-128", columns=1800).rays().directions.reshape(-1, 3)


def anyhow(mesh: zo.Mesh, stand: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cast 76,800 rays from anywhere about the mesh to anywhere within its box."""
    places = np.random.default_rng(0).uniform(-0.5, 0.5, (2, 76_800, 3)) * np.ptp(mesh.bounds, axis=0)
    origins = mesh.centre + 1.5 * places[0]
    return origins, mesh.centre + places[1] - origins


QUESTIONS = (
    *(Question(f"{n:,} x {k}", n, k) for n in (2_000, 50_000, 500_000) for k in (1, 10, 100)),
    Question("picture", 0, 0, picture),
    Question("turn", 0, 0, turn),
    Question("no order", 0, 0, anyhow),
)


# Sides: each is built from a mesh, turns rays into what it takes, and says what they meet


class Embreex:
    pool = ThreadPoolExecutor(n_cores())

    def __init__(self, mesh: zo.Mesh) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self.scene = EmbreeScene(robust=True)
        TriangleMesh(self.scene, mesh.vertices.astype(np.float32), mesh.faces)
        self.first(self.rays(np.zeros((1, 3)), np.ones((1, 3))))  # builds

    def rays(self, origins: FloatArray, directions: FloatArray) -> Any:
        rays = np.broadcast_to(origins, directions.shape), directions, np.full(len(directions), SHORT_OF)
        blocks = range(0, len(directions), 4096)
        return [tuple(np.array(each[i : i + 4096], dtype="f4") for each in rays) for i in blocks]

    def occluded(self, rays: Any) -> np.ndarray:
        answers = self.pool.map(lambda each: self.scene.run(*each, query="OCCLUDED"), rays)
        return np.concatenate(list(answers)) >= 0

    def first(self, rays: Any) -> np.ndarray:
        return np.concatenate(list(self.pool.map(lambda each: self.scene.run(*each[:2]), rays)))


class Mitsuba:
    def __init__(self, mesh: zo.Mesh) -> None:
        import drjit
        import mitsuba

        mitsuba.set_variant("llvm_ad_rgb")
        self.mitsuba, self.drjit = mitsuba, drjit
        mine = mitsuba.Mesh("mesh", vertex_count=len(mesh.vertices), face_count=len(mesh.faces))
        parameters = mitsuba.traverse(mine)
        parameters["vertex_positions"] = mesh.vertices.astype(np.float32).ravel()
        parameters["faces"] = mesh.faces.astype(np.uint32).ravel()
        parameters.update()
        self.scene = mitsuba.load_dict({"type": "scene", "mesh": mine})

    def rays(self, origins: FloatArray, directions: FloatArray) -> Any:
        starts = np.broadcast_to(origins, directions.shape)
        mine = self.mitsuba.Ray3f(o=starts.T.astype("f4"), d=directions.T.astype("f4"))
        self.drjit.eval(mine)
        return mine

    def occluded(self, rays: Any) -> np.ndarray:
        return self.scene.ray_test(self.mitsuba.Ray3f(rays, SHORT_OF)).numpy()

    def first(self, rays: Any) -> np.ndarray:
        found = self.scene.ray_intersect_preliminary(rays)
        return np.where(found.is_valid().numpy(), found.prim_index.numpy().astype(np.int32), -1)


class TinyBvh:
    library: Any = None

    def __init__(self, mesh: zo.Mesh) -> None:
        self.arrays = mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32)
        self.bvh = ctypes.c_void_p(self.library.build(*(_at(array) for array in self.arrays), _long(len(mesh.faces))))

    def __del__(self) -> None:
        self.library.release(self.bvh)

    def rays(self, origins: FloatArray, directions: FloatArray) -> Any:
        starts, lengths = np.broadcast_to(origins, directions.shape), np.full((len(directions), 1), SHORT_OF)
        return np.concatenate([starts, directions, lengths], axis=1, dtype="f4")

    def occluded(self, rays: Any) -> np.ndarray:
        answer = np.empty(len(rays), dtype=np.uint8)
        self.library.occluded(self.bvh, _at(rays), _long(len(rays)), _at(answer))
        return answer.view(bool)

    def first(self, rays: Any) -> np.ndarray:
        answer = np.empty(len(rays), dtype=np.int32)
        rays[:, 6] = np.inf
        self.library.first(self.bvh, _at(rays), _long(len(rays)), _at(answer))
        return answer


_long = ctypes.c_int64


def _at(array: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


PEERS: dict[str, Any] = {"open3d": Open3D, "embreex": Embreex, "mitsuba": Mitsuba, "tinybvh": TinyBvh}


def present(names: Sequence[str], library: Path | None) -> dict[str, Any]:
    """Return the peers that are here, and say which are not and why."""
    found = {}
    if library:
        TinyBvh.library = ctypes.CDLL(str(library))
        TinyBvh.library.build.restype = ctypes.c_void_p
    for name in names:
        try:
            if name == "tinybvh" and not library:
                raise ImportError("--tinybvh names no library")
            side = PEERS[name](zo.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
            rays = side.rays(np.ones((1, 3)), -np.ones((9, 3)))
            side.occluded(rays)  # compiles, where it has to
            side.first(rays)
        except Exception as error:
            print(f"left out: {name} ({error})")
        else:
            found[name] = PEERS[name]
    return found


# Instruction sets


def limit_to(isa: str) -> None:
    """Start this program again, `exact` limited to an instruction set, unless it is already."""
    if os.environ.get("CELLS_ISA") == isa:
        return
    features = binding.get_host_cpu_features()
    if isa == "avx512" and not features.get("avx512f"):
        raise SystemExit("error: this processor has no AVX-512.")
    kept = (f"{'+' if there and not name.startswith(ISAS[isa]) else '-'}{name}" for name, there in features.items())
    limits = {"CELLS_ISA": isa, "NUMBA_CPU_FEATURES": ",".join(kept)}
    raise SystemExit(subprocess.call([sys.executable, *sys.argv], env={**os.environ, **limits}))


def processor() -> str:
    """Return the name of the processor."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "unknown")


# Measuring


RAY_REPEATS = 5
"""Times that the sides cast rays in a repetition, in turn: a call takes milliseconds, and one differs from another by
half."""


class Cell(NamedTuple):
    scene: str
    question: str
    seconds: dict[str, float]  # of each side
    agree: float  # least share of answers that a peer has in common with `exact`

    @property
    def ratio(self) -> float:
        """Of the fastest peer that is in PyPI; where there is none, of the fastest."""
        peers = {name: seconds for name, seconds in self.seconds.items() if name != "exact"}
        return min(peers[name] for name in peers if name != "tinybvh" or len(peers) == 1) / self.seconds["exact"]


def cells_of(
    scene: Scene, questions: list[Question], peers: dict[str, Any], repeats: int, clock: Any
) -> Iterator[Cell]:
    """Measure the cells of one scene."""
    mesh = scene.mesh()
    stand = mesh.centre + mesh.longest_side * np.array(scene.stand)
    times: dict[tuple[str, str], list[float]] = {}
    agree = dict.fromkeys((question.name for question in questions), 1.0)

    def timed(what: str, side: str, call: Callable[[], Any]) -> Any:
        began = clock()
        result = call()
        times.setdefault((what, side), []).append(clock() - began)
        return result

    for _ in range(repeats):
        fresh = zo.Mesh(mesh.vertices, mesh.faces)  # nothing measured yet
        occluder = timed("build", "exact", partial(zo.prepare, fresh, "exact"))
        sides = {name: timed("build", name, partial(peer, mesh)) for name, peer in peers.items()}
        for question in questions:
            name = question.name
            if question.rays:
                origins, directions = question.rays(mesh, stand)
                rays = {side: each.rays(origins, directions) for side, each in sides.items()}
                for _ in range(RAY_REPEATS):
                    ours = timed(name, "exact", partial(occluder.first_hits, origins, directions)).face_ids
                    for side, each in sides.items():
                        theirs = timed(name, side, partial(each.first, rays[side]))
                        agree[name] = min(agree[name], float((theirs == ours).mean()))
                continue
            points = zo.sample_surface(mesh, n_points=question.n_points, seed=0)
            eyes = mesh.centre + mesh.longest_side * zo.views.fibonacci(question.n_eyes, distance=EYES_AWAY).eyes
            some = range(0, len(eyes), -(-len(eyes) * len(points) // MAX_PAIRS))
            ours = timed(name, "exact", partial(occluder.visible, points, eyes))
            for side, each in sides.items():
                spent = 0.0
                for k in some:
                    rays = each.rays(eyes[k : k + 1], points.positions - eyes[k])
                    theirs = timed("one", side, partial(each.occluded, rays))
                    spent += times["one", side].pop()
                    agree[name] = min(agree[name], float((theirs != ours[k]).mean()))
                times.setdefault((name, side), []).append(spent * len(eyes) / len(some))
        occluder.close()

    def medians(name: str, builds: float) -> dict[str, float]:
        asked = {side: times.get((name, side), [0.0]) for side in ("exact", *peers)}
        return {side: float(builds * np.median(times["build", side]) + np.median(asked[side])) for side in asked}

    for kind, builds in (("fresh", 1.0), ("again", 0.0)):
        for question in questions:
            if builds or question.rays:
                name = f"{question.name}, {kind}" if question.rays else question.name
                yield Cell(scene.name, name, medians(question.name, builds), agree[question.name])
    yield Cell(scene.name, "prepare", medians("", 1.0), 1.0)


def draw(cells: list[Cell], path: Path) -> None:
    """Draw the ratios as a heat map: blue where `exact` is ahead."""
    rows, columns = (list(dict.fromkeys(cell[i] for cell in cells)) for i in (0, 1))
    figure, (axes,) = canvas(3.0 + 0.75 * len(columns), 1.8 + 0.42 * len(rows))
    axes.grid(visible=False)
    grid = np.full((len(rows), len(columns)), np.nan)
    for cell in cells:
        at = rows.index(cell.scene), columns.index(cell.question)
        grid[at] = np.log2(cell.ratio)
        axes.text(at[1], at[0], f"{cell.ratio:.2g}", ha="center", va="center", fontsize=8)
    axes.imshow(grid, cmap="RdBu", norm=TwoSlopeNorm(0.0, -2.0, 4.0), aspect="auto", alpha=0.8)
    axes.set_xticks(range(len(columns)), columns, rotation=45, ha="right", fontsize=8)
    axes.set_yticks(range(len(rows)), rows, fontsize=8)
    axes.set_title("times as fast as the fastest peer", fontsize=10, loc="left")
    figure.savefig(path, dpi=110)


def report(cells: list[Cell], sides: list[str]) -> None:
    """Print a table of Markdown, the worst cell first, and what the cells come to."""
    print()
    heads("scene, faces", "points x eyes, or rays", "ratio", *(f"{side} ms" for side in sides), "agree", words=2)
    for cell in sorted(cells, key=lambda cell: cell.ratio):
        times = (f"{1e3 * cell.seconds[side]:.4g}" for side in sides)
        row(cell.scene, cell.question, f"**{cell.ratio:.2f}**", *times, f"{cell.agree:.4f}")
    for kind in dict.fromkeys(cell.question.partition(",")[0] if cell.question[0].isalpha() else "x" for cell in cells):
        ratios = [cell.ratio for cell in cells if (f" {kind} " in cell.question) or cell.question.startswith(kind)]
        name = "points x eyes" if kind == "x" else kind
        print(f"\n{name}: median {np.median(ratios):.2f}, worst {min(ratios):.2f}", end="")
    print()


def chosen(things: Sequence[Any], patterns: Sequence[str]) -> list[Any]:
    return [thing for thing in things if not patterns or any(fnmatch(thing.name, pattern) for pattern in patterns)]


def main(
    folder: Path = DATA / "furniture",
    *,
    quick: bool = False,
    scene: Sequence[str] = (),
    question: Sequence[str] = (),
    peer: Sequence[str] = tuple(PEERS),
    repeats: int = 3,
    processors: bool = False,
    isa: str = "",
    tinybvh: Path | None = None,
    out: Path | None = None,
) -> None:
    if isa:
        limit_to(isa)
    best = "AVX-512" if binding.get_host_cpu_features().get("avx512f") else "the best instruction set"
    print(f"{processor()}, {n_cores()} cores, {isa or best}")
    peers = present(peer, tinybvh)
    usual = QUICK if quick else ((), ())
    questions = chosen(QUESTIONS, question or usual[1])
    warm_up = Scene("", partial(terrain, 50_000), (0.0, 0.0, 0.1))
    some = [question._replace(n_points=min(question.n_points, 5000)) for question in questions]
    list(cells_of(warm_up, [*some, QUESTIONS[0]._replace(name="", n_points=9)], {}, 1, time.perf_counter))  # compiles
    clock = time.process_time if processors else time.perf_counter
    cells: list[Cell] = []
    for each in chosen(scenes(folder), scene or usual[0]):
        cells += cells_of(each, questions, peers, repeats, clock)
        print(f"{each.name}: {min(cell.ratio for cell in cells if cell.scene == each.name):.2f}", file=sys.stderr)
    report(cells, ["exact", *peers])
    if out:
        draw(cells, out)


if __name__ == "__main__":
    run(main, __doc__, peer=PEERS, isa=ISAS)
