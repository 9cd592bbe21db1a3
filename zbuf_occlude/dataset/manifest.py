"""manifest.json: what was made, how, by what, how long it took, what failed, and how wrong it is."""

from typing import Any

from zbuf_occlude.dataset.confidence import interval
from zbuf_occlude.dataset.counts import Counts
from zbuf_occlude.dataset.formats import find_format
from zbuf_occlude.dataset.origins import origins_of_made, tries
from zbuf_occlude.dataset.packing import STEPS
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.shard import Sidecar
from zbuf_occlude.gl.nvidia import fallen_to_software
from zbuf_occlude.versions import versions


def summed_up(
    plan: Plan,
    sidecars: list[Sidecar],
    files: dict[str, list[str]],
    n_clouds: dict[str, int],
    seconds: dict[str, float],
) -> dict[str, Any]:
    """Sum up finished shards.

    Parameters
    ----------
    plan : Plan
    sidecars : list of Sidecar
        One for each shard.
    files : dict of split to file names
    n_clouds : dict of split to number of clouds
    seconds : dict of str to float
        Wall-clock times of the parts of this run.

    Returns
    -------
    dict
        ``error`` holds fractions of the checked pairs of view and point: *false_visible* (the dataset has the point,
        the oracle says hidden) and *false_hidden* (the other way round); of the checked views the share of those that
        are wrong in more than `counts.BAD_VIEW` of their checked points, and which was the worst. ``origins`` says what
        each mesh was made of, ``stacked`` how much of the surface has another sheet nearer than the method's tolerance,
        ``tries`` what showed of those that failed, and the limits they had.
    """
    counts = sum((sidecar.counts for sidecar in sidecars), Counts())
    failures = {key: reason for sidecar in sidecars for key, reason in sidecar.failures.items()}
    row = find_format(plan.format)
    renderers = sorted({sidecar.renderer for sidecar in sidecars} - {"none"})
    return {
        "fingerprint": plan.fingerprint,
        "seed": plan.recipe.seed,
        "format": plan.format,
        "options": plan.document["recipe"],
        "versions": versions(),
        "renderer": ", ".join(renderers) or "none",
        "renderer_remark": next(filter(None, map(fallen_to_software, renderers)), ""),
        "classes": plan.classes,
        **frame_of(plan),
        "counts": {
            "meshes": len(plan.meshes),
            "meshes_failed": len(failures),
            "views": len(plan.views),
            "variations": plan.recipe.variations,
            "clouds": counts.n_clouds,
            "clouds_by_split": n_clouds,
            "views_that_see_nothing": counts.n_blind_views,
            "views_inside_the_bounding_box": counts.n_inside,
            "clouds_with_repeated_points": counts.n_with_repeats,
            "faces_dropped": dict(counts.faces_dropped),
            "meshes_without_colors": counts.n_without_colors,
        },
        "failures": failures,
        "tries": tries(sidecars),
        "origins": {key: origin.document for sidecar in sidecars for key, origin in origins_of_made(sidecar).items()},
        "files": files,
        # how far positions may be off along each axis, in longest sides; float32 alone is nothing beside it
        "rounding": 0.5 / STEPS if row.keeps_points else 0.0,
        "error": error_of(counts),
        "stacked": stacked_of(counts),
        "seconds": {
            **{name: round(value, 3) for name, value in seconds.items()},
            "shards": round(sum(sidecar.seconds for sidecar in sidecars), 3),
        },
    }


def frame_of(plan: Plan) -> dict[str, Any]:
    """Say the axes of the clouds in the files, by those of the mesh with z up, and which is up; or the eye's."""
    if plan.recipe.frame == "camera":
        return {"axes": ["right", "up", "backwards"], "up": None}
    axes = find_format(plan.format).axes_in(plan.recipe.frame)
    return {"axes": list(axes), "up": "xyz"[[axis[-1] for axis in axes].index("z")]}


def error_of(counts: Counts) -> dict[str, Any]:
    """Say how wrong the checked answers are; None where nothing was checked. ``interval`` is of all answers' share."""
    n, n_views, worst = counts.n_checked, counts.n_views_checked, counts.worst
    return {
        "false_visible": counts.false_visible / n if n else None,
        "false_hidden": counts.false_hidden / n if n else None,
        "interval": list(interval(counts.false_visible + counts.false_hidden, n)) if n else None,
        "n_checked": n,
        "n_views_checked": n_views,
        "bad_views": counts.n_bad_views / n_views if n_views else None,
        "worst_view": None if worst is None else worst._asdict(),
    }


def stacked_of(counts: Counts) -> dict[str, Any] | None:
    """Say how much of the surface has another sheet too near; None of methods without a tolerance."""
    if counts.most_stacked is None:
        return None
    return {
        "share": counts.n_stacked / counts.n_looked_at,
        "n_looked_at": counts.n_looked_at,
        "most": counts.most_stacked._asdict(),
    }
