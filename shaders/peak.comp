// Measures peak arithmetic throughput by fused multiply-adds (benchmarks/gpu.py).
#version 430
layout(local_size_x = 64) in;
layout(std430, binding = 0) writeonly buffer Results { vec4 results[]; };
uniform uint iterations;                 // each is 8 multiply-adds of 4 floats

void main()
{
    vec4 a[8];
    for (int i = 0; i < 8; ++i) a[i] = vec4(gl_GlobalInvocationID.x + uint(i)) * 1e-9;
    vec4 factor = vec4(0.999), more = vec4(1e-3);
    for (uint n = 0u; n < iterations; ++n)
        for (int i = 0; i < 8; ++i) a[i] = fma(a[i], factor, more);
    results[gl_GlobalInvocationID.x] = a[0] + a[1] + a[2] + a[3] + a[4] + a[5] + a[6] + a[7];
}
