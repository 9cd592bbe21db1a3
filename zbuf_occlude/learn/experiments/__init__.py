"""The paper's experiments with classifiers: elevation (4.2), augmentation (4.3, 4.4), and what the HSR method does."""
