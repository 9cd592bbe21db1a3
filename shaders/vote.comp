// The four pixels around a point vote whether it is hidden: each compares its depth with that of the point's own plane
// at the pixel's centre. When they agree, that is the answer; else the pair is listed for witness.comp.
// One invocation answers for 4 points and 8 eyes. Twin: zbuf_occlude/visibility/depth_test.py, vote.
#version 430
layout(local_size_x = 64) in;

uniform int first_eye, n_eyes;  // of this batch
uniform int first_word;         // of its answers
uniform int n_words;            // of a group of 8 eyes

#include "tiles.glsl"
#include "points.glsl"
#include "votes.glsl"

layout(std430, binding = 3) buffer Count { uint count; };
layout(std430, binding = 4) writeonly buffer Doubtful { uint doubtful[]; };

uint ask(int eye, uint slot, Point point)
{
    if (eye >= n_eyes) return 0u;
    Votes votes = votes_of(place_of(tile_of(eye, point.position), point));
    if (all(votes.hidden)) return 0u;
    if (any(votes.hidden)) {
        doubtful[atomicAdd(count, 1u)] = uint(eye) << 20 | slot;
        return 0u;
    }
    return 1u;
}

#include "ask_all.glsl"
