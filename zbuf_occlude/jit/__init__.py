"""What numba lacks: compiled functions kept by the state of the sources, vectors of numbers, threads, pointers."""
