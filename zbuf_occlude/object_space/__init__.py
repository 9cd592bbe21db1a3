"""The paper's hidden-surface removal in object space: one algorithm a file, by the paper's own formulas.

Nothing here imports `zbuf_occlude.geometry.predicates`: the two formulations check each other.
"""
