"""Engines of visibility: exact on the CPU, OpenGL, Warp, and the paper's object-space algorithms."""
