// Plain depth test: a point is hidden if it lies behind its pixel's depth by more than the tolerance and slope bias.
// One invocation tests 4 points and up to 8 eyes. The NumPy equivalent is depth_test in visibility/pyrender.py.
#version 430
layout(local_size_x = 64) in;

uniform int n_eyes;        // eyes of this batch
uniform int first_word;    // first word of the batch's answers
uniform int n_words;       // words of a group of 8 eyes
uniform int first_block;   // first block of 256 points of this dispatch
uniform float slope_bias;  // pixels

#include "tiles.glsl"
#include "points.glsl"

layout(binding = 0) uniform sampler2D depths;

const uint HIDDEN = 0u, VISIBLE = 1u;

uint ask(int eye, Point point)
{
    WindowPoint projected = project(tile_of(eye, point.position), point);
    float slope = max(abs(projected.gain.x), abs(projected.gain.y));
    float nearest = texelFetch(depths, ivec2(projected.pixel), 0).r;
    // a point behind the far plane is not hidden by the background
    bool behind = !projected.aside && nearest > max(projected.depth, 0.0) + projected.allowance + slope_bias * slope;
    return eye >= n_eyes || behind ? HIDDEN : VISIBLE;
}

void list(uint doubts, uint block) {}  // this test has no doubtful pairs

#include "ask_all.glsl"
