"""Views: where cameras stand and how they are turned; sets of positions, files of cameras, what people type."""

from zbuf_occlude.views.cameras import from_colmap, from_csv, from_json
from zbuf_occlude.views.model import PAPER_DISTANCE, Views
from zbuf_occlude.views.positions import (
    MAX_VIEWS,
    SPECIFICATIONS,
    Seed,
    Specification,
    fibonacci,
    forms,
    grid,
    is_drawn,
    modelnet8,
    paper100,
    parse,
    random,
    random_so3,
    ring,
)

__all__ = [
    "MAX_VIEWS",
    "PAPER_DISTANCE",
    "SPECIFICATIONS",
    "Seed",
    "Specification",
    "Views",
    "fibonacci",
    "forms",
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
