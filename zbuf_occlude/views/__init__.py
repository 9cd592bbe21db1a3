"""Views: where cameras stand and how they are turned; sets of positions, files of cameras, what people type."""

from zbuf_occlude.views.files import from_colmap, from_csv, from_json
from zbuf_occlude.views.model import Views
from zbuf_occlude.views.positions import (
    MAX_VIEWS,
    PAPER_DISTANCE,
    Seed,
    fibonacci,
    from_angles,
    grid,
    modelnet8,
    paper100,
    random,
    random_so3,
    ring,
)
from zbuf_occlude.views.specs import SPECIFICATIONS, Specification, for_mesh, forms, is_drawn, parse

__all__ = [
    "MAX_VIEWS",
    "PAPER_DISTANCE",
    "SPECIFICATIONS",
    "Seed",
    "Specification",
    "Views",
    "fibonacci",
    "for_mesh",
    "forms",
    "from_angles",
    "from_colmap",
    "from_csv",
    "from_json",
    "grid",
    "is_drawn",
    "modelnet8",
    "paper100",
    "parse",
    "random",
    "random_so3",
    "ring",
]


def __dir__() -> list[str]:
    return list(__all__)
