"""Layouts of benchmarks of classification: ScanObjectNN, ModelNet40-C, ModelNet-O and modelnet40_normal_resampled."""

from collections import Counter
from pathlib import Path

import numpy as np

from zbuf_occlude.base import atomic
from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import OptionError
from zbuf_occlude.datasets.export import CloudFields, Exported, Layout, Rows, incomplete, names_of, whole_objects
from zbuf_occlude.datasets.formats.hdf5 import new_h5
from zbuf_occlude.datasets.plan import Plan
from zbuf_occlude.datasets.source import CloudReader


def export_scanobjectnn(source: CloudReader, out: Path) -> Exported:
    """Write ScanObjectNN's layout, its variant PB_T50_RS: {training,test,val}_objectdataset_augmentedrot_scale75.h5.

    data   (n, size, 3) float32, y up
    label  (n,) int64, by its list of 15 names
    mask   (n, size) int64: -1 of points that are not the object's (`--keep box` or `all`), else 0
    """
    files, size = dict[str, list[str]](), source.plan.config.equal_size
    for split, n_clouds in source.n_clouds.items():
        name = f"{'training' if split == 'train' else split}_objectdataset_augmentedrot_scale75.h5"
        rest = CloudFields(out, split, source.plan, n_clouds)
        with new_h5(out / name) as h5:
            data = h5.create_dataset("data", (n_clouds, size, 3), "<f4", track_times=False)
            label = h5.create_dataset("label", (n_clouds,), "<i8", track_times=False)
            mask = h5.create_dataset("mask", (n_clouds, size), "<i8", track_times=False)  # zeros take no room
            for rows, records in rest.batches(source, split):
                data[rows], label[rows] = records["data"], records["label"][:, 0]
                if "instance" in (records.dtype.names or ()):
                    mask[rows] = -(records["instance"] != 0).astype(np.int64)
        files[split] = [name, rest.name]
    return Exported(files, source.n_clouds)


def export_modelnet40_c(source: CloudReader, out: Path) -> Exported:
    """Write ModelNet40-C's layout: an array per view, its corruption occlusion or lidar, its level the view from 1.

    data_occlusion_1.npy, data_occlusion_2.npy ...    (n, size, 3) float32, an object per row; y up
    label.npy                                         (n, 1) int64, for all of them

    With a spinning sensor the corruption is lidar. That is the split test, the only one that the benchmark has; others
    lie in a folder of their name.

    References
    ----------
    jiachens/ModelNet40-C, data/generate_c.py, occlusion() and lidar(): both turn (x, y, z) to (-x, z, y); occlusion()
    ends with normalize(), which centres each cloud and makes its longest side 2; lidar() leaves the cloud in the frame
    in which data/occlusion.py, occlusion_1(), has centred the mesh, its longest side 2 (scale "object").
    """
    plan, files, n_clouds = source.plan, dict[str, list[str]](), dict[str, int]()
    scan = plan.config.scan
    corruption = "lidar" if scan is not None and scan.sensor.kind == "spinning" else "occlusion"
    for split, numbers in whole_objects(source).items():
        folder = "" if split == "test" else f"{split}/"
        (out / folder).mkdir(exist_ok=True)
        rest, n_views = CloudFields(out, split, plan, numbers.size), len(plan.views)
        names = [f"{folder}data_{corruption}_{view + 1}.npy" for view in range(n_views)]
        shape = (len(numbers), plan.config.equal_size, 3)
        arrays = [Rows(out / name, np.dtype("<f4"), shape) for name in names]
        labels = np.zeros((len(numbers), 1), np.int64)
        place = np.full(max(map(np.max, source.order.values())) + 1, -1)
        place[numbers.reshape(-1)] = np.arange(numbers.size)
        begin = 0
        for records in source.batches(split):  # in the order of the files, where they are read fast
            places = place[source.order[split][begin : begin + len(records)]]
            begin += len(records)
            whole, places = records[places >= 0], places[places >= 0]
            rest.write(places, whole)
            labels[places // n_views] = whole["label"]
            for view in range(n_views):
                mine = places % n_views == view
                arrays[view].write(places[mine] // n_views, whole["data"][mine])
        Rows(out / f"{folder}label.npy", labels.dtype, labels.shape).write(slice(0, len(labels)), labels)
        files[split], n_clouds[split] = [*names, f"{folder}label.npy", rest.name], numbers.size
    return Exported(files, n_clouds, left_out=incomplete(source))


def export_modelnet_o(source: CloudReader, out: Path) -> Exported:
    """Write ModelNet-O's layout: CLASS/{train,test}/OBJECT_001.xyz ..., a text file per cloud, x y z per line."""
    plan, names, files = source.plan, names_of(source.plan), dict[str, list[str]]()
    for split, n_clouds in source.n_clouds.items():
        rest, files[split] = CloudFields(out, split, plan, n_clouds), []
        for _, records in rest.batches(source, split):
            for record in records:
                mesh_id, sample = int(record["mesh_id"]), int(record["variation"]) * len(plan.views)
                number = sample + int(record["view_id"]) + 1
                name = f"{names.classes[mesh_id]}/{split}/{names.objects[mesh_id]}_{number:03d}.xyz"
                _write_text(out / name, record["data"], " ")
                files[split].append(name)
        files[split].append(rest.name)
    return Exported(files, source.n_clouds)


def export_modelnet40_normal(source: CloudReader, out: Path) -> Exported:
    """Write the layout of modelnet40_normal_resampled, as PointNet++'s loaders read it; each cloud is a shape there.

    CLASS/CLASS_0001.txt ...                     x,y,z per line, y up; with `--with normals` x,y,z,nx,ny,nz
    modelnet40_train.txt, modelnet40_test.txt    CLASS_0001 ... (and modelnet40_val.txt)
    modelnet40_shape_names.txt                   the 40 classes

    Loaders take the part of a shape's name before its last "_" for its class, and centre and scale each cloud
    themselves. The axes are those of modelnet40_ply_hdf5_2048, to which ModelNet40-C turns meshes; about the vertical
    that is assumed.
    """
    plan, files, before, ranks = source.plan, dict[str, list[str]](), Counter[str](), []
    for entry in plan.meshes:  # the meshes of each class are numbered
        ranks.append(before[entry.label])
        before[entry.label] += 1
    for split, n_clouds in source.n_clouds.items():
        rest, written = CloudFields(out, split, plan, n_clouds), list[str]()
        for _, records in rest.batches(source, split):
            columns = [records[name] for name in ("data", "normal") if name in (records.dtype.names or ())]
            for record, values in zip(records, np.concatenate(columns, axis=2), strict=True):
                mesh_id, sample = int(record["mesh_id"]), int(record["variation"]) * len(plan.views)
                number = ranks[mesh_id] * plan.clouds_per_mesh + sample + int(record["view_id"]) + 1
                label = plan.meshes[mesh_id].label
                written.append(f"{label}/{label}_{number:04d}.txt")
                _write_text(out / written[-1], values, ",")
        atomic.write_lines(out / f"modelnet40_{split}.txt", [Path(name).stem for name in written])
        files[split] = [*written, rest.name]
    atomic.write_lines(out / "modelnet40_shape_names.txt", plan.classes)
    return Exported(files, source.n_clouds)


def _write_text(path: Path, values: FloatArray, separator: str) -> None:
    """Write a line of text for each row; nine digits are the number itself, in a third of np.savetxt's time."""
    path.parent.mkdir(parents=True, exist_ok=True)
    line = separator.join(["%.9g"] * values.shape[1]) + "\n"
    path.write_text(line * len(values) % tuple(values.ravel().tolist()))


def check_modelnet40_c(plan: Plan) -> None:
    """Raise OptionError unless there is one cloud per object and view, as one array of labels for all arrays needs."""
    if plan.config.variations != 1:
        raise OptionError(
            f"modelnet40-c must have one cloud per object and view; got --variations {plan.config.variations}. Give 1."
        )


SCANOBJECTNN = Layout(export_scanobjectnn)
MODELNET40_C = Layout(export_modelnet40_c, check_modelnet40_c)
MODELNET_O = Layout(export_modelnet_o)
MODELNET40_NORMAL = Layout(export_modelnet40_normal)
