"""The engine of `exact`: hidden-surface removal in image space on the CPU, every doubt decided in float64."""
