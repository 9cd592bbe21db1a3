"""Any bytes become a Mesh or a MeshError, and no header makes the memory grow: damage, cuts and hostile counts."""

import base64
import json
import struct
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from trimesh.exchange.ply import export_ply
from trimesh.exchange.stl import export_stl, export_stl_ascii

from zbuf_occlude import Mesh, MeshError, load_mesh

BOX = trimesh.creation.box()
MIXED_PLY = (
    b"ply\nformat binary_big_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty double z\n"
    b"element face 3\nproperty list uchar int vertex_indices\nproperty uchar red\nend_header\n"
    + b"".join(struct.pack(">ffd", *v) for v in ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0.5)))
    + b"".join(struct.pack(f">B{len(f)}iB", len(f), *f, 9) for f in ((0, 1, 2), (0, 1, 2, 3), (1, 2, 3)))
)
GLTF = trimesh.Scene(BOX).export(file_type="gltf")


def inlined(files: dict[str, bytes]) -> bytes:
    document = json.loads(files["model.gltf"])
    for buffer in document["buffers"]:
        buffer["uri"] = "data:;base64," + base64.b64encode(files[buffer["uri"]]).decode()
    return json.dumps(document).encode()


VALID = {
    "box.off": BOX.export(file_type="off").encode(),
    "quads.off": b"OFF # x\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3 255 0 0\n3 1 2 3\n",
    "stream.off": b"OFF 4 2 0 0 0 0 1 0 0 1 1 0 0 1 0 4 0 1 2 3 3 1 2 3",
    "box.obj": BOX.export(file_type="obj").encode(),
    "odd.obj": b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv .2 .1 0\nf -4/1 -3/2 -2// -1/1/1\nf 1 2 3\nv 0 1 0\nf -1 1 \\\n2\n",
    "ascii.ply": export_ply(BOX, encoding="ascii"),
    "binary.ply": export_ply(BOX),
    "mixed.ply": MIXED_PLY,
    "ascii.stl": export_stl_ascii(BOX).encode(),
    "binary.stl": export_stl(BOX),
    "box.glb": BOX.export(file_type="glb"),
    "box.gltf": inlined(GLTF),
}
HOSTILE = b"353535235358 999999999999999999 4294967295 -1 nan inf 1e308 0 1e-320 x".split()


def outcome(folder: Path, name: str, data: bytes) -> Mesh | str:
    """Load bytes as a file; a warning of NumPy counts as a failure, anything but MeshError too."""
    path = folder / f"file{Path(name).suffix}"
    path.write_bytes(data)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            found: Mesh | str = load_mesh(path)
        except MeshError as error:
            found = str(error)
    if isinstance(found, str):
        assert found.startswith(f"{path}: ")
        assert "\n" not in found
    else:
        assert np.isfinite(found.vertices).all()
        assert len(found.faces)
        assert np.isfinite(found.areas).all()
    return found


@st.composite
def damaged(draw: st.DrawFn, data: bytes) -> bytes:
    """The bytes with a few of these: cut short, bytes overwritten, a part missing or twice, a number replaced."""
    for _ in range(draw(st.integers(1, 3))):
        if not data:
            break
        position = draw(st.integers(0, len(data) - 1))
        kind = draw(st.sampled_from(["cut", "overwrite", "remove", "repeat", "number"]))
        length = draw(st.integers(1, 40))
        if kind == "cut":
            data = data[:position]
        elif kind == "overwrite":
            new = draw(st.binary(min_size=1, max_size=8))
            data = data[:position] + new + data[position + len(new) :]
        elif kind == "remove":
            data = data[:position] + data[position + length :]
        elif kind == "repeat":
            data = data[: position + length] + data[position:]
        else:
            end = position
            while end < len(data) and data[end : end + 1] in b"0123456789.-e":
                end += 1
            data = data[:position] + draw(st.sampled_from(HOSTILE)) + data[end:]
    return data


@pytest.mark.parametrize("name", VALID)
def test_the_files_to_be_damaged_are_whole(tmp_path: Path, name: str) -> None:
    assert isinstance(outcome(tmp_path, name, VALID[name]), Mesh)


@pytest.mark.parametrize("name", VALID)
@given(data=st.data())
@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damage_gives_a_mesh_or_one_line(tmp_path: Path, name: str, data: st.DataObject) -> None:
    outcome(tmp_path, name, data.draw(damaged(VALID[name])))


@pytest.mark.parametrize("name", ["binary.ply", "mixed.ply", "binary.stl", "box.glb", "box.gltf"])
def test_every_kind_of_nan_is_refused_without_a_warning(tmp_path: Path, name: str) -> None:
    for nan in (b"\x01\0\xa0\x7f", b"\0\0\xc0\xff"):  # a signalling one, which NumPy warns of, and a quiet one
        data = VALID[name]
        if name == "box.gltf":
            document = json.loads(data)
            blob = nan * (document["bufferViews"][-1]["byteLength"] // 4)
            assert document["accessors"][-1]["type"] == "VEC3"
            document["buffers"][-1]["uri"] = "data:;base64," + base64.b64encode(blob).decode()
            data = json.dumps(document).encode()
        elif name == "mixed.ply":
            data = data.replace(struct.pack(">f", 1), nan[::-1])
        else:
            data = data.replace(struct.pack("<f", 0.5), nan)
        message = outcome(tmp_path, name, data)
        assert isinstance(message, str)
        assert "must be finite" in message


@pytest.mark.parametrize("suffix", [".off", ".obj", ".ply", ".stl", ".glb", ".gltf"])
@given(data=st.binary(max_size=300))
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_bytes_give_a_mesh_or_one_line(tmp_path: Path, suffix: str, data: bytes) -> None:
    outcome(tmp_path, suffix, data)


@pytest.mark.parametrize("name", [name for name in VALID if not name.endswith(".obj")])
def test_a_file_cut_short_anywhere_is_refused(tmp_path: Path, name: str) -> None:
    """Not OBJ, which declares nothing; nor within the last number or blank, which cannot be known."""
    data = VALID[name].rstrip() if b"\0" not in VALID[name] else VALID[name]
    ends = np.linspace(0, len(data) - 1, 60).astype(int)
    if name.endswith(".off") or name == "ascii.ply":
        last_line = data.rindex(b"\n") if b"\n" in data else data.rindex(b" ")
        # on the last line, colours may be missing and a number shorter: `3 1 2 10` cut to `3 1 2 1`
        ends = ends[ends < (last_line if b"\n" in data else len(data) - 1)]
    for end in ends:
        assert isinstance(outcome(tmp_path, name, data[:end]), str), f"cut to {end} of {len(data)} bytes"


def hostile_files() -> dict[str, bytes]:
    """Small files that declare much."""
    much = b"353535235358"
    document = json.loads(VALID["box.gltf"])

    empty = {"componentType": 5126, "type": "VEC3", "count": 10**9}
    sparse = {"count": 0, "indices": {"bufferView": 0, "componentType": 5125}, "values": {}}

    def gltf(change: str, value: object) -> bytes:
        again = json.loads(VALID["box.gltf"])
        where, key = change.split("/")
        again[where][0][key] = value
        return json.dumps(again).encode()

    files = {
        "vertices.off": b"OFF\n" + much + b" 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
        "faces.off": b"OFF\n3 " + much + b" 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
        "glued.off": b"OFF" + much + b" " + much + b" 0\n0 0 0\n",
        "some.off": b"OFF\n400000000 400000000 0\n0 0 0\n",
        "corners.off": b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n" + much + b" 0 1 2\n",
        "index.off": b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 " + much,
        "index.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 " + much,
        "negative.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 -" + much,
        "facets.stl": bytes(80) + b"\xff\xff\xff\xff" + bytes(500),
        "no facets.stl": bytes(80) + b"\xff\xff\xff\xff",
        "elements.ply": b"ply\nformat binary_little_endian 1.0\nelement vertex %s\nelement face %s\nend_header\n"
        % (much, much),
        "count.gltf": gltf("accessors/count", 353535235358),
        "length.gltf": gltf("bufferViews/byteLength", 353535235358),
        "empty.gltf": json.dumps(document | {"accessors": [empty] * 2}).encode(),
        "sparse.gltf": json.dumps(document | {"accessors": [{**empty, "sparse": sparse}] * 2}).encode(),
    }
    for name in ("ascii.ply", "binary.ply"):
        head = VALID[name]
        files[f"vertices {name}"] = head.replace(b"element vertex 8", b"element vertex " + much)
        files[f"faces {name}"] = head.replace(b"element face 12", b"element face " + much)
        assert files[f"vertices {name}"] != head != files[f"faces {name}"]
    at = MIXED_PLY.index(b"end_header\n") + len(b"end_header\n") + 4 * 16
    as_uint = MIXED_PLY.replace(b"list uchar int", b"list uint int")
    files["corners.ply"] = as_uint[: at - 1] + b"\xff\xff\xff\xff" + as_uint[at:]
    return files


LIMITED = """
import resource, sys
from pathlib import Path
import trimesh  # whose import is not what is measured
from zbuf_occlude import MeshError, load_mesh
import numpy as np

held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (held + 200_000_000, -1))
try:
    np.zeros(300_000_000, dtype=np.uint8)
    print("the limit does not limit")
except MemoryError:
    pass
for path in sorted(Path(sys.argv[1]).iterdir()):
    try:
        print(f"{path.name}: loaded {load_mesh(path)}")
    except MeshError:
        pass
    except BaseException as error:
        print(f"{path.name}: {type(error).__name__} {error}")
print("done")
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits of memory are set and measured as on Linux")
def test_hostile_headers_take_no_memory(tmp_path: Path) -> None:
    """In a process that may take 200 MB more than it holds, every one of them is refused in words."""
    for name, data in hostile_files().items():
        (tmp_path / name).write_bytes(data)
    run = subprocess.run(
        [sys.executable, "-c", LIMITED, str(tmp_path)], capture_output=True, text=True, timeout=120, check=False
    )
    assert run.stdout == "done\n", run.stderr[-2000:]
