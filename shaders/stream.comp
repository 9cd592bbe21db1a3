// Measures peak memory bandwidth by copying one buffer to another (benchmarks/gpu.py).
#version 430
layout(local_size_x = 64) in;
layout(std430, binding = 0) readonly buffer From { vec4 from[]; };
layout(std430, binding = 1) writeonly buffer To { vec4 to[]; };

void main()
{
    uint i = gl_WorkGroupID.y * gl_NumWorkGroups.x * 64u + gl_GlobalInvocationID.x;
    to[i] = from[i];
}
