"""BOP: scenes as the benchmark for 6D poses of objects has them; an image for each view of an object in its scene."""

from pathlib import Path

from zbuf_occlude.dataset.export import Exported, renderings
from zbuf_occlude.dataset.export.shared import whole_objects
from zbuf_occlude.dataset.pipeline import scanned_scenes
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Source
from zbuf_occlude.errors import OptionError
from zbuf_occlude.sensors.bop import BopWriter


def export(source: Source, out: Path) -> Exported:
    """Write SPLIT/SCENE/ with the files of `write_bop`; a scene is a variation of an object, its images are the views.

    Scenes that hide a drawn share of the object differ by view: each image lists what stands there. Models are the
    meshes of the collection, and what fills scenes without one. `depth` has the sensor's noise, masks have none.
    """
    plan, n_views = source.plan, len(source.plan.views)
    assert plan.recipe.setup is not None
    writer = BopWriter(out, background=(), method=plan.recipe.setup.method)
    names, n_clouds = dict[str, list[str]](), dict[str, int]()
    for split, numbers in whole_objects(source).items():
        names[split], n_clouds[split] = [], numbers.size
        for number, of_views in enumerate(numbers.reshape(-1, n_views)):
            first = source.take(of_views[:1])[0]
            scenes = scanned_scenes(plan, int(first["mesh_id"]), int(first["variation"]))
            found = (renderings.frame_of(plan, record) for record in renderings.records_of(source, of_views))
            writer.write_scene(f"{split}/{number:06d}", zip(scenes, found, strict=True))
    of_all = writer.finish()
    for split in names:
        names[split] = [name for name in of_all if name.startswith(f"{split}/")]
    return Exported(names, n_clouds)


def check(plan: Plan) -> None:
    """Raise OptionError unless the clouds are all that a pinhole camera's rays meet, in metres, of all objects."""
    renderings.check(plan)
    setup = plan.recipe.setup
    assert setup is not None
    if setup.keep != "all":
        raise OptionError(f"bop must have the pixels of all objects, --keep all; got {setup.keep}.")
