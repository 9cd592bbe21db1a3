// Writes invocation indices, to test that compute shaders and storage buffers of a context work (gl/probe.py).
#version 430
layout(local_size_x = 64) in;
layout(std430, binding = 0) writeonly buffer Numbers { uint numbers[]; };

void main()
{
    numbers[gl_GlobalInvocationID.x] = gl_GlobalInvocationID.x;
}
