"""Views: positions and orientations of cameras, by specification, by formula, or from files."""

from zbuf_occlude.views.cameras import from_colmap, from_csv, from_json
from zbuf_occlude.views.model import PAPER_DISTANCE, Views
from zbuf_occlude.views.positions import (
    HALF_WITHIN,
    MAX_VIEWS,
    SPECIFICATIONS,
    Seed,
    Specification,
    drive,
    fibonacci,
    for_mesh,
    forms,
    from_angles,
    grid,
    is_random,
    modelnet8,
    paper100,
    parse,
    random,
    random_so3,
    ring,
)

__all__ = [
    "HALF_WITHIN",
    "MAX_VIEWS",
    "PAPER_DISTANCE",
    "SPECIFICATIONS",
    "Seed",
    "Specification",
    "Views",
    "drive",
    "fibonacci",
    "for_mesh",
    "forms",
    "from_angles",
    "from_colmap",
    "from_csv",
    "from_json",
    "grid",
    "is_random",
    "modelnet8",
    "paper100",
    "parse",
    "random",
    "random_so3",
    "ring",
]


def __dir__() -> list[str]:
    return list(__all__)
