"""ModelNet40-C's layout: one array per view, its corruption occlusion or lidar, its level the view's number from 1.

    data_occlusion_1.npy, data_occlusion_2.npy ...    (n, size, 3) float32, an object per row; y up
    label.npy                                         (n, 1) int64, for all of them

With a spinning sensor the corruption is lidar. That is the split test, the only one that the benchmark has; others lie
in a folder of their name.

References
----------
jiachens/ModelNet40-C, data/generate_c.py, occlusion() and lidar(): both turn (x, y, z) to (-x, z, y); occlusion() ends
with normalize(), which centres each cloud and makes its longest side 2; lidar() leaves the cloud in the frame in which
data/occlusion.py, occlusion_1(), has centred the mesh, its longest side 2 (recipe's scale "object").
"""

from pathlib import Path

import numpy as np

from zbuf_occlude.dataset.export import Exported, Rest, whole_objects
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Source
from zbuf_occlude.errors import OptionError


def check(plan: Plan) -> None:
    """Raise OptionError unless there is one cloud per object and view, as one array of labels for all arrays needs."""
    if plan.recipe.variations != 1:
        raise OptionError(
            f"modelnet40-c must have one cloud per object and view; got --variations {plan.recipe.variations}. Give 1."
        )


def export(source: Source, out: Path) -> Exported:
    """Write an array per view, and the labels."""
    plan, files, n_clouds = source.plan, dict[str, list[str]](), dict[str, int]()
    setup = plan.recipe.setup
    corruption = "lidar" if setup is not None and setup.made_sensor.kind == "spinning" else "occlusion"
    for split, numbers in whole_objects(source).items():
        folder = "" if split == "test" else f"{split}/"
        (out / folder).mkdir(exist_ok=True)
        rest, n_views = Rest(out, split, plan, numbers.size), len(plan.views)
        names = [f"{folder}data_{corruption}_{view + 1}.npy" for view in range(n_views)]
        shape = (len(numbers), plan.recipe.equal_size, 3)
        arrays = [np.lib.format.open_memmap(out / name, "w+", np.dtype("<f4"), shape) for name in names]
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
                arrays[view][places[mine] // n_views] = whole["data"][mine]
        np.save(out / f"{folder}label.npy", labels)
        files[split], n_clouds[split] = [*names, f"{folder}label.npy", rest.name], numbers.size
    return Exported(files, n_clouds)
