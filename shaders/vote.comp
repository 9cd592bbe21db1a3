// The four pixels around a point vote whether it is hidden: each compares its depth with that of the point's own plane
// at the pixel's centre. When they agree, that is the answer; else the pair is listed for witness.comp.
// One invocation answers for 4 points and up to 8 eyes.
// Twin: tests/visibility/witness_twin.py, votes.
#version 430
layout(local_size_x = 64) in;

uniform int n_eyes;       // of this batch
uniform int first_word;   // of its answers
uniform int n_words;      // of a group of 8 eyes
uniform int first_block;  // of 256 points, of this dispatch

#include "tiles.glsl"
#include "points.glsl"
#include "votes.glsl"

layout(std430, binding = 2) buffer Count { uint count; };
layout(std430, binding = 3) writeonly buffer Doubtful { uint doubtful[]; };

const uint HIDDEN = 0u, VISIBLE = 1u, DOUBTFUL = 256u;

uint ask(int eye, Point point)
{
    Place place = place_of(tile_of(eye, point.position), point);
    uint votes = place.aside ? 0u : votes_of(place, floor(place.pixel - 0.5));
    if (eye >= n_eyes || votes == 15u) return HIDDEN;
    return votes == 0u ? VISIBLE : DOUBTFUL;
}

void list(uint doubts, uint block)
{
    if (doubts == 0u) return;
    uint place = atomicAdd(count, uint(bitCount(doubts)));
    for (; doubts != 0u; doubts &= doubts - 1u) {
        uint bit = uint(findLSB(doubts));
        uint slot = block * 256u + (bit >> 3) * 64u + gl_LocalInvocationID.x, eye = gl_WorkGroupID.y * 8u + (bit & 7u);
        doubtful[place++] = eye << 20 | slot;
    }
}

#include "ask_all.glsl"
