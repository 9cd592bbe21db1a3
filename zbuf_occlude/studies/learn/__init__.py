"""Classifiers of point clouds: networks, training, evaluation (extra ``learn``: PyTorch)."""
