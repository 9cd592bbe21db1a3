// The plain depth test: a point is hidden that lies behind its pixel's depth by more than the tolerance and its slope.
// One invocation answers for 4 points and 8 eyes. Twin: zbuf_occlude/visibility/depth_test.py, depth_test.
#version 430
layout(local_size_x = 64) in;

uniform int first_eye, n_eyes;  // of this batch
uniform int first_word;         // of its answers
uniform int n_words;            // of a group of 8 eyes
uniform float slope_bias;

#include "tiles.glsl"
#include "points.glsl"

layout(binding = 0) uniform sampler2D depths;

uint ask(int eye, uint slot, Point point)
{
    if (eye >= n_eyes) return 0u;
    Place place = place_of(tile_of(eye, point.position), point);
    float slope = max(abs(place.gain.x), abs(place.gain.y));
    float nearest = texelFetch(depths, ivec2(place.pixel), 0).r;
    return uint(!(nearest > place.depth + place.allowance + slope_bias * slope));
}

#include "ask_all.glsl"
