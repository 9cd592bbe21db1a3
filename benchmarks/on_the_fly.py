"""How many occluded clouds per second `OnTheFlyOcclusion` gives one core: python benchmarks/on_the_fly.py

Built-in shapes of 2,000 to 5,000 faces, one thread; per second of wall clock and, for busy machines, of CPU time.
"again": the mesh is known; "first": cleaning and preparing it are in the time. "worker": through a DataLoader of one
worker, in batches of 32, everything included but its start.
"""

import time

import numpy as np
import torch
from common import run

from zbuf_occlude.base.jit.threads import use_threads
from zbuf_occlude.datasets.torch import OnTheFlyOcclusion
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes import shapes


class Occluded(torch.utils.data.Dataset):
    """Clouds of some meshes, over and over."""

    def __init__(self, meshes: list[Mesh], transform: OnTheFlyOcclusion, n_clouds: int) -> None:
        self.meshes, self.transform, self.n_clouds = meshes, transform, n_clouds

    def __len__(self) -> int:
        return self.n_clouds

    def __getitem__(self, index: int) -> torch.Tensor:
        return self.transform(self.meshes[index % len(self.meshes)])


def choose(n_meshes: int) -> list[Mesh]:
    found = []
    for index in range(shapes.MEMBERS):
        for label in shapes.CLASSES:
            mesh = shapes.make(label, index)
            if 2000 <= len(mesh.faces) <= 5000:
                found.append(mesh)
            if len(found) == n_meshes:
                return found
    return found


def main(*, points: int = 1024, meshes: int = 16, seconds: float = 5.0) -> None:
    some = choose(meshes)
    print(f"{len(some)} meshes, {np.median([len(mesh.faces) for mesh in some]):.0f} faces in the median")
    use_threads(1)
    torch.set_num_threads(1)
    for eyes in (1, 8):
        occlude = OnTheFlyOcclusion(points, eyes_per_sampling=eyes)
        occlude(shapes.make("chair", 900))  # compiles
        for name, least in (("first", 0.0), ("again", seconds)):
            n_clouds, wall, cpu = 0, time.perf_counter(), time.process_time()
            while n_clouds == 0 or time.perf_counter() - wall < least:
                for mesh in some:
                    occlude(mesh)
                n_clouds += len(some)
            wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
            print(
                f"eyes_per_sampling {eyes}, {name}: {n_clouds / wall:.0f} clouds/s, {n_clouds / cpu:.0f} a CPU second"
            )
    data = Occluded(some, OnTheFlyOcclusion(points), 20_000)
    loader = torch.utils.data.DataLoader(data, batch_size=32, num_workers=1, multiprocessing_context="spawn")
    batches = iter(loader)
    for _ in range(20):
        next(batches)
    n_clouds, began = 0, time.perf_counter()
    while time.perf_counter() - began < seconds:
        n_clouds += len(next(batches))
    print(f"worker: {n_clouds / (time.perf_counter() - began):.0f} clouds/s")


if __name__ == "__main__":
    run(main, __doc__)
