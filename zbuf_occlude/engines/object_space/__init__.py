"""Hidden-surface removal in object space by the paper's own formulas, one algorithm per file.

These modules do not import `zbuf_occlude.geometry.predicates`: the two formulations check each other.
"""
