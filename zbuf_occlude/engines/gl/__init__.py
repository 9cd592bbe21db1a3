"""OpenGL: context, shaders and passes, independent of the methods that use them."""
