// Reads the faces in the 4 x 4 pixels around each ray's position in its picture: candidates for its first hit.
#version 430
layout(local_size_x = 64) in;

uniform int n_rays;  // rays of this dispatch

layout(std430, binding = 0) readonly buffer Rays { ivec2 lowest[]; };  // lower left of the 4 x 4 pixels, in the atlas
layout(std430, binding = 1) writeonly buffer Seen { int seen[]; };     // 16 per ray
layout(binding = 1) uniform isampler2D faces;

void main()
{
    int ray = int(gl_GlobalInvocationID.x);
    if (ray >= n_rays) return;
    ivec2 last = textureSize(faces, 0) - 1;
    for (int i = 0; i < 16; i++)
        seen[16 * ray + i] = texelFetch(faces, clamp(lowest[ray] + ivec2(i & 3, i >> 2), ivec2(0), last), 0).r;
}
