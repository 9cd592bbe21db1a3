"""Voxels: the partial signed distances of each view beside the complete ones, as loaders of PatchComplete have them."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base import atomic
from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import OptionError
from zbuf_occlude.base.extras import importing
from zbuf_occlude.datasets.export import Exported, incomplete, names_of, whole_objects
from zbuf_occlude.datasets.formats import find_format
from zbuf_occlude.datasets.plan import Plan
from zbuf_occlude.datasets.source import CloudReader
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.views import fibonacci
from zbuf_occlude.visibility import prepare
from zbuf_occlude.visibility.visible_space import VisibilityGrid, visibility_grid

N = 32
"""Voxels along a side, as 3D-EPN and PatchComplete have them."""
TRUNCATION = 3
"""Number of voxels at which distances are cut off."""
AROUND = fibonacci(100)
"""Eyes around the object; a point that none of them sees is inside, for complete distances."""
PER_TURN = 10


def export(source: CloudReader, out: Path) -> Exported:
    """Write a folder for each object, and the list of a split's objects.

    CLASS/OBJECT/gt.npz           tsdf (32, 32, 32) float32, voxels bool: tsdf < 0
    CLASS/OBJECT/input_0.npz      tsdf and voxels of what the first view sees, states uint8 (`VisibilityGrid.states`),
                                  points (m, 3) float32: its cloud, eye (3,): cube sides from the cube's lowest corner
    train.txt, test.txt, ...      CLASS/OBJECT, one per line

    A tsdf counts sides of the cube, y up: negative behind the surface, cut off at 3 voxels. The complete one is
    Open3D's distance to the mesh; inside is what none of 100 eyes around the object sees, so it needs no closed mesh.

    References
    ----------
    yuchenrao/PatchComplete, model/patch_learning_dataset.py, ShapenetDataset.
    """
    plan, names, n_views = source.plan, names_of(source.plan), len(source.plan.views)
    files, n_clouds = dict[str, list[str]](), dict[str, int]()
    axes = np.rint(find_format(plan.format).to_frame(plan.config)).astype(np.float64)
    for split, numbers in whole_objects(source).items():
        files[split], n_clouds[split], folders = [], numbers.size, list[str]()
        for of_views in numbers.reshape(-1, n_views):
            records = source.take(of_views)
            mesh_id, variation = int(records["mesh_id"][0]), int(records["variation"][0])
            entry = plan.meshes[mesh_id]
            folder = f"{names.classes[mesh_id]}/{names.objects[mesh_id]}"
            folder += f"-{variation}" if plan.config.variations > 1 else ""
            folders.append(folder)
            (out / folder).mkdir(parents=True)
            loaded = entry.load()
            mesh = Mesh((loaded.vertices - loaded.centre) / loaded.longest_side @ axes.T, loaded.faces, loaded.name)
            eyes = plan.views_of(entry.key).around(np.zeros(3), mesh.longest_side).eyes @ axes.T
            grid = visibility_grid(mesh, eyes, N)
            side = N * grid.step
            _write(out / folder / "gt.npz", complete_distances(mesh, grid) / side)
            for view, eye in enumerate(eyes):
                of_view = VisibilityGrid(grid.low, grid.step, grid.distances[view : view + 1])
                record = records[view]
                points = record["data"] / record["factor"] + (record["centre"] - loaded.centre) @ axes.T
                points /= loaded.longest_side
                _write(
                    out / folder / f"input_{view}.npz",
                    of_view.tsdf(TRUNCATION * grid.step) / side,
                    states=of_view.states,
                    points=_single((points - grid.low) / side),
                    eye=(eye - grid.low) / side,
                )
            files[split] += [f"{folder}/{name}.npz" for name in ("gt", *(f"input_{view}" for view in range(n_views)))]
        atomic.write_lines(out / f"{split}.txt", folders)
    return Exported(files, n_clouds, left_out=incomplete(source))


def complete_distances(mesh: Mesh, grid: VisibilityGrid) -> NDArray[np.float32]:
    """Return the distance of each voxel's centre to the mesh, in its unit, cut off; negative where no eye sees it."""
    with importing("open3d", "--format voxels"):
        import open3d
    scene: Any = open3d.t.geometry.RaycastingScene()  # takes arrays too, its types do not say so
    low, side = grid.low, N * grid.step  # in single precision: relative to the cube
    scene.add_triangles(_single((mesh.vertices - low) / side), mesh.faces.astype(np.uint32))
    centres = grid.centres.reshape(-1, 3)
    distances = scene.compute_distance(_single((centres - low) / side)).numpy() * side
    inside = np.arange(len(centres))
    eyes = AROUND.around(mesh.centre, mesh.longest_side).eyes
    with prepare(mesh, "exact") as occluder:
        for first in range(0, len(eyes), PER_TURN):
            seen = occluder.visible(SurfacePoints.free(centres[inside]), eyes[first : first + PER_TURN])
            inside = inside[~seen.any(axis=0)]
    distances[inside] *= -1.0
    return np.clip(distances, -TRUNCATION * grid.step, TRUNCATION * grid.step).reshape(N, N, N).astype(np.float32)


def _single(numbers: FloatArray) -> NDArray[np.float32]:
    return numbers.astype(np.float32)


def _write(path: Path, tsdf: NDArray[Any], **arrays: NDArray[Any]) -> None:
    found: dict[str, Any] = {"tsdf": tsdf.astype(np.float32), "voxels": tsdf < 0, **arrays}
    atomic.write(path, lambda file: np.savez_compressed(file, **found), synced=False)


def check(plan: Plan) -> None:
    """Raise OptionError unless clouds are of the surface in the object's frame; UnavailableError without Open3D."""
    if plan.config.scan is not None:
        raise OptionError("voxels must be of views of the surface. Leave --sensor out.")
    if plan.config.frame != "object":
        raise OptionError(f"voxels must be in the object's frame, turned y up; got --frame {plan.config.frame}.")
    with importing("open3d", "--format voxels"):
        import open3d  # noqa: F401
