"""Studies: comparisons of methods and of scans, classifiers, and the paper's tables, figures and experiments."""
