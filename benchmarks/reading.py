"""How fast text formats are read, MB of file per second on one core: python benchmarks/reading.py FOLDER [--json FILE]

FOLDER: mesh files. All its OBJ and OFF files as they are; the largest mesh of them written anew as OFF, OBJ, ASCII PLY,
ASCII STL, with six decimals and with all digits. "lines": the scanner alone (`meshes/text.py`); "polygons": the reader
of the format, checks included; "mesh": cut into triangles and cleaned. Processor time, the best of five.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from zbuf_occlude import Mesh, MeshError, load_mesh
from zbuf_occlude.jit.threads import use_threads
from zbuf_occlude.meshes.load import READERS
from zbuf_occlude.meshes.obj import KEYWORDS as OBJ
from zbuf_occlude.meshes.stl import KEYWORDS as STL
from zbuf_occlude.meshes.text import NO_KEYWORDS, Lines

KEYWORDS = {".obj": OBJ, ".stl": STL}


def spelt(mesh: Mesh, suffix: str, number: str) -> bytes:
    vertices = [" ".join(number % x for x in vertex) for vertex in mesh.vertices.tolist()]
    faces = mesh.faces.tolist()
    if suffix == ".stl":
        facets = (
            "facet normal 0 0 1\n outer loop\n"
            + "".join(f"  vertex {vertices[i]}\n" for i in face)
            + " endloop\nendfacet\n"
            for face in faces
        )
        return f"solid a\n{''.join(facets)}endsolid a\n".encode()
    if suffix == ".obj":
        lines = [f"v {vertex}" for vertex in vertices] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
        return "\n".join(lines).encode()
    body = "\n".join(vertices + [f"3 {a} {b} {c}" for a, b, c in faces])
    if suffix == ".off":
        return f"OFF\n{len(vertices)} {len(faces)} 0\n{body}\n".encode()
    xyz = "".join(f"property double {axis}\n" for axis in "xyz")
    return (
        f"ply\nformat ascii 1.0\nelement vertex {len(vertices)}\n{xyz}element face {len(faces)}\n"
        f"property list uchar int vertex_indices\nend_header\n{body}\n"
    ).encode()


def rate(n_bytes: int, work: Callable[[], object]) -> float:
    work()
    best = np.inf
    for _ in range(5):
        began = time.process_time()
        work()
        best = min(best, time.process_time() - began)
    return n_bytes / best / 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    use_threads(1)
    sets: dict[str, list[Path]] = {}
    for path in sorted(arguments.folder.rglob("*")):
        if path.suffix.lower() in (".off", ".obj"):
            sets.setdefault(f"{path.suffix.lower()} of the folder", []).append(path)
    largest = max((path for paths in sets.values() for path in paths), key=lambda path: path.stat().st_size)
    rows = []
    with tempfile.TemporaryDirectory() as place:
        mesh = load_mesh(largest)
        for suffix in (".off", ".obj", ".ply", ".stl"):
            for name, number in (("%.6f", "%.6f"), ("all digits", "%r")):
                path = Path(place, f"{number[1:]}{suffix}")
                path.write_bytes(spelt(mesh, suffix, number))
                sets[f"{suffix} {name}"] = [path]
        print(
            f"{largest.name}: {len(mesh.faces):,} faces\n\n{'MB per second':<22}{'lines':>8}{'polygons':>10}{'mesh':>8}"
        )
        for name, paths in sets.items():
            rows.append({"set": name, **rates(paths)})
            print(f"{name:<22}{rows[-1]['lines']:>8.0f}{rows[-1]['polygons']:>10.0f}{rows[-1]['mesh']:>8.0f}")
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(rows, indent=1) + "\n")


def rates(paths: list[Path]) -> dict[str, float]:
    suffix = paths[0].suffix.lower()
    good = [path for path in paths if loads(path)]
    data = [path.read_bytes() for path in good]
    n_bytes = sum(map(len, data))
    keywords = KEYWORDS.get(suffix, NO_KEYWORDS)
    bodies = [each.partition(b"end_header\n")[2] if suffix == ".ply" else each for each in data]
    return {
        "lines": rate(n_bytes, lambda: [Lines(each, comment=b"#", keywords=keywords) for each in bodies]),
        "polygons": rate(n_bytes, lambda: [READERS[suffix](each) for each in data]),
        "mesh": rate(n_bytes, lambda: [load_mesh(path) for path in good]),
    }


def loads(path: Path) -> bool:
    try:
        load_mesh(path)
    except MeshError:
        return False
    return True


if __name__ == "__main__":
    main()
