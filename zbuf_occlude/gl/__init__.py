"""Everything OpenGL: the context, the shaders and the passes. Knows nothing of the paper's algorithms or of methods."""
