"""Layouts of point cloud completion: partial clouds and the complete cloud of each object, for the loaders of each."""

from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from zbuf_occlude.base import atomic
from zbuf_occlude.base.errors import OptionError
from zbuf_occlude.base.point_files import write_pcd
from zbuf_occlude.datasets.export import (
    CloudFields,
    Exported,
    Layout,
    Names,
    check_one_frame,
    incomplete,
    names_of,
    whole_objects,
)
from zbuf_occlude.datasets.export.pairs_reader import read_files_of_pairs, read_mvp
from zbuf_occlude.datasets.formats.hdf5 import new_h5
from zbuf_occlude.datasets.plan import CLOUDS_PER_FILE, Plan
from zbuf_occlude.datasets.source import CloudReader
from zbuf_occlude.meshes.collection import SPLITS

MVP_VIEWS, MVP_SIZE = 26, 2_048
"""Loaders find the complete cloud of a partial one by dividing its number by 26."""
WHOLE = "shapenet_pc/{taxonomy}-{name}.npy"
"""An object's complete cloud; loaders split it at the hyphen and the dot."""


def export_pcn(source: CloudReader, out: Path) -> Exported:
    """Write PCN's layout, as the loaders of GRNet, PoinTr and SnowflakeNet read it.

    SPLIT/complete/TAXONOMY/OBJECT.pcd           16,384 points
    SPLIT/partial/TAXONOMY/OBJECT/00.pcd ...     one per view: eight in train, one in val and test
    PCN.json                                     taxonomy_id, taxonomy_name, and the objects of train, val, test
    shapenet_synset_dict.json                    what each taxonomy is called
    """
    names = names_of(source.plan)
    complete, of_view = "{split}/complete/{taxonomy}/{name}.pcd", "{split}/partial/{taxonomy}/{name}/{view:02d}.pcd"
    exported, mesh_ids = _export_pairs(source, out, names, 16_384, complete, of_view, n_tested=1)
    _write_index(out / "PCN.json", source.plan, names, mesh_ids)
    _write_synsets(out, source.plan, names)
    return exported


def export_completion3d(source: CloudReader, out: Path) -> Exported:
    """Write Completion3D's layout: a partial and a complete cloud of 2,048 points per object, each an HDF5 file.

    SPLIT/partial/TAXONOMY/OBJECT.h5    data (2048, 3) float32
    SPLIT/gt/TAXONOMY/OBJECT.h5         data (2048, 3) float32
    SPLIT.list                          TAXONOMY/OBJECT, one per line, as TopNet's loaders read it
    Completion3D.json                   the same as PCN.json, as those of GRNet and PoinTr do
    synsetoffset2category.txt           NAME TAXONOMY per line, one word each, as lynetcha/completion3d reads it
    shapenet_synset_dict.json           what each taxonomy is called
    """
    names = names_of(source.plan)
    complete, of_view = "{split}/gt/{taxonomy}/{name}.h5", "{split}/partial/{taxonomy}/{name}.h5"
    exported, mesh_ids = _export_pairs(source, out, names, 2_048, complete, of_view)
    for split, of_split in mesh_ids.items():
        atomic.write_lines(out / f"{split}.list", [f"{names.taxonomies[i]}/{names.objects[i]}" for i in of_split])
    _write_index(out / "Completion3D.json", source.plan, names, mesh_ids)
    words = dict(zip(names.taxonomies, names.classes, strict=True))
    lines = [f"{words[taxonomy]}\t{taxonomy}" for taxonomy in sorted(words)]
    atomic.write_lines(out / "synsetoffset2category.txt", lines)
    _write_synsets(out, source.plan, names)
    return exported


def export_epn3d(source: CloudReader, out: Path) -> Exported:
    """Write EPN3D's layout, as the loaders of P2C read 3D-EPN's objects: pairs of 2,048 points, an array each.

    CLASS/complete/OBJECT.npy          (2048, 3) float32; in the camera's frame OBJECT__0__.npy ..., one per view
    CLASS/partial/OBJECT__0__.npy ...  one per view
    EPN3D.json                         taxonomy_id, taxonomy_name; of train, val, test the names of partial and complete
                                       clouds, as many of each

    References
    ----------
    CuiRuikai/Partial2Complete, datasets/EPNDataset.py, EPN3D.
    """
    names, n_views = names_of(source.plan), len(source.plan.views)
    whole, of_view = "{name}", "{name}__{view}__"
    if source.plan.config.frame == "camera":
        whole = of_view
    files = f"{{label}}/complete/{whole}.npy", f"{{label}}/partial/{of_view}.npy"
    exported, mesh_ids = _export_pairs(source, out, names, 2_048, *files)
    index: dict[str, dict[str, Any]] = {}
    for split, of_split in mesh_ids.items():
        for i in of_split:
            row: dict[str, Any] = {"taxonomy_id": names.taxonomies[i], "taxonomy_name": names.classes[i]}
            row |= {each: {"partial": [], "complete": []} for each in SPLITS}
            row = index.setdefault(names.classes[i], row)[split]
            row["partial"] += [names.object_file(of_view, i, view=view) for view in range(n_views)]
            row["complete"] += [names.object_file(whole, i, view=view) for view in range(n_views)]
    atomic.write_json(out / "EPN3D.json", [index[name] for name in sorted(index)])
    return exported


def export_projected_shapenet(source: CloudReader, out: Path) -> Exported:
    """Write Projected-ShapeNet's layout, as AdaPoinTr's loaders read it.

    projected_partial_noise/TAXONOMY/OBJECT/models/0.pcd ... 15.pcd    partial clouds
    shapenet_pc/TAXONOMY-OBJECT.npy                                    complete clouds, (8192, 3) float32
    train.txt, test.txt (and val.txt)                                  shapenet_pc/TAXONOMY-OBJECT.npy, one per line
    shapenet_synset_dict.json                                          what each taxonomy is called
    """
    names, of_view = names_of(source.plan), "projected_partial_noise/{taxonomy}/{name}/models/{view}.pcd"
    exported, mesh_ids = _export_pairs(source, out, names, 8_192, WHOLE, of_view)
    for split, of_split in mesh_ids.items():
        atomic.write_lines(out / f"{split}.txt", [names.object_file(WHOLE, i) for i in of_split])
    _write_synsets(out, source.plan, names)
    return exported


def export_shapenet55(source: CloudReader, out: Path) -> Exported:
    """Write ShapeNet-55's layout, as the loaders of PoinTr and Point-MAE read it: complete clouds, which they crop.

    shapenet_pc/TAXONOMY-OBJECT.npy      (8192, 3) float32
    train.txt, test.txt (and val.txt)    names of these files, one per line
    shapenet_synset_dict.json            what each taxonomy is called
    """
    names, files, n_clouds = names_of(source.plan), dict[str, list[str]](), dict[str, int]()
    (out / "shapenet_pc").mkdir()
    for split, numbers in whole_objects(source, n_kept=1).items():
        rest, written = CloudFields(out, split, source.plan, numbers.size), list[str]()
        for begin in range(0, numbers.size, CLOUDS_PER_FILE):
            records = source.take(numbers[begin : begin + CLOUDS_PER_FILE, 0])
            rest.write(slice(begin, begin + len(records)), records)
            for record in records:
                written.append(names.object_file(WHOLE, int(record["mesh_id"])))
                _write_npy(out / written[-1], record)
        atomic.write_lines(out / f"{split}.txt", [Path(name).name for name in written])
        files[split], n_clouds[split] = [*written, rest.name], len(written)
    _write_synsets(out, source.plan, names)
    return Exported(files, n_clouds, left_out=incomplete(source))


def export_mvp(source: CloudReader, out: Path) -> Exported:
    """Write MVP's layout: 26 partial clouds of 2,048 points and a complete one per object, an HDF5 file per split.

    MVP_Train_CP.h5, MVP_Test_CP.h5 (and MVP_Val_CP.h5)
        incomplete_pcds  (26 n, 2048, 3) float32, the 26 of an object one after the other
        complete_pcds    (n, 2048, 3) float32
        labels           (26 n,) int64, by its list of 16 names
    mvp_train_input.h5, mvp_train_gt_2048pts.h5, mvp_test_input.h5, ...
        the same under the names that VRCNet reads, as links to those files; novel_incomplete_pcds, novel_labels and
        novel_complete_pcds are empty

    References
    ----------
    paul007pl/MVP_Benchmark, completion/dataset.py, MVP_CP; paul007pl/VRCNet, dataset.py, ShapeNetH5.
    """
    assert source.complete is not None  # it is read from the format packed
    files, n_clouds, size = dict[str, list[str]](), dict[str, int](), MVP_SIZE
    for split, numbers in whole_objects(source).items():
        name, rest = f"MVP_{split.capitalize()}_CP.h5", CloudFields(out, split, source.plan, numbers.size)
        with new_h5(out / name) as h5:
            partials = h5.create_dataset("incomplete_pcds", (numbers.size, size, 3), "<f4", track_times=False)
            complete = h5.create_dataset("complete_pcds", (len(numbers), size, 3), "<f4", track_times=False)
            labels = h5.create_dataset("labels", (numbers.size,), "<i8", track_times=False)
            for row, of_object in enumerate(numbers):
                records, rows = source.take(of_object), slice(row * MVP_VIEWS, (row + 1) * MVP_VIEWS)
                partials[rows], labels[rows] = records["data"], records["label"][:, 0]
                complete[row] = source.complete(records[0], size)["data"]
                rest.write(rows, records)
        older = [f"mvp_{split}_input.h5", f"mvp_{split}_gt_{size}pts.h5"]
        _link(out / older[0], name, ("incomplete_pcds", "labels"))
        _link(out / older[1], name, ("complete_pcds",))
        files[split], n_clouds[split] = [name, rest.name, *older], numbers.size
    return Exported(files, n_clouds, left_out=incomplete(source))


def _export_pairs(
    source: CloudReader,
    out: Path,
    names: Names,
    n_complete: int,
    complete: str,
    of_view: str,
    n_tested: int | None = None,
) -> tuple[Exported, dict[str, list[int]]]:
    """Write a file for each complete cloud and for each partial one of it; return also the objects of each split.

    Their names are filled into `complete` and `of_view`. Of each object in val and test the first `n_tested` views are
    kept.
    """
    assert source.complete is not None  # it is read from the format packed
    files, n_clouds, mesh_ids = dict[str, list[str]](), dict[str, int](), dict[str, list[int]]()
    with_normals = "normals" in source.plan.config.attributes  # of scans they are in each record
    for split in source.order:
        numbers = whole_objects(source, None if split == "train" else n_tested)[split]
        rest, files[split], mesh_ids[split] = CloudFields(out, split, source.plan, numbers.size), [], []
        for row, of_object in enumerate(numbers):
            records = source.take(of_object)
            rest.write(slice(row * len(of_object), (row + 1) * len(of_object)), records)
            mesh_id = int(records["mesh_id"][0])
            mesh_ids[split].append(mesh_id)
            fields = [name for name in records.dtype.names or () if name != "normal" or with_normals]
            one_frame = source.plan.config.frame != "camera"  # else each view has a complete cloud of its own
            for sharing in [records] if one_frame else np.split(records, len(records)):
                whole = source.complete(sharing[0], n_complete)
                for pattern, record in [(complete, whole), *((of_view, each) for each in sharing[fields])]:
                    name = names.object_file(pattern, mesh_id, split=split, view=int(record["view_id"]))
                    (out / name).parent.mkdir(parents=True, exist_ok=True)
                    _WRITERS[Path(name).suffix](out / name, record)
                    files[split].append(name)
        files[split].append(rest.name)
        n_clouds[split] = numbers.size
    return Exported(files, n_clouds, left_out=incomplete(source)), mesh_ids


def _write_index(path: Path, plan: Plan, names: Names, mesh_ids: dict[str, list[int]]) -> None:
    """Write what the loaders of GRNet and its successors begin with: the objects of each taxonomy and split."""
    index: dict[str, dict[str, Any]] = {}
    for split, of_split in mesh_ids.items():
        for mesh_id in of_split:
            taxonomy, label = names.taxonomies[mesh_id], plan.meshes[mesh_id].label
            row = {"taxonomy_id": taxonomy, "taxonomy_name": label, **{other: [] for other in SPLITS}}
            index.setdefault(taxonomy, row)[split].append(names.objects[mesh_id])
    atomic.write_json(path, [index[taxonomy] for taxonomy in sorted(index)])


def _write_synsets(folder: Path, plan: Plan, names: Names) -> None:
    """Write what each taxonomy is called; PoinTr's report of a test ends at one that its own list lacks."""
    called = {taxonomy: entry.label for taxonomy, entry in zip(names.taxonomies, plan.meshes, strict=True)}
    atomic.write_json(folder / "shapenet_synset_dict.json", called)


def _write_npy(path: Path, record: Any) -> None:
    atomic.write(path, lambda file: np.save(file, record["data"].astype(np.float32)), synced=False)


def _write_h5(path: Path, record: Any) -> None:
    with new_h5(path) as h5:
        h5.create_dataset("data", data=record["data"].astype(np.float32), track_times=False)


_WRITERS = {".pcd": write_pcd, ".npy": _write_npy, ".h5": _write_h5}
"""Writer of a record's points, by the ending of the file."""


def _link(path: Path, to: str, arrays: tuple[str, ...]) -> None:
    """Write an HDF5 file with the arrays of another one, and with empty arrays of novel classes."""
    with new_h5(path) as h5:
        for name in arrays:
            h5[name] = h5py.ExternalLink(to, name)
            shape, kind = ((0,), "<i8") if name == "labels" else ((0, MVP_SIZE, 3), "<f4")
            h5.create_dataset(f"novel_{name}", shape, kind, track_times=False)


def _check(
    plan: Plan, n_complete: int, n_views: int | None = None, size: int | None = None, *, own_complete: bool = False
) -> None:
    """Raise OptionError unless a plan makes pairs of partial and complete clouds as a layout's loaders expect them.

    `n_views` per object and `size` of a partial cloud, where loaders have a number in their code. `own_complete` is
    True for a layout that has place for a complete cloud of each view, as the camera's frame needs it.
    """
    config = plan.config
    for what, option, found, wanted in (
        ("number of views per object", "--views random:", len(plan.views), n_views),
        ("number of variations", "--variations ", config.variations, 1),
        ("number of points per partial cloud", "--sample-size ", config.sample_size, size),
    ):
        if wanted is not None and found != wanted:
            raise OptionError(
                f"the {what} of {plan.format} must be {wanted:,}, for its loaders count on it; it is {found:,}. Give "
                f"{option}{wanted}."
            )
    if config.n_points is None or config.n_points < n_complete:
        sampled = "a density" if config.n_points is None else f"{config.n_points:,}"
        raise OptionError(
            f"{plan.format} must have {n_complete:,} points in each complete cloud; got {sampled}. "
            f"Give --points {n_complete}."
        )
    if plan.config.frame == "camera" and not own_complete:
        raise OptionError(
            f"{plan.format} must have one frame for all views of an object, for they share a complete cloud; got "
            "--frame camera. Choose --format completion3d or epn3d; or packed, which zo.torch.CompletionPairs reads."
        )
    check_one_frame(plan, of_object=not own_complete)


PCN = Layout(export_pcn, partial(_check, n_complete=16_384, n_views=8), read_files_of_pairs)
COMPLETION3D = Layout(
    export_completion3d,
    partial(_check, n_complete=2_048, n_views=1, size=2_048, own_complete=True),
    read_files_of_pairs,
)
EPN3D = Layout(export_epn3d, partial(_check, n_complete=2_048, size=2_048, own_complete=True), read_files_of_pairs)
PROJECTED_SHAPENET = Layout(
    export_projected_shapenet, partial(_check, n_complete=8_192, n_views=16), read_files_of_pairs
)
SHAPENET55 = Layout(export_shapenet55, partial(_check, n_complete=8_192, size=8_192))
MVP = Layout(export_mvp, partial(_check, n_complete=MVP_SIZE, n_views=MVP_VIEWS, size=MVP_SIZE), read_mvp)
