"""How long ModelNet-O's 246,220 clouds take: built-in shapes x 20 views in its layout, measured and extrapolated.

python benchmarks/modelnet_o.py [SHAPES] [WORKERS]      1,000 shapes in as many processes as there are cores
"""

import tempfile
import time
from functools import partial
from pathlib import Path

from common import run

from zbuf_occlude.base.cores import n_cores
from zbuf_occlude.base.limits import Limits
from zbuf_occlude.datasets.generate import generate
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.datasets.workers import local
from zbuf_occlude.meshes import shapes

WHOLE = 246_220


def main(n_shapes: int = 1_000, n_workers: int = n_cores()) -> None:
    collection = shapes.collection(n_members=-(-n_shapes // 8)).interleaved().limit(n_shapes)
    config = DatasetConfig(method="exact", views="fibonacci:20", subset="fps")
    local_run = partial(local.run_local, n_workers=n_workers, limits=Limits())
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        manifest = generate(Plan(collection, config, "modelnet-o"), Path(folder) / "out", run=local_run)
        seconds = time.perf_counter() - began
    n_clouds = manifest["counts"]["clouds"]
    print(f"{n_shapes:,} shapes, {n_clouds:,} clouds, {n_workers} workers")
    whole = seconds / n_clouds * WHOLE / 60
    print(f"{seconds:.1f} s, {1e3 * seconds / n_clouds:.2f} ms per cloud, all: {whole:.1f} min")
    print(manifest["seconds"])


if __name__ == "__main__":
    run(main, __doc__)
