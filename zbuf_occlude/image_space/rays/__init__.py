"""The second question: rays to first hits; those of one origin as an eye there sees them, others one by one."""

from zbuf_occlude.image_space.rays.cast import find_first_hits

__all__ = ["find_first_hits"]
