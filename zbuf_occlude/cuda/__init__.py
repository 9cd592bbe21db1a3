"""exact on NVIDIA GPUs, for tensors that are there already: the kernel and the mesh as it reads it. Experimental."""
