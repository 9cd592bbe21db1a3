"""The paper again: its tables, its figures, and its experiments with classifiers; only the command line imports it."""
