"""Pure functions of arrays: meshes and their colours, cameras, points on surfaces, the definition of "blocked"."""
