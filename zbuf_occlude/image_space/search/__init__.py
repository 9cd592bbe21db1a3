"""The search: for each view the clusters before each packet of points, until every point is hidden or none is left."""

from zbuf_occlude.image_space.search.search import find_visible

__all__ = ["find_visible"]
