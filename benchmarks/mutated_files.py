"""Give mutated mesh files to the readers: each must be a mesh or one clear error, soon, whatever was done to it.

    python benchmarks/mutated_files.py [--files 20000] [--random 0] [--keep FOLDER] [--only .glb --only .gltf]

Small sound files of all formats are cut, doubled, spliced, peppered with odd numbers and, for glTF, changed in their
JSON. They are read in child processes, so that a crash or a hang in compiled code is seen and told from an error.
Meshes that come out are compared, area and bounds, with what trimesh makes of the same file, where it makes anything;
it errs too (docs/architecture.md), so what differs is counted and kept to be looked at, and is no failure. Exit status
1 after any exception but MeshError, any crash, any file that took longer than 10 s.
"""

import argparse
import logging
import multiprocessing
import os
import random
import sys
import tempfile
from collections import Counter
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
from mutations import mutated, sound_files

SLOW, START = 10.0, 120.0
"""Seconds of processor time that a file of some kilobytes may take, and that a child may take to its first."""
BATCH = 2500
"""Files of a child process."""


def read_files(connection: Connection, paths: list[Path]) -> None:
    """In a child: say of each file what came of it."""
    from zbuf_occlude import MeshError, load_mesh

    logging.disable()  # trimesh's
    with tempfile.TemporaryDirectory() as name:  # compile, or load what is compiled, before anything is measured
        for suffix, files in sound_files().items():
            for number, data in enumerate(files):
                path = Path(name, f"{number}{suffix}")
                path.write_bytes(data)
                compared(path, load_mesh(path, up="z"))
    connection.send("ready")
    for path in paths:
        try:
            mesh = load_mesh(path, up="z")
        except MeshError as error:
            kind = "refused" if "\n" not in str(error) and len(str(error)) < 2000 else f"a message of {len(str(error))}"
            connection.send(kind)
            continue
        except Exception as error:
            connection.send(f"fault: {type(error).__name__}: {str(error)[:200]}")
            continue
        connection.send(compared(path, mesh))


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


def outcomes(paths: list[Path]) -> list[str]:
    """Read files in a child, in another from wherever one crashes or hangs."""
    found: list[str] = []
    spawn = multiprocessing.get_context("spawn")
    while len(found) < len(paths):
        connection, theirs = spawn.Pipe()
        child = spawn.Process(target=read_files, args=(theirs, paths[len(found) :]), daemon=True)
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
    parser.add_argument("--files", type=int, default=20_000)
    parser.add_argument("--random", type=int, default=0, help="seed of the mutations")
    parser.add_argument("--only", action="append", metavar="ENDING")
    parser.add_argument(
        "--keep", type=Path, help="folder for files that are faults, and those that trimesh reads otherwise"
    )
    options = parser.parse_args()
    rng, sound = random.Random(options.random), sound_files()
    kinds = options.only or list(sound)
    counts: dict[str, Counter[str]] = {kind: Counter() for kind in kinds}
    faults: list[str] = []
    for first in range(0, options.files, BATCH):
        with tempfile.TemporaryDirectory() as name:
            paths = []
            for number in range(first, min(first + BATCH, options.files)):
                suffix = kinds[number % len(kinds)]
                paths.append(Path(name, f"{number:06d}{suffix}"))
                paths[-1].write_bytes(mutated(rng.choice(sound[suffix]), suffix, rng))
            for path, outcome in zip(paths, outcomes(paths), strict=True):
                counts[path.suffix][outcome.split(": ")[0]] += 1
                if outcome not in ("refused", "read, and as trimesh has it", "read, trimesh does not"):
                    if options.keep:
                        options.keep.mkdir(parents=True, exist_ok=True)
                        (options.keep / path.name).write_bytes(path.read_bytes())
                    if not outcome.startswith("read"):
                        faults.append(f"{path.name}: {outcome}")
    for kind, of_kind in counts.items():
        print(f"{kind}: " + ", ".join(f"{n} {what}" for what, n in sorted(of_kind.items())))
    print("\n".join(faults) or f"no traceback, crash or hang in {options.files} files (seed {options.random})")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())
