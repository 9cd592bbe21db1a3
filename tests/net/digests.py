"""Eight tiny datasets, and digests of what they hold: `python -m tests.net.digests > tests/net/digests.json`.

A digest is of arrays by the key of a cloud (mesh, view, variation), not of bytes of files: it stays the same where
clouds move to other files or rows, or files are written in another way. Where each cloud lies is kept apart (`places`).

Integers and float32 are taken bit by bit: float32 is rounded from float64, so that it is the same on all processors.
The last bits of float64 are not (NumPy's sines by AVX-512, fused multiplication), so it is rounded to steps of 2.7e-9;
an irrational number, or values such as 1/2 could lie between two steps.
"""

import hashlib
import io
import json
import random
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

STEP = np.e * 1e-9
SPLITS = ("train", "test")
Key = tuple[Any, ...]

SMALL = ("--views", "ring:16@20", "--points", "300", "--sample-size", "16")
STREET = (
    *("--sensor", "vlp-16", "--set-sensor", "columns=360", "--range", "5..10", "--views", "random:2@0..9"),
    *("--scene", "street", "--hidden", "0..0.5", "--sample-size", "16", "--least-points", "0"),
)
DATASETS: dict[str, tuple[str, ...]] = {
    # two files of train: 2,880 of 3,840 clouds
    "hdf5": ("--views", "ring:40@20", "--variations", "4", "--points", "200", "--sample-size", "16"),
    "npz": ("--format", "npz", *SMALL),
    "webdataset": ("--format", "webdataset", *SMALL),
    "packed": ("--format", "packed", "--variations", "2", *SMALL),
    "pcn": ("--format", "pcn", "--sample-size", "16"),
    "scanobjectnn": ("--format", "scanobjectnn", *SMALL),
    "modelnet40-c": ("--format", "modelnet40-c", *SMALL),
    "street": STREET,
}
"""Options of `generate` for each."""


def command(*arguments: object) -> list[str]:
    """Return the command line of the program with these arguments."""
    return [sys.executable, "-m", "zbuf_occlude", *map(str, arguments)]


def generate(name: str, meshes: Path, out: Path, *more: object) -> list[str]:
    """Return the command that makes one of the datasets."""
    return command("generate", meshes, "--method", "exact", "--seed", 7, *DATASETS[name], "--out", out, *more)


def convert(packed: Path, out: Path) -> list[str]:
    """Return the command that converts the packed one."""
    return command("convert", packed, "--format", "hdf5", "--out", out)


def write_meshes(folder: Path) -> Path:
    """Write 24 objects of three boxes each, in ModelNet's layout, and one that is no mesh."""
    for i in range(24):
        rng, vertices, faces = random.Random(i), [], []
        for box in range(3):
            low = [rng.randrange(48) / 64 for _ in range(3)]
            high = [x + rng.randrange(4, 32) / 64 for x in low]
            vertices += [" ".join(str((low, high)[corner >> k & 1][k]) for k in range(3)) for corner in range(8)]
            for quad in ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)):
                faces.append("4 " + " ".join(str(8 * box + corner) for corner in quad))
        label, split = ("chair", "desk", "lamp")[i % 3], "test" if i % 4 == 3 else "train"
        path = folder / label / split / f"{label}_{i:04d}.off"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("\n".join([f"OFF\n{len(vertices)} {len(faces)} 0", *vertices, *faces, ""]))
    (folder / "desk" / "train" / "desk_9999.off").write_text("OFF\n8 6 0\n")
    return folder


class Contents:
    """The arrays of a dataset, by name and by key, and the file and row of each cloud."""

    def __init__(self, name: str, out: Path) -> None:
        self.out = out
        self.meshes = (out / "mesh_keys.txt").read_text().splitlines()
        self.arrays: dict[str, dict[Key, NDArray[Any]]] = defaultdict(dict)
        self.places: dict[Key, tuple[str, int]] = {}
        READERS[name](self)
        self.manifest: dict[str, Any] = json.loads((out / "manifest.json").read_text())

    def add(self, key: Key, arrays: Mapping[str, Any]) -> None:
        """Add the arrays of a key."""
        for name, value in arrays.items():
            assert key not in self.arrays[name], f"{name} of {key} is there twice"
            self.arrays[name][key] = np.asarray(value)

    def add_rows(self, path: Path, split: str, arrays: Mapping[str, Any], ids: Mapping[str, Any]) -> None:
        """Add the arrays of a file, a row for each cloud; `ids` say which clouds those are."""
        clouds = zip(ids["mesh_id"], ids["view_id"], ids["variation"], strict=True)
        keys = [(self.meshes[mesh], int(view), int(variation)) for mesh, view, variation in clouds]
        for name, rows in arrays.items():
            assert len(rows) == len(keys), f"{path} has {len(rows)} rows of {name}, where there are {len(keys)} clouds"
        for row, key in enumerate(keys):
            self.add(key, {name: rows[row] for name, rows in arrays.items()} | {"split": split})
            self.places[key] = path.relative_to(self.out).as_posix(), row

    @property
    def digests(self) -> dict[str, Any]:
        """A digest of each array, and what the manifest says of meshes and clouds."""
        counts = self.manifest["counts"]
        return {
            "arrays": {name: digest(arrays) for name, arrays in sorted(self.arrays.items())},
            "classes": (self.out / "shape_names.txt").read_text().split(),
            "counts": {name: counts[name] for name in ("clouds", "clouds_by_split", "meshes", "meshes_failed")},
            "failures": sorted(self.manifest["failures"]),
        }


def digest(arrays: Mapping[Key, NDArray[Any]]) -> str:
    """Return a digest of arrays by key, whatever their order."""
    found = hashlib.sha256()
    for key, values in sorted(arrays.items()):
        whole = np.rint(values / STEP).astype(np.int64) if values.dtype == np.float64 else values
        found.update(f"{key} {values.dtype} {values.shape} ".encode() + np.ascontiguousarray(whole).tobytes())
    return f"{len(arrays)} {found.hexdigest()[:16]}"


def read_hdf5(found: Contents) -> None:
    """Read PointNet's layout, by its lists of files."""
    for split in SPLITS:
        for name in (found.out / f"{split}_files.txt").read_text().split():
            with h5py.File(found.out / name) as file:
                arrays = {field: file[field][:] for field in file}
            found.add_rows(found.out / name, split, arrays, arrays)


def read_npz(found: Contents) -> None:
    """Read NumPy's archives."""
    for path in found.out.glob("*.npz"):
        with np.load(path) as file:
            arrays = dict(file)
        found.add_rows(path, path.name.partition("-")[0], arrays, arrays)


def read_webdataset(found: Contents) -> None:
    """Read tar files, whose members of a number are a cloud."""
    for path in found.out.glob("*.tar"):
        clouds: dict[str, dict[str, Any]] = defaultdict(dict)
        with tarfile.open(path) as file:
            for member in file:
                number, _, field = member.name.partition(".")
                content = file.extractfile(member).read()  # type: ignore[union-attr]
                clouds[number][field] = np.load(io.BytesIO(content)) if field.endswith(".npy") else json.loads(content)
        for row, cloud in enumerate(clouds.values()):
            facts = cloud.pop("json")
            key = facts["mesh"], facts["view_id"], facts["variation"]
            found.add(key, cloud | facts)
            found.places[key] = path.name, row


def read_packed(found: Contents) -> None:
    """Read archives of whole objects, as docs/packed.md describes them."""
    for path in found.out.glob("packed-*.zip"):
        with zipfile.ZipFile(path) as file:
            for name in (name for name in file.namelist() if name.endswith("mesh.json")):
                facts = json.loads(file.read(name))
                found.add((facts["key"],), facts)
                for variation in range(2):
                    steps, faces, visible = (
                        np.frombuffer(file.read(name.replace("mesh.json", f"{variation}.{kind}")), np.uint8)
                        for kind in ("steps", "faces", "visible")
                    )
                    arrays = {
                        "steps": np.stack([unfolded(column, 2) for column in np.split(steps, 3)]),
                        "faces": unfolded(faces, 4),
                        "visible": np.unpackbits(visible.reshape(16, -1), axis=1, count=len(faces) // 4),
                    }
                    assert arrays["faces"].max() < 36, "each object has 36 faces"
                    found.add((facts["key"], variation), arrays)
                    found.places[facts["key"], variation] = path.name, int(name.partition("/")[0])


def unfolded(content: NDArray[Any], width: int) -> NDArray[Any]:
    """Return the integers whose folded differences these bytes are, lowest bytes first."""
    folded = content.reshape(width, -1).T.copy().view(f"<u{width}").ravel()
    differences = (folded >> 1) ^ (0 - (folded & 1))
    return np.cumsum(differences, dtype=differences.dtype)


def read_pcn(found: Contents) -> None:
    """Read pairs of partial and complete clouds, PCD files in folders, and the lists of them."""
    for path in found.out.rglob("*.pcd"):
        place = path.relative_to(found.out).as_posix()
        points = np.frombuffer(path.read_bytes().partition(b"DATA binary\n")[2], "<f4").reshape(-1, 3)
        found.add((place,), {place.split("/")[1]: points})
    for name in ("PCN.json", "shapenet_synset_dict.json"):
        found.add((), {name: json.dumps(json.loads((found.out / name).read_text()), sort_keys=True)})
    read_rest(found)


def read_scanobjectnn(found: Contents) -> None:
    """Read a file of each split, whose rows are those of the file of what the layout has no place for."""
    for split, prefix in zip(SPLITS, ("training", "test"), strict=True):
        name = f"{prefix}_objectdataset_augmentedrot_scale75.h5"
        with h5py.File(found.out / name) as file:
            arrays = {field: file[field][:] for field in file}
        found.add_rows(found.out / name, split, arrays, np.load(found.out / f"clouds_{split}.npy"))
    read_rest(found)


def read_modelnet40_c(found: Contents) -> None:
    """Read a file for each view, whose rows are the objects."""
    for split, folder in zip(SPLITS, (found.out / "train", found.out), strict=True):
        rest, label = np.load(found.out / f"clouds_{split}.npy"), np.load(folder / "label.npy")
        for view in range(16):
            path = folder / f"data_occlusion_{view + 1}.npy"
            found.add_rows(path, split, {"data": np.load(path), "label": label}, rest[rest["view_id"] == view])
    read_rest(found)


def read_rest(found: Contents) -> None:
    """Read what published layouts have no place for: the other fields of the clouds' records."""
    for path in found.out.glob("clouds_*.npy"):
        for record in (rest := np.load(path)):
            key = found.meshes[record["mesh_id"]], int(record["view_id"]), int(record["variation"])
            found.add(key, {f"rest.{field}": record[field] for field in rest.dtype.names})


READERS = {
    "hdf5": read_hdf5,
    "npz": read_npz,
    "webdataset": read_webdataset,
    "packed": read_packed,
    "pcn": read_pcn,
    "scanobjectnn": read_scanobjectnn,
    "modelnet40-c": read_modelnet40_c,
    "street": read_hdf5,
}


def main() -> None:
    """Make all of them, and print their digests."""
    with tempfile.TemporaryDirectory() as folder:
        meshes, found = write_meshes(Path(folder, "meshes")), {}
        for name in DATASETS:
            out = Path(folder, name)
            code = subprocess.run(generate(name, meshes, out), check=False, stdout=sys.stderr).returncode
            assert code == 3, f"{name} ended with {code}, where one mesh must fail"
            found[name] = Contents(name, out).digests
        subprocess.run(convert(Path(folder, "packed"), out := Path(folder, "converted")), check=True, stdout=sys.stderr)
        found["packed converted"] = Contents("hdf5", out).digests
    print(json.dumps(found, indent=1))  # noqa: T201


if __name__ == "__main__":
    main()
