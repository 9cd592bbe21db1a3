"""The second question: rays to first hits, 16 neighbours from one place side by side, others one by one."""

from zbuf_occlude.image_space.rays.cast import find_first_hits

__all__ = ["find_first_hits"]
