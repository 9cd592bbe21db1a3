"""The engine of `exact`: hidden-surface removal in image space on the CPU, every doubt decided in float64.

`engine` is the flow. `scene/` makes the mesh and the points ready, `view` the eyes, `search/` finds what hides what,
`rays/` what rays meet first; `layout` has the numbers that all of them share. docs/exact.md tells the idea.
"""

from zbuf_occlude.exact.engine import Engine

__all__ = ["Engine"]
