"""Ground of all rooms: errors, checks of arrays, documents, files, limits, provenance, compiled functions."""
