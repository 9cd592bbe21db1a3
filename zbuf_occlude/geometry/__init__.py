"""Geometry: meshes and their colours, cameras, points on surfaces, and the definition of "blocked"."""
