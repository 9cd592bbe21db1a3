"""BOP: scenes as the benchmark for 6D poses of objects has them; an image for each view of an object in its scene."""

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset.export import Exported, renderings
from zbuf_occlude.dataset.export.shared import whole_objects
from zbuf_occlude.dataset.pipeline import scanned_scenes
from zbuf_occlude.dataset.plan import Numbers, Plan
from zbuf_occlude.dataset.source import Source
from zbuf_occlude.errors import OptionError
from zbuf_occlude.scenes.scene import Scene
from zbuf_occlude.sensors.bop import BopWriter
from zbuf_occlude.sensors.frames import Frame, frame_at
from zbuf_occlude.visibility import prepare


def export(source: Source, out: Path) -> Exported:
    """Write SPLIT/SCENE/ with the files of `write_bop`; a scene is a variation of an object, its images are the views.

    Scenes that hide a drawn share of the object differ by view: each image lists what stands there. Models are the
    meshes of the collection, and what fills scenes without one. `depth` has the sensor's noise, masks and `rgb` have
    none.
    """
    plan, n_views = source.plan, len(source.plan.views)
    assert plan.recipe.setup is not None
    writer = BopWriter(out, background=(), method=plan.recipe.setup.method)
    names, n_clouds = dict[str, list[str]](), dict[str, int]()
    for split, numbers in whole_objects(source).items():
        names[split], n_clouds[split] = [], numbers.size
        for number, of_views in enumerate(numbers.reshape(-1, n_views)):
            writer.write_scene(f"{split}/{number:06d}", _images(source, of_views, plan.recipe.setup.method))
    of_all = writer.finish()
    for split in names:
        names[split] = [name for name in of_all if name.startswith(f"{split}/")]
    return Exported(names, n_clouds)


def _images(source: Source, of_views: Numbers, method: str) -> Iterator[tuple[Scene, Frame, NDArray[np.float32]]]:
    """Yield the scene of each view, what a camera without noise sees of it, and the sensor's depth."""
    first = source.take(of_views[:1])[0]
    scenes = scanned_scenes(source.plan, int(first["mesh_id"]), int(first["variation"]))
    last, occluder = None, None
    with ExitStack() as opened:
        for scene, record in zip(scenes, renderings.records_of(source, of_views), strict=True):
            if scene is not last or occluder is None:
                opened.close()
                last, occluder = scene, opened.enter_context(prepare(scene.mesh, method))
                occluder.warns_of_eyes_inside = False
            noisy = renderings.frame_of(source.plan, record)
            clean = frame_at(scene, occluder, noisy.intrinsics, noisy.pose, noisy.depth.shape)
            yield scene, replace(clean, colors=noisy.colors), noisy.depth


def check(plan: Plan) -> None:
    """Raise OptionError unless the clouds are all that a pinhole camera's rays meet, in metres, of all objects."""
    renderings.check(plan)
    setup = plan.recipe.setup
    assert setup is not None
    if setup.keep != "all":
        raise OptionError(f"bop must have the pixels of all objects, --keep all; got {setup.keep}.")
