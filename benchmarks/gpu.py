"""Lines of sight per second of tensors on a GPU, answered by `zo.torch.visible`; never run on one yet.

    python benchmarks/gpu.py --warp [MESH ...] [--device cuda] [--points 100000] [--eyes 25] [--repeats 9]

--warp adds Warp's own float32 `mesh_query_ray`, and the share of its answers that differ. Its rays start a contact
tolerance before each point and know no own face. Without meshes: built-in shapes, and balls of up to 1.3 million faces.
All start from float64 tensors on the device; the median of the repeats counts, the device waited for. Preparing is from
tensors to a BVH. `--device cpu` is for a look at whether it works.
"""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
import warp as wp
from common import run

import zbuf_occlude as zo
from zbuf_occlude.datasets.torch.tensors import TensorMesh
from zbuf_occlude.meshes import shapes
from zbuf_occlude.meshes.shapes import solids
from zbuf_occlude.visibility.interface import CONTACT

Vectors = wp.array(dtype=wp.vec3)


@wp.kernel
def fill_by_warp(
    mesh: wp.uint64, tau: float, points: Vectors, eyes: Vectors, visible: wp.array2d(dtype=wp.bool)
) -> None:
    """Fill in which points eyes see as a user of Warp would: one ray a point, in float32."""
    k, i = wp.tid()
    distance = wp.length(eyes[k] - points[i])
    towards = (eyes[k] - points[i]) / distance
    hit = wp.mesh_query_ray(mesh, points[i] + tau * towards, towards, distance - tau)
    visible[k, i] = not hit.result


def seconds_of(job: Callable[[], Any], device: torch.device, repeats: int) -> tuple[float, Any]:
    """Return the median seconds of a job, the device waited for, and what it returns; the first may compile."""
    times = []
    for _ in range(repeats + 1):
        wait_for(device)
        began = time.perf_counter()
        answer = job()
        wait_for(device)
        times.append(time.perf_counter() - began)
    return float(np.median(times[1:])), answer


def wait_for(device: torch.device) -> None:
    if device.type == "cuda":
        torch.cuda.synchronize(device)


def meshes_of(paths: Sequence[Path]) -> list[zo.Mesh]:
    if paths:
        return [zo.load_mesh(path) for path in paths]
    return [shapes.make(name, 0) for name in ("chair", "car")] + [solids.icosphere(level) for level in (5, 8)]


def main(
    *meshes: Path, warp: bool = False, device: str = "cuda", points: int = 100_000, eyes: int = 25, repeats: int = 9
) -> None:
    place = torch.empty(0, device=device).device
    name = torch.cuda.get_device_name(place) if place.type == "cuda" else "CPU, one core"
    print(f"{name}: {points:,} points, {eyes} eyes; million lines of sight per second")
    print(f"{'mesh':20} {'faces':>9} {'prepare ms':>11} {'exact':>9}", end="")
    print(f" {'float32':>9} {'differ':>9}" if warp else "")
    for mesh in meshes_of(meshes):
        drawn = zo.sample_surface(mesh, n_points=points, seed=0)
        stands = zo.views.for_mesh(mesh, f"fibonacci:{eyes}").eyes
        given = (mesh.vertices, mesh.faces, drawn.positions, drawn.face_ids, stands)
        vertices, faces, *asked = (torch.tensor(each, device=place) for each in given)
        prepare, _ = seconds_of(lambda: TensorMesh(vertices, faces), place, repeats)  # noqa: B023
        ours, mask = seconds_of(lambda: zo.torch.visible(vertices, faces, *asked), place, repeats)  # noqa: B023
        print(f"{mesh.name:20} {len(faces):9,} {1e3 * prepare:11.2f} {mask.numel() / ours / 1e6:9.2f}", end="")
        if warp:
            corners, *shared = (wp.from_torch(each.float(), wp.vec3) for each in (vertices, asked[0], asked[2]))
            wait_for(place)  # Warp's stream is another
            scene = wp.Mesh(corners, wp.from_torch(faces.reshape(-1)))
            theirs = torch.empty_like(mask)
            inputs = [scene.id, CONTACT * mesh.diagonal, *shared, wp.from_torch(theirs)]
            launch = {"kernel": fill_by_warp, "dim": theirs.shape, "inputs": inputs, "device": scene.device}
            seconds, _ = seconds_of(lambda: wp.launch(**launch), place, repeats)  # noqa: B023
            differ = float((theirs != mask).double().mean())
            print(f" {mask.numel() / seconds / 1e6:9.2f} {differ:9.5f}", end="")
        print(flush=True)


if __name__ == "__main__":
    run(main, __doc__)
