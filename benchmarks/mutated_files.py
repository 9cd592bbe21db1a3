"""Give mutated files to the readers: each must be read or refused in one line, soon, whatever was done to it.

    python benchmarks/mutated_files.py meshes [--files 20000] [--random SEED] [--keep FOLDER] [--only .glb --only .gltf]
    python benchmarks/mutated_files.py documents

Small sound files, meshes of all formats or sensors, scenes, poses and labels, are cut, doubled, spliced, peppered with
odd numbers and words and, for glTF and JSON, changed in their values. They are read in child processes, so that a crash
or a hang in compiled code is seen and told from an error. Meshes that come out must be finite. Documents that come out
are used: a sensor scans, a scene is scanned, a camera sees, and no warning may come but of eyes inside a box. Exit
status 1 after any exception but the package's own, any crash, any file that took longer than 10 s or a process to more
than 1 GB; --keep keeps such files.
"""

import base64
import copy
import json
import multiprocessing
import os
import re
import struct
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from common import run

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
ODD_WORDS = (
    *(b"true", b"no", b"null", b"~", b".inf", b"[]", b"[[1]]", b"{}", b"*a", b"&a 1", b"!!binary x", b"!!int ''", b'"'),
    *(b"9" * 400, b"9" * 5000, b"x" * 140_000, b"[" * 3000, b"a\nerror: b", b'"a\\nerror: b"', b"1e5", b"\0", b"'"),
)
"""What documents do not hold where a number should be."""
SENSORS = (
    """kind: spinning
lasers: [-12, -8, [0, 1.5], [4, -1.5]]
columns: 72
range_max: 80
sigma: [[0, 0.01], [80, 0.04]]
step: 0.005
divergence: 0.002
drop: 0.1
returns: last
reach: 40
name: mine
source: measured
""",
    """kind: pinhole
width: 20
height: 15
fov: 60
axial: true
lateral: [0.8, 0.035]
sigma: 0.01
disparity_step: 0.003
edge_loss: 0.5
incidence_max: 85
drop_zero: 0.2
drop_limit: 0.1
attenuation: 0.004
""",
    """kind: risley
frequencies: [-77.7, 121.6]
wedge: 18
index: 1.51
rate: 10000
seconds: 0.1
range_min: 1
""",
)
ODD_NUMBERS = (
    b"-1 0 1 2 3 -0 nan inf -inf 1e400 -1e-400 1e308 0x1F 1_000 1,5 .5 5. . - + e5 1e 1e+ --1 +1 1d3 4294967295 1e9"
    b" 4294967296 2147483648 18446744073709551616 99999999999999999999999 1000000000 0.1e1 1/2/3 1//3 / 1/ \xd9\xa3"
).split()
ODD_BYTES = (
    b"\0", b"#", b"\\\n", b"\r", b"\r\n", b"\n\n", b"\xef\xbb\xbf", b"\t", b"\v", b" ", b"\xff", b"\x1b[31m",
    b"\xc2\x85",
)  # fmt: skip
ODD_VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 1, 2, 3, 5, 7, 255, 65536, 2**31, 2**32, 2**53, 2**60, 2**64, 1.5, 1e308, -0.0, "", "0", [], {},
    [0], [[0]], [0] * 16, [1e39] * 16, {"a": 0}, 5120, 5121, 5123, 5125, 5126, 5130, "POSITION", "VEC3", "SCALAR",
    "data:,", "../x", "data:;base64,AAAA", float("nan"), float("inf"), 10**400, -1e-320, 1e200, "1e5", "a\nerror: b",
    "x" * 5000, "\0",
)  # fmt: skip


# ---- sound files -----------------------------------------------------------------------------------------------------


def sound_files() -> dict[str, list[bytes]]:
    """Return small files of every format that are as they should be, by their ending."""
    import trimesh

    ball, box = trimesh.creation.icosphere(subdivisions=1), trimesh.creation.box((1, 2, 3))
    scene = trimesh.Scene()
    for number, geometry in enumerate((ball, box, box)):
        scene.add_geometry(geometry, transform=trimesh.transformations.rotation_matrix(number, (0, 1, 1), (1, 0, 0)))
    files: dict[str, list[bytes]] = {suffix: [] for suffix in (".off", ".obj", ".ply", ".stl", ".glb", ".gltf")}
    for mesh in (ball, box):
        files[".off"].append(mesh.export(file_type="off").encode())
        files[".obj"].append(mesh.export(file_type="obj").encode())
        files[".ply"] += [mesh.export(file_type="ply", encoding=how) for how in ("ascii", "binary")]
        files[".stl"] += [mesh.export(file_type="stl"), mesh.export(file_type="stl_ascii").encode()]
    prism = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (1, 0.5, 0), (0, 2, 0), (1, 1, 3)]
    polygons = [[0, 1, 2, 3, 4], [0, 1, 5], [1, 2, 5], [2, 3, 4, 5]]
    rows = "".join(f"{x} {y} {z}\n" for x, y, z in prism)
    files[".off"].append(f"OFF{len(prism)} {len(polygons)} 0\n{rows}".encode() + _faces(polygons))
    files[".off"].append(f"COFF\n# red\n{len(prism)} {len(polygons)}\n{rows}".encode() + _faces(polygons))
    files[".obj"].append(
        "".join(f"v {row}\n" for row in rows.splitlines()).encode()
        + b"vt 0 0\nvn 0 0 1\nusemtl a\n"
        + b"".join(b"f " + b" ".join(b"%d/1/1" % (i - 6) for i in each) + b"\n" for each in polygons)
    )
    head = "ply\nformat {} 1.0\nelement vertex 6\n" + "property double {}\n" * 3 + "element face 4\n"
    head += "property list uchar int vertex_indices\nproperty uchar red\nend_header\n"
    files[".ply"].append(head.format("ascii", "x", "y", "z").encode() + rows.encode() + _faces(polygons, b" 7"))
    for name, order in (("binary_little_endian", "<"), ("binary_big_endian", ">")):
        body = np.array(prism, f"{order}f8").tobytes()
        body += b"".join(bytes([len(f)]) + np.array(f, f"{order}i4").tobytes() + b"\7" for f in polygons)
        files[".ply"].append(head.format(name, "x", "y", "z").encode() + body)
    files[".ply"] += [data.replace(b"element face", b"element tristrips") for data in files[".ply"][-3:]]
    files[".glb"].append(scene.export(file_type="glb"))
    document, blob = unpacked(files[".glb"][0])
    for rich in (document, rich_document()):
        data = blob if rich is document else base64.b64decode(rich["buffers"][0]["uri"].partition(",")[2])
        rich["buffers"][0]["uri"] = "data:;base64," + base64.b64encode(data).decode()
        files[".gltf"].append(json.dumps(rich).encode())
        inside = {**rich, "buffers": [{"byteLength": len(data)}]}
        files[".glb"].append(packed(inside, data))
    return files


def sound_documents() -> dict[str, list[bytes]]:
    """Return sensors, scenes, poses and labels that are as they should be, by the names of their files."""
    turn = [[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]]
    camera = {"K": [[50, 0, 50], [0, 50, 50], [0, 0, 1]], "width": 100, "height": 100, "R": turn, "t": [0, 0, 10]}
    frame = {"transform_matrix": [[0, 0, 1, 4], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]}
    nerf = {"camera_angle_x": 0.7, "w": 100, "h": 80, "k1": 0.0, "frames": [frame, frame]}
    crate = {"mesh": "crate.off", "position": [0, 6, 0], "size": 2, "yaw": 30, "albedo": 0.9, "up": "z", "class": "a"}
    taxonomy = {"taxonomy_id": "02691156", "taxonomy_name": "airplane", "train": ["one", "crate"], "test": ["two"]}
    pose = (0.5, 0.5, -0.5, -0.5, 0, 0, 10)
    image = "".join(f"{i} {' '.join(map(str, pose))} 1 x.png\n1 2 -1\n" for i in (1, 2))
    images = b"".join(struct.pack("<I7dI6sQ", i, *pose, 1, b"x.png\0", 2) + bytes(48) for i in (1, 2))
    models = struct.pack("<iiQQ4d", 1, 1, 100, 80, 50, 50, 50, 40) + struct.pack("<iiQQ4d", 2, 2, 9, 8, 5, 5, 4, 0)
    return {
        "sensor.yaml": [text.encode() for text in SENSORS],
        "sensor.csv": [
            b"azimuth,elevation,ring\n0,0,3\n90,0,4\n-1.5,2.5,\n",
            b"x, y, z\n1, 0, 0\n1, 0.1, 0.2\n",
        ],
        "scene.json": [json.dumps({"objects": [crate, {"mesh": "crate.off", "position": [3, -6, 0]}]}).encode()],
        "views.csv": [
            b"azimuth,elevation,distance,roll\n0,20,4,0\n30,-20,,5\n",
            b"azimuth, elevation\n0, 20\n30, -20\n",
            b"r11,r12,r13,r21,r22,r23,r31,r32,r33,t1,t2,t3,fx,fy,cx,cy,width,height\n"
            + b"0,1,0,0,0,-1,-1,0,0,0,0,10,50,50,50,50,100,100\n" * 2,
        ],
        "cameras.json": [json.dumps(each).encode() for each in (nerf, [camera, camera], {"cameras": [camera]}, camera)],
        "cameras.jsonl": [f"{json.dumps(camera)}\n".encode() * 2],
        "images.txt": [b"# images\n" + image.encode()],
        "images.bin": [struct.pack("<Q", 2) + images],
        "cameras.txt": [b"# cameras\n1 PINHOLE 100 80 50 50 50 40\n2 SIMPLE_RADIAL 9 8 5 5 4 0\n"],
        "cameras.bin": [struct.pack("<Q", 2) + models],
        "labels.csv": [b"key,class,split\ncrate,cup,train\n", b"id,synsetId,modelId,split\n1,2691156,crate,val\n"],
        "labels.json": [json.dumps(each).encode() for each in ([taxonomy], {"cup": ["crate"]}, {"crate": "cup"})],
    }


def rich_document() -> dict[str, Any]:
    """Return glTF with what few files have: sparse and normalized accessors, strips, instances, a skin."""
    rng = np.random.default_rng(0)
    arrays = [
        rng.normal(size=(8, 3)).astype("<f4"), rng.integers(0, 8, 12).astype("<u2"), np.array([1, 5], "<u2"),
        rng.normal(size=(2, 3)).astype("<f4"), rng.integers(0, 65535, (8, 4)).astype("<u2")[:, :4],
        rng.normal(size=(3, 3)).astype("<f4"), np.zeros((8, 4), "<u1"), np.full((8, 4), 0.25, "<f4"),
        np.tile(np.eye(4, dtype="<f4"), (2, 1, 1)),
    ]  # fmt: skip
    views, blob = [], b""
    for array in arrays:
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": array.nbytes})
        blob += array.tobytes() + bytes(-array.nbytes % 4)
    views[4]["byteStride"] = 8
    kinds = ((0, 5126, 8, "VEC3"), (1, 5123, 12, "SCALAR"), (4, 5123, 8, "VEC3"), (5, 5126, 3, "VEC3"))
    kinds += ((6, 5121, 8, "VEC4"), (7, 5126, 8, "VEC4"), (8, 5126, 2, "MAT4"))
    accessors: list[dict[str, Any]] = [
        {"bufferView": view, "componentType": kind, "count": count, "type": shape} for view, kind, count, shape in kinds
    ]
    accessors[0]["sparse"] = {
        "count": 2, "indices": {"bufferView": 2, "componentType": 5123}, "values": {"bufferView": 3},
    }  # fmt: skip
    accessors[2]["normalized"] = True
    primitives = [
        {"attributes": {"POSITION": 0}, "indices": 1},
        {"attributes": {"POSITION": 2}, "mode": 5},
        {"attributes": {"POSITION": 0}, "mode": 6, "indices": 1},
        {"attributes": {"POSITION": 0, "JOINTS_0": 4, "WEIGHTS_0": 5}, "indices": 1, "targets": [{"POSITION": 2}]},
    ]
    return {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["EXT_mesh_gpu_instancing"],
        "buffers": [{"byteLength": len(blob), "uri": "data:;base64," + base64.b64encode(blob).decode()}],
        "bufferViews": views,
        "accessors": accessors,
        "meshes": [{"primitives": [primitive], "weights": [0.5]} for primitive in primitives],
        "skins": [{"joints": [4, 5], "inverseBindMatrices": 6}],
        "nodes": [
            {"mesh": 0, "children": [1, 2, 4], "rotation": [0, 0.6, 0, 0.8], "scale": [1, -2, 1]},
            {"mesh": 1, "matrix": [2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1]},
            {"mesh": 2, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 3}}}},
            {"mesh": 3, "skin": 0},
            {"translation": [1, 0, 0], "children": [5]},
            {"translation": [0, 1, 0], "mesh": 3, "extensions": {"KHR_node_visibility": {"visible": False}}},
        ],
        "scene": 0,
        "scenes": [{"nodes": [0, 3]}],
    }


def _faces(polygons: list[list[int]], after: bytes = b"") -> bytes:
    return b"".join(b" ".join(b"%d" % i for i in (len(each), *each)) + after + b"\n" for each in polygons)


def packed(document: dict[str, Any], blob: bytes) -> bytes:
    """Return a GLB file."""
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(blob), b"BIN\0") + blob
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def unpacked(data: bytes) -> tuple[dict[str, Any], bytes]:
    """Return the document and the binary chunk of a sound GLB file."""
    (length,) = struct.unpack_from("<I", data, 12)
    return json.loads(data[20 : 20 + length]), data[28 + length :]


# ---- mutations -------------------------------------------------------------------------------------------------------


def mutated(data: bytes, kind: str, rng: Random) -> bytes:
    """Return a file after one to four changes."""
    ways: list[Callable[[bytes, Random], bytes]] = [
        *(flipped, cut, spliced, peppered, renumbered, reworded, relined),
        *[revalued_text] * (0 if kind.startswith("mesh") else 4),
    ]
    if kind.endswith((".glb", ".gltf", ".json")) and rng.random() < 0.85:
        document, blob = unpacked(data) if kind.endswith(".glb") else (json.loads(data), b"")
        for _ in range(rng.choice((1, 1, 1, 2, 4))):
            revalued(document, rng)
        data = packed(document, blob) if kind.endswith(".glb") else json.dumps(document).encode()
        if rng.random() < 0.8:
            return data
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        data = rng.choice(ways)(data, rng)
    return data


def flipped(data: bytes, rng: Random) -> bytes:
    """Change single bits."""
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 3, 20))):
        if changed:
            changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def cut(data: bytes, rng: Random) -> bytes:
    """Cut off the end, mostly little of it, or the beginning."""
    place = rng.choice((rng.randrange(len(data) + 1), max(0, len(data) - rng.randrange(30))))
    return data[:place] if rng.random() < 0.8 else data[place:]


def spliced(data: bytes, rng: Random) -> bytes:
    """Take a piece out, put it in twice, or put it elsewhere."""
    begin = rng.randrange(len(data) + 1)
    piece = data[begin : begin + rng.choice((1, 4, 20, 200))]
    rest = data[:begin] + data[begin + len(piece) :]
    place = rng.randrange(len(rest) + 1)
    return rng.choice((rest, data[:begin] + piece + data[begin:], rest[:place] + piece + rest[place:]))


def peppered(data: bytes, rng: Random) -> bytes:
    """Put odd bytes in."""
    place = rng.randrange(len(data) + 1)
    return data[:place] + rng.choice(ODD_BYTES) + data[place:]


def renumbered(data: bytes, rng: Random) -> bytes:
    """Put an odd number in place of a word of text; in binary data, a large or small number of four bytes."""
    words = data.split(b" ") if b" " in data[:2000] else []
    if len(words) > 3 and rng.random() < 0.8:
        words[rng.randrange(len(words))] = rng.choice(ODD_NUMBERS)
        return b" ".join(words)
    place = rng.randrange(max(1, len(data) - 4))
    value = rng.choice((0, 1, 2**31 - 1, 2**31, 2**32 - 1, 0x7F800000, 0x7FC00000, 0x00000001, 0x7F7FFFFF))
    return data[:place] + struct.pack("<I", value) + data[place + 4 :]


def reworded(data: bytes, rng: Random) -> bytes:
    """Put a word of a text in place of another."""
    words = data.split(b" ")
    words[rng.randrange(len(words))] = rng.choice(words)
    return b" ".join(words)


def revalued_text(data: bytes, rng: Random) -> bytes:
    """Put something odd in place of a word or number of YAML or CSV, or of what stands between two commas."""
    words = re.split(rb"([,:\n\[\] ])", data)
    words[rng.randrange(0, len(words), 2)] = rng.choice((*ODD_NUMBERS, *ODD_WORDS))
    return b"".join(words)


def relined(data: bytes, rng: Random) -> bytes:
    """Double, move, join, break or comment lines of a text, or end them otherwise."""
    lines = data.split(b"\n")
    place, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    way = rng.randrange(6)
    if way == 0:
        return rng.choice((b"\r\n", b"\r", b"\n\n", b" \n\t", b" # said\n")).join(lines)
    if way == 1:
        lines.insert(other, lines[place])
    elif way == 2:
        lines.insert(other, lines.pop(place))
    elif way == 3:
        lines[place : place + 2] = [b" ".join(lines[place : place + 2])]
    elif way == 4:
        lines[place] = lines[place].replace(b" ", b"\n", 1)
    else:
        lines[place] = b"# " + lines[place]
    return b"\n".join(lines)


def revalued(document: dict[str, Any], rng: Random) -> None:
    """Change, remove or double a value somewhere in JSON."""
    holder: Any = document
    while holder:
        key = rng.choice(list(holder)) if isinstance(holder, dict) else rng.randrange(len(holder))
        value = holder[key]
        if isinstance(value, (dict, list)) and value and rng.random() < 0.85:
            holder = value
            continue
        way = rng.random()
        if way < 0.7:
            holder[key] = copy.deepcopy(rng.choice(ODD_VALUES))
        elif way < 0.85:
            del holder[key]
        elif isinstance(holder, list):
            holder.append(copy.deepcopy(value))
        else:
            names = ("mesh", "skin", "children", "extensions", "sparse", "byteStride", "indices", "up", "K", "frames")
            holder[rng.choice(names)] = copy.deepcopy(value)
        return


# ---- reading ---------------------------------------------------------------------------------------------------------


def read_files(connection: Connection, paths: list[Path], sound: dict[str, list[bytes]]) -> None:
    """In a child: say of each file what came of it."""
    from zbuf_occlude.base.errors import OccludeError

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
            in_a_line = "\n" not in str(error) and len(str(error)) < 2000
            said = "refused" if in_a_line else f"fault: it says {str(error)[:200]!r}"
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
    from zbuf_occlude.sensors.scenes import Scene
    from zbuf_occlude.sensors.scenes.contents import placed_of, read_scene

    if path.stem == "mesh":
        corners = zo.load_mesh(path, up="z").corners
        return "read" if np.isfinite(corners).all() else "fault: what is not finite came through"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "eyes lie inside")  # a view's distance may be changed to that
        what, crate = path.stem, zo.load_mesh(path.parent / "crate.off")
        if what == "labels":
            MeshCollection.from_paths(path.parent / "crate.off", labels=path)
            return "read"
        if what in ("sensor", "scene"):
            sensor = zo.sensors.make(str(path)) if what == "sensor" else zo.sensors.make("pinhole:width=20,height=20")
            scene = Scene.joined(placed_of(read_scene(path)["objects"], 0.0)) if what == "scene" else crate
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
            views.select(np.arange(min(4, len(views)))).in_frustum(points.positions)
            numbers = views.poses
        return "read" if np.isfinite(numbers).all() else "fault: what is not finite came through"


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


def main(
    what: str, *, files: int = 20_000, random: int = 0, keep: Path | None = None, only: Sequence[str] = ("",)
) -> int:
    rng = Random(random)  # the seed of the mutations
    meshes = {f"mesh{suffix}": examples for suffix, examples in sound_files().items()}
    sound = meshes if what == "meshes" else sound_documents()
    sound = {kind: examples for kind, examples in sound.items() if kind.endswith(tuple(only))}
    kinds = list(sound)
    counts: dict[str, Counter[str]] = {kind: Counter() for kind in kinds}
    faults: list[str] = []
    for first in range(0, files, BATCH):
        with tempfile.TemporaryDirectory() as name:
            paths = []
            for number in range(first, min(first + BATCH, files)):
                kind = kinds[number % len(kinds)]
                data = mutated(rng.choice(sound[kind]), kind, rng)
                paths.append(written(Path(name, f"{number:06d}"), kind, data))
            for path, outcome in zip(paths, outcomes(paths, sound), strict=True):
                counts[path.name][outcome.split(": ")[0]] += 1
                number = path.parent.name
                if outcome.startswith("fault"):
                    faults.append(f"{number}.{path.name}: {outcome}")
                    if keep:
                        keep.mkdir(parents=True, exist_ok=True)
                        (keep / f"{number}.{path.name}").write_bytes(path.read_bytes())
    for kind, of_kind in counts.items():
        print(f"{kind}: " + ", ".join(f"{n} {what}" for what, n in sorted(of_kind.items())))
    print("\n".join(faults) or f"no traceback, crash or hang in {files} files (seed {random})")
    return int(bool(faults))


if __name__ == "__main__":
    run(main, __doc__, what=("meshes", "documents"))
