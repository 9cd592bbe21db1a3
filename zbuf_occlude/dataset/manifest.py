"""manifest.json: what was made, how, by what, how long it took, what failed, and how wrong it is."""

from typing import Any

from zbuf_occlude.dataset.formats import find_format
from zbuf_occlude.dataset.packing import STEPS
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.versions import versions


def summed_up(
    plan: Plan,
    sidecars: list[dict[str, Any]],
    files: dict[str, list[str]],
    n_clouds: dict[str, int],
    seconds: dict[str, float],
) -> dict[str, Any]:
    """Sum up finished shards.

    Parameters
    ----------
    plan : Plan
    sidecars : list of dict
        As `run_shard` writes them, one for each shard.
    files : dict of split to file names
    n_clouds : dict of split to number of clouds
    seconds : dict of str to float
        Wall-clock times of the parts of this run.

    Returns
    -------
    dict
        ``error`` holds fractions of the checked pairs of view and point: *false_visible* (the dataset has the point,
        the oracle says hidden) and *false_hidden* (the other way round).
    """
    total = {
        name: sum(sidecar[name] for sidecar in sidecars)
        for name in ("n_clouds", "n_blind_views", "n_with_repeats", "n_checked", "false_visible", "false_hidden")
    }
    failures = {key: reason for sidecar in sidecars for key, reason in sidecar["failures"].items()}
    dropped: dict[str, int] = {}
    for sidecar in sidecars:
        for reason, count in sidecar["faces_dropped"].items():
            dropped[reason] = dropped.get(reason, 0) + count
    renderers = sorted({sidecar["renderer"] for sidecar in sidecars} - {"none"})
    n_checked = total["n_checked"]
    return {
        "fingerprint": plan.fingerprint,
        "seed": plan.recipe.seed,
        "format": plan.format,
        "options": plan.document["recipe"],
        "versions": versions(),
        "renderer": ", ".join(renderers) or "none",
        "classes": plan.classes,
        "counts": {
            "meshes": len(plan.meshes),
            "meshes_failed": len(failures),
            "views": len(plan.views),
            "variations": plan.recipe.variations,
            "clouds": total["n_clouds"],
            "clouds_by_split": n_clouds,
            "views_that_see_nothing": total["n_blind_views"],
            "clouds_with_repeated_points": total["n_with_repeats"],
            "faces_dropped": dropped,
        },
        "failures": failures,
        "files": files,
        # how far positions may be off along each axis, in longest sides; float32 alone is nothing beside it
        "rounding": 0.5 / STEPS if find_format(plan.format).keeps_points else 0.0,
        "error": {
            "false_visible": total["false_visible"] / n_checked if n_checked else None,
            "false_hidden": total["false_hidden"] / n_checked if n_checked else None,
            "n_checked": n_checked,
        },
        "seconds": {
            **{name: round(value, 3) for name, value in seconds.items()},
            "shards": round(sum(sidecar["seconds"] for sidecar in sidecars), 3),
        },
    }
