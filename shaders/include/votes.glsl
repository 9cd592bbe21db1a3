// The votes of four pixels on whether a point is hidden: each compares its depth with that of the point's own plane at
// its centre.
layout(binding = 0) uniform sampler2D depths;

uniform vec2 texel;  // 1 / size of the atlas

// Four votes, bits 0 to 3: upper left, upper right, lower right, lower left (textureGather's order) of the pixels whose
// lower left is `low`.
uint votes_of(Place place, vec2 low)
{
    float base = place.depth + dot(place.gain, low + 0.5 - place.pixel);
    vec4 plane = base + vec4(place.gain.y, place.gain.x + place.gain.y, place.gain.x, 0.0);
    vec4 nearest = textureGather(depths, (low + 1.0) * texel);
    // a plane that passes behind the far plane hides behind nothing
    bvec4 hidden = greaterThan(nearest, max(plane, 0.0) + place.allowance);
    return uint(hidden.x) | uint(hidden.y) << 1 | uint(hidden.z) << 2 | uint(hidden.w) << 3;
}
