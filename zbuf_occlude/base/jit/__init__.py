"""Additions to numba: a cache of compiled functions keyed by the sources, SIMD vectors, threads, pointers."""
