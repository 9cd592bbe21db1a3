// The votes of the four pixels whose centres surround a point.
layout(binding = 0) uniform sampler2D depths;

uniform vec2 texel;  // 1 / size of the atlas

struct Votes {
    ivec2 low;     // the lower left of the four
    vec2 between;  // where the point lies among their centres, [0, 1)
    bvec4 hidden;  // upper left, upper right, lower right, lower left (textureGather's order)
};

Votes votes_of(Place place)
{
    vec2 low = floor(place.pixel - 0.5);
    vec2 between = place.pixel - 0.5 - low;
    float base = place.depth - dot(place.gain, between);
    vec4 plane = base + vec4(place.gain.y, place.gain.x + place.gain.y, place.gain.x, 0.0);
    vec4 nearest = textureGather(depths, (low + 1.0) * texel);
    // a plane that passes behind the far plane hides behind nothing
    return Votes(ivec2(low), between, greaterThan(nearest, max(plane, 0.0) + place.allowance));
}
