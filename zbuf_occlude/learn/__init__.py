"""Classifiers of point clouds and the paper's experiments with them (extra ``learn``: PyTorch)."""
