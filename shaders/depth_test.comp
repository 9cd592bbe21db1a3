// The plain depth test: a point is hidden that lies behind its pixel's depth by more than the tolerance and its slope.
// One invocation answers for 4 points and up to 8 eyes. Twin: visibility/pyrender.py, depth_test.
#version 430
layout(local_size_x = 64) in;

uniform int n_eyes;        // of this batch
uniform int first_word;    // of its answers
uniform int n_words;       // of a group of 8 eyes
uniform int first_block;   // of 256 points, of this dispatch
uniform float slope_bias;  // pixels

#include "tiles.glsl"
#include "points.glsl"

layout(binding = 0) uniform sampler2D depths;

const uint HIDDEN = 0u, VISIBLE = 1u;

uint ask(int eye, Point point)
{
    Place place = place_of(tile_of(eye, point.position), point);
    float slope = max(abs(place.gain.x), abs(place.gain.y));
    float nearest = texelFetch(depths, ivec2(place.pixel), 0).r;
    // what lies behind the far plane hides behind nothing
    bool behind = !place.aside && nearest > max(place.depth, 0.0) + place.allowance + slope_bias * slope;
    return eye >= n_eyes || behind ? HIDDEN : VISIBLE;
}

void list(uint doubts, uint block) {}  // this test has none

#include "ask_all.glsl"
