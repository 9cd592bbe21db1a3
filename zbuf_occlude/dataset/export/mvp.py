"""MVP's layout: 26 partial clouds of 2,048 points and one complete cloud per object, one HDF5 file per split.

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

from pathlib import Path

import h5py

from zbuf_occlude.dataset.export import Exported, Rest, check_pairs, whole_objects
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Source

N_VIEWS, SIZE = 26, 2_048
"""Loaders find the complete cloud of a partial one by dividing its number by 26."""


def check(plan: Plan) -> None:
    """Raise OptionError unless the plan is as the loaders expect."""
    check_pairs(plan, "mvp", n_complete=SIZE, n_views=N_VIEWS, size=SIZE)


def export(source: Source, out: Path) -> Exported:
    """Write a file for each split."""
    assert source.complete is not None  # it is read from the format packed
    files, n_clouds = dict[str, list[str]](), dict[str, int]()
    for split, numbers in whole_objects(source).items():
        name, rest = f"MVP_{split.capitalize()}_CP.h5", Rest(out, split, source.plan, numbers.size)
        with h5py.File(out / name, "w") as h5:
            partial = h5.create_dataset("incomplete_pcds", (numbers.size, SIZE, 3), "<f4", track_times=False)
            complete = h5.create_dataset("complete_pcds", (len(numbers), SIZE, 3), "<f4", track_times=False)
            labels = h5.create_dataset("labels", (numbers.size,), "<i8", track_times=False)
            for row, of_object in enumerate(numbers):
                records, rows = source.take(of_object), slice(row * N_VIEWS, (row + 1) * N_VIEWS)
                partial[rows], labels[rows] = records["data"], records["label"][:, 0]
                complete[row] = source.complete(int(records["mesh_id"][0]), SIZE)["data"]
                rest.write(rows, records)
        older = [f"mvp_{split}_input.h5", f"mvp_{split}_gt_{SIZE}pts.h5"]
        _link(out / older[0], name, ("incomplete_pcds", "labels"))
        _link(out / older[1], name, ("complete_pcds",))
        files[split], n_clouds[split] = [name, rest.name, *older], numbers.size
    return Exported(files, n_clouds)


def _link(path: Path, to: str, arrays: tuple[str, ...]) -> None:
    """Write an HDF5 file whose arrays are another's, and whose arrays of novel classes are empty."""
    with h5py.File(path, "w") as h5:
        for name in arrays:
            h5[name] = h5py.ExternalLink(to, name)
            shape, kind = ((0,), "<i8") if name == "labels" else ((0, SIZE, 3), "<f4")
            h5.create_dataset(f"novel_{name}", shape, kind, track_times=False)
