"""Any bytes become a Mesh or a MeshError, and no header makes the memory grow: damage, cuts and hostile counts."""

import json
import random
import struct
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

from zbuf_occlude import Mesh, MeshError, load_mesh

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

from mutated_files import mutated, sound_files

SOUND = {f"{number}{suffix}": data for suffix, files in sound_files().items() for number, data in enumerate(files)}


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


@pytest.mark.parametrize("name", SOUND)
def test_damage_gives_a_mesh_or_one_line(tmp_path: Path, name: str) -> None:
    """As benchmarks/mutated_files.py does with many more."""
    assert isinstance(outcome(tmp_path, name, SOUND[name]), Mesh)
    rng = random.Random(name)
    for _ in range(60):
        outcome(tmp_path, name, mutated(SOUND[name], f"mesh{Path(name).suffix}", rng))
        outcome(tmp_path, name, rng.randbytes(rng.randrange(300)))


@pytest.mark.parametrize("name", ["3.ply", "2.stl", "0.glb"])
def test_every_kind_of_nan_is_refused_without_a_warning(tmp_path: Path, name: str) -> None:
    for nan in (b"\x01\0\xa0\x7f", b"\0\0\xc0\xff"):  # a signalling one, which NumPy warns of, and a quiet one
        data = SOUND[name].replace(struct.pack("<f", 0.5), nan)
        assert "must be finite" in str(outcome(tmp_path, name, data))


@pytest.mark.parametrize("name", [name for name in SOUND if not name.endswith(".obj")])
def test_a_file_cut_short_anywhere_is_refused(tmp_path: Path, name: str) -> None:
    """Not OBJ, which declares nothing; nor within the last line, where a number or a colour may be missing unseen."""
    data = SOUND[name]
    is_text = name.endswith(".off") or b"format ascii" in data
    end = data.rstrip().rindex(b"\n") if is_text else len(data.rstrip(b"\n")) - 1
    for cut in np.linspace(0, end, 60).astype(int):
        assert isinstance(outcome(tmp_path, name, data[:cut]), str), f"cut to {cut} of {len(data)} bytes"


def hostile_files() -> dict[str, bytes]:
    """Small files that declare much."""
    much, document = b"353535235358", json.loads(SOUND["0.gltf"])
    ascii_ply, binary_ply = SOUND["2.ply"], SOUND["3.ply"]
    empty = {"componentType": 5126, "type": "VEC3", "count": 10**9}
    sparse = {"count": 0, "indices": {"bufferView": 0, "componentType": 5125}, "values": {}}
    accessors = {
        "empty": [empty],
        "sparse": [{**empty, "sparse": sparse}],
        "count": [{**each, "count": int(much)} for each in document["accessors"]],
    }
    views = [{**view, "byteLength": int(much)} for view in document["bufferViews"]]
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
        "elements.ply": b"ply\nformat binary_little_endian 1.0\nelement vertex %s\nelement face %s\nend_header\n"
        % (much, much),
        "corners.ply": binary_ply.replace(b"list uchar int", b"list uint int"),
        "length.gltf": json.dumps(document | {"bufferViews": views}).encode(),
    }
    for name, rows in accessors.items():
        files[f"{name}.gltf"] = json.dumps(document | {"accessors": rows * 9}).encode()
    for name, data in (("ascii", ascii_ply), ("binary", binary_ply)):
        for element in (b"element vertex ", b"element face "):
            files[f"{element.decode()}{name}.ply"] = data.replace(element, element + much)
    return files


LIMITED = """
import resource, sys
from pathlib import Path
from zbuf_occlude import MeshError, load_mesh
import numpy as np

for path in Path(sys.argv[2]).iterdir():  # libraries and compiled code are not what is measured
    load_mesh(path)
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
    for folder, files in (("hostile", hostile_files()), ("sound", SOUND)):
        (tmp_path / folder).mkdir()
        for name, data in files.items():
            (tmp_path / folder / name).write_bytes(data)
    command = [sys.executable, "-c", LIMITED, str(tmp_path / "hostile"), str(tmp_path / "sound")]
    run = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert run.stdout == "done\n", run.stderr[-2000:]
