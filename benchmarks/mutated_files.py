"""Give mutated files to the readers: each must be read or refused in one line, soon, whatever was done to it.

    python benchmarks/mutated_files.py meshes [--files 20000] [--random 0] [--keep FOLDER] [--only .glb --only .gltf]
    python benchmarks/mutated_files.py documents

Small sound files, meshes of all formats or sensors, scenes, poses and labels, are cut, doubled, spliced, peppered with
odd numbers and words and, for glTF and JSON, changed in their values. They are read in child processes, so that a crash
or a hang in compiled code is seen and told from an error. Meshes that come out are compared, area and bounds, with what
trimesh makes of the same file, where it makes anything; it errs too (docs/architecture.md), so what differs is counted
and kept to be looked at, and is no failure. Documents that come out are used: a sensor scans, a scene is scanned, a
camera sees, and no warning may come. Exit status 1 after any exception but the package's own, any crash, any file that
took longer than 10 s or a process to more than 1 GB.
"""

import argparse
import logging
import multiprocessing
import os
import random
import sys
import tempfile
import warnings
from collections import Counter
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
from mutations import mutated, sound_documents, sound_files

SLOW, START = 10.0, 120.0
"""Seconds of processor time that a file of some kilobytes may take, and that a child may take to its first."""
BATCH = 2500
"""Files of a child process."""
LARGE = 1e9
"""Bytes of memory that a child may take, itself included."""
FEW = 20_000
"""Rays with which a sensor scans; of one that has more they are made only."""
CRATE = (
    b"OFF\n8 6 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n1 0 1\n1 1 1\n0 1 1\n"
    b"4 0 1 2 3\n4 4 5 6 7\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n"
)
"""A mesh that lies beside each document."""


def read_files(connection: Connection, paths: list[Path], sound: dict[str, list[bytes]]) -> None:
    """In a child: say of each file what came of it."""
    from zbuf_occlude.errors import OccludeError

    logging.disable()  # trimesh's
    with tempfile.TemporaryDirectory() as name:  # compile, or load what is compiled, before anything is measured
        for kind, files in sound.items():
            for number, data in enumerate(files):
                used(written(Path(name, kind, str(number)), kind, data))
    connection.send("ready")
    for path in paths:
        Path("/proc/self/clear_refs").write_text("5")  # the most memory is counted anew
        try:
            said = used(path)
        except OccludeError as error:
            said = (
                "refused"
                if "\n" not in str(error) and len(str(error)) < 2000
                else f"fault: it says {str(error)[:200]!r}"
            )
        except Exception as error:
            said = f"fault: {type(error).__name__}: {str(error)[:200]}"
        most = int(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0]) * 1024
        connection.send(said if most < LARGE else f"fault: it took {most / 1e9:.2f} GB")


def written(folder: Path, kind: str, data: bytes) -> Path:
    """Write a file into a folder of its own, with what belongs beside it, and return its path."""
    folder.mkdir(parents=True)
    path = folder / kind
    if path.stem in ("images", "cameras") and path.suffix in (".txt", ".bin"):
        other = f"{'cameras' if path.stem == 'images' else 'images'}{path.suffix}"
        (folder / other).write_bytes(sound_documents()[other][0])
    (folder / "crate.off").write_bytes(CRATE)
    path.write_bytes(data)
    return path


def used(path: Path) -> str:
    """Read a file and use what it holds."""
    import zbuf_occlude as zo
    from zbuf_occlude.meshes.collection import MeshCollection
    from zbuf_occlude.scenes import Scene
    from zbuf_occlude.scenes.contents import placed_of, read_scene

    if path.stem == "mesh":
        return compared(path, zo.load_mesh(path, up="z"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        what, crate = path.stem, zo.load_mesh(path.parent / "crate.off")
        if what == "labels":
            MeshCollection.from_paths(path.parent / "crate.off", labels=path)
            return "read"
        if what in ("sensor", "scene"):
            sensor = zo.sensors.make(str(path)) if what == "sensor" else zo.sensors.make("pinhole:width=20,height=20")
            scene = Scene.joined(placed_of(read_scene(path), 0.0)) if what == "scene" else crate
            if not len(sensor.rays()) <= FEW:
                return "read, too many rays to scan with"
            pose = zo.sensors.look_at([0.0, -9.0, 0.0], [0.0, 6.0, 0.0])
            numbers = zo.scan(scene, sensor, pose, method="oracle").positions
        else:
            place = path.with_stem("images") if what == "cameras" and path.suffix in (".txt", ".bin") else path
            views = zo.views.parse(str(place)).around(crate.centre, crate.longest_side)
            points = zo.sample_surface(crate, n_points=50)
            with zo.prepare(crate, "oracle") as occluder:
                occluder.visible(points, views.eyes[:4])
            views.select(np.arange(min(4, len(views)))).shows(points.positions)
            numbers = views.poses
        return "read" if np.isfinite(numbers).all() else "fault: what is not finite came through"


def compared(path: Path, mesh: Any) -> str:
    """Hold a mesh against what trimesh reads."""
    import trimesh

    corners = mesh.corners
    if not np.isfinite(corners).all():
        return "fault: what is not finite came through"
    try:
        with np.errstate(all="ignore"):
            theirs = trimesh.load_scene(path, process=False).to_mesh()
            triangles = np.asarray(theirs.vertices, dtype=float)[theirs.faces]
            triangles = triangles[np.isfinite(triangles).all(axis=(1, 2))]
            ours, other = distinct_area(corners), distinct_area(triangles)
            extent = np.ptp(corners.reshape(-1, 3), axis=0), np.ptp(triangles.reshape(-1, 3), axis=0)
    except Exception:
        return "read, trimesh does not"
    same = abs(ours - other) <= 1e-4 * ours + 1e-12 and np.allclose(*extent, rtol=1e-4)
    return "read, and as trimesh has it" if same else "read, and trimesh has another"


def distinct_area(triangles: np.ndarray) -> float:
    """Return the area of triangles, of the same ones once."""
    keys = np.array([sorted(map(tuple, triangle)) for triangle in np.round(triangles, 12).tolist()]).reshape(-1, 9)
    _, first = np.unique(keys, axis=0, return_index=True)
    some = triangles[first]
    return float(np.linalg.norm(np.cross(some[:, 1] - some[:, 0], some[:, 2] - some[:, 0]), axis=1).sum() / 2)


def outcomes(paths: list[Path], sound: dict[str, list[bytes]]) -> list[str]:
    """Read files in a child, in another from wherever one crashes or hangs."""
    found: list[str] = []
    spawn = multiprocessing.get_context("spawn")
    while len(found) < len(paths):
        connection, theirs = spawn.Pipe()
        child = spawn.Process(target=read_files, args=(theirs, paths[len(found) :], sound), daemon=True)
        child.start()
        theirs.close()
        limit = START  # of processor time: on a busy machine a child may have to wait for long
        try:
            while len(found) < len(paths):
                while not connection.poll(0.5):
                    if processor_seconds(child.pid) > limit:
                        raise TimeoutError
                if (said := connection.recv()) != "ready":
                    found.append(said)
                limit = processor_seconds(child.pid) + SLOW
        except EOFError:
            child.join()
            found.append(f"fault: the process ended with {child.exitcode}")
        except TimeoutError:
            found.append(f"fault: it took longer than {SLOW:g} s")
        child.kill()
        child.join()
    return found


def processor_seconds(pid: int | None) -> float:
    """Return the processor time that a process has taken; 0 of one that is gone."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("meshes", "documents"))
    parser.add_argument("--files", type=int, default=20_000)
    parser.add_argument("--random", type=int, default=0, help="seed of the mutations")
    parser.add_argument("--only", action="append", metavar="ENDING")
    parser.add_argument(
        "--keep", type=Path, help="folder for files that are faults, and those that trimesh reads otherwise"
    )
    options = parser.parse_args()
    rng = random.Random(options.random)
    meshes = {f"mesh{suffix}": files for suffix, files in sound_files().items()}
    sound = meshes if options.what == "meshes" else sound_documents()
    sound = {kind: files for kind, files in sound.items() if kind.endswith(tuple(options.only or [""]))}
    kinds = list(sound)
    counts: dict[str, Counter[str]] = {kind: Counter() for kind in kinds}
    faults: list[str] = []
    for first in range(0, options.files, BATCH):
        with tempfile.TemporaryDirectory() as name:
            paths = []
            for number in range(first, min(first + BATCH, options.files)):
                kind = kinds[number % len(kinds)]
                data = mutated(rng.choice(sound[kind]), kind, rng)
                paths.append(written(Path(name, f"{number:06d}"), kind, data))
            for path, outcome in zip(paths, outcomes(paths, sound), strict=True):
                counts[path.name][outcome.split(": ")[0]] += 1
                number = path.parent.name
                if outcome not in ("refused", "read", "read, and as trimesh has it", "read, trimesh does not"):
                    if options.keep:
                        options.keep.mkdir(parents=True, exist_ok=True)
                        (options.keep / f"{number}.{path.name}").write_bytes(path.read_bytes())
                    if not outcome.startswith("read"):
                        faults.append(f"{number}.{path.name}: {outcome}")
    for kind, of_kind in counts.items():
        print(f"{kind}: " + ", ".join(f"{n} {what}" for what, n in sorted(of_kind.items())))
    print("\n".join(faults) or f"no traceback, crash or hang in {options.files} files (seed {options.random})")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())
