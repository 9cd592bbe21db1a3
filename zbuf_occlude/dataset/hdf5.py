"""The PointNet layout: ply_data_train0.h5 and so on, 2,048 clouds a file, objects of all classes mixed within each."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.plan import Plan, seed_of
from zbuf_occlude.dataset.shard import records_path
from zbuf_occlude.meshes.collection import SPLITS

CLOUDS_A_FILE = 2048
UNITS = {
    "data": "(p - centre) * factor, p the visible points in the frame of attribute `frame`",
    "label": "index into shape_names.txt",
    "face_ids": "index into the faces of the cleaned mesh",
    "mesh_id": "index into mesh_keys.txt",
    "view": "azimuth and elevation in radians, distance in the mesh's units",
    "pose": "view matrix: world space to eye space (x right, y up, looking along -z)",
    "n_visible": "visible points before the subset was drawn",
    "visible_fraction": "of the points sampled on the object",
}


def write_dataset(plan: Plan, out: Path) -> tuple[dict[str, list[str]], dict[str, int]]:
    """Write the final files of a dataset from its finished shards.

    Parameters
    ----------
    plan : Plan
    out : Path
        Folder with all shards done.

    Returns
    -------
    files : dict of split name to file names, in order
    n_clouds : dict of split name to the number of clouds in its files

    Notes
    -----
    Within a split the clouds are in one random order decided by the plan's seed, so classes, objects and views are
    mixed within every file. Memory: one file's clouds; the shards are mapped, not read.
    """
    shards = [np.load(records_path(out, s), mmap_mode="r") for s in range(len(plan.shards))]
    owners = np.concatenate([np.full(len(s), i) for i, s in enumerate(shards)])
    rows = np.concatenate([np.arange(len(s)) for s in shards])
    mesh_ids = np.concatenate([s["mesh_id"] for s in shards])
    split_of_mesh = np.array([SPLITS.index(entry.split) for entry in plan.meshes])
    files: dict[str, list[str]] = {}
    n_clouds: dict[str, int] = {}
    for number, split in enumerate(SPLITS):
        chosen = np.flatnonzero(split_of_mesh[mesh_ids] == number)
        chosen = np.random.default_rng(seed_of(plan.recipe.seed, "order/" + split)).permutation(chosen)
        names: list[str] = []
        for start in range(0, len(chosen), CLOUDS_A_FILE):
            part = chosen[start : start + CLOUDS_A_FILE]
            names.append(f"ply_data_{split}{len(names)}.h5")
            write_file(out / names[-1], fetch(shards, owners[part], rows[part]), plan)
        if names:
            files[split], n_clouds[split] = names, len(chosen)
            atomic.write_lines(out / f"{split}_files.txt", names)
    atomic.write_lines(out / "shape_names.txt", plan.classes)
    atomic.write_lines(out / "mesh_keys.txt", [entry.key for entry in plan.meshes])
    return files, n_clouds


def fetch(shards: list[NDArray[Any]], owners: NDArray[np.intp], rows: NDArray[np.intp]) -> NDArray[Any]:
    """Collect the records ``shards[owners[i]][rows[i]]`` in the order of i."""
    records = np.empty(len(rows), shards[0].dtype)
    for owner in np.unique(owners):
        mine = owners == owner
        records[mine] = shards[owner][rows[mine]]
    return records


def write_file(path: Path, records: NDArray[Any], plan: Plan) -> None:
    """Write one HDF5 file: a dataset for each field of the records, its meaning in the attribute `meaning`."""

    def fill(file: Any) -> None:
        with h5py.File(file, "w", track_order=True) as h5:
            h5.attrs["frame"] = plan.recipe.frame
            h5.attrs["scale"] = plan.recipe.scale
            h5.attrs["fingerprint"] = plan.fingerprint
            for name in records.dtype.names or ():
                dataset = h5.create_dataset(name, data=np.ascontiguousarray(records[name]), track_times=False)
                if name in UNITS:
                    dataset.attrs["meaning"] = UNITS[name]

    atomic.write(path, fill)
