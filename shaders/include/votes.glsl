// Votes of four pixels on whether a point is hidden: each compares its depth with that of the point's own plane at the
// pixel's centre.
layout(binding = 0) uniform sampler2D depths;

uniform vec2 texel;  // 1 / size of the atlas

// Return four votes, bits 0 to 3: upper left, upper right, lower right, lower left (textureGather's order) of the 2 x 2
// pixels with the lower left one at `low`.
uint votes_of(WindowPoint projected, vec2 low)
{
    float base = projected.depth + dot(projected.gain, low + 0.5 - projected.pixel);
    vec4 plane = base + vec4(projected.gain.y, projected.gain.x + projected.gain.y, projected.gain.x, 0.0);
    vec4 nearest = textureGather(depths, (low + 1.0) * texel);
    // a plane behind the far plane is not hidden by the background
    bvec4 hidden = greaterThan(nearest, max(plane, 0.0) + projected.allowance);
    return uint(hidden.x) | uint(hidden.y) << 1 | uint(hidden.z) << 2 | uint(hidden.w) << 3;
}
