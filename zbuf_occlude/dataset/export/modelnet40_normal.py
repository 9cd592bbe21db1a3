"""The layout of modelnet40_normal_resampled, as PointNet++'s loaders read it; a cloud is a shape of its own there.

CLASS/CLASS_0001.txt ...                     x,y,z per line, y up; with `--with normals` x,y,z,nx,ny,nz
modelnet40_train.txt, modelnet40_test.txt    CLASS_0001 ... (and modelnet40_val.txt)
modelnet40_shape_names.txt                   the 40 classes

Loaders take the part of a shape's name before its last "_" for its class, and centre and scale each cloud themselves.
The axes are those of modelnet40_ply_hdf5_2048, to which ModelNet40-C turns meshes; about the vertical that is assumed.
"""

from collections import Counter
from pathlib import Path

import numpy as np

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.export import Exported, Rest
from zbuf_occlude.dataset.source import Source


def export(source: Source, out: Path) -> Exported:
    """Write a file per cloud, and the lists of classes and clouds."""
    plan, files, before, ranks = source.plan, dict[str, list[str]](), Counter[str](), []
    for entry in plan.meshes:  # the meshes of each class are numbered
        ranks.append(before[entry.label])
        before[entry.label] += 1
    for split, n_clouds in source.n_clouds.items():
        rest, row, written = Rest(out, split, plan, n_clouds), 0, list[str]()
        for records in source.batches(split):
            rest.write(slice(row, row := row + len(records)), records)
            columns = [records[name] for name in ("data", "normal") if name in (records.dtype.names or ())]
            for record, values in zip(records, np.concatenate(columns, axis=2), strict=True):
                mesh_id, sample = int(record["mesh_id"]), int(record["variation"]) * len(plan.views)
                number = ranks[mesh_id] * plan.clouds_per_mesh + sample + int(record["view_id"]) + 1
                label = plan.meshes[mesh_id].label
                written.append(f"{label}/{label}_{number:04d}.txt")
                (out / label).mkdir(exist_ok=True)
                line = ",".join(["%.9g"] * values.shape[1]) + "\n"
                (out / written[-1]).write_text(line * len(values) % tuple(values.ravel().tolist()))
        atomic.write_lines(out / f"modelnet40_{split}.txt", [Path(name).stem for name in written])
        files[split] = [*written, rest.name]
    atomic.write_lines(out / "modelnet40_shape_names.txt", plan.classes)
    return Exported(files, source.n_clouds)
