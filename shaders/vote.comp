// Vote of the four pixels around a point on whether it is hidden: each compares its depth with that of the point's own
// plane at the pixel's centre. If all agree, that is the answer; otherwise the pair is listed for witness.comp.
// One invocation tests 4 points and up to 8 eyes. The NumPy equivalent is votes in tests/visibility/witness_twin.py.
#version 430
layout(local_size_x = 64) in;

uniform int n_eyes;       // eyes of this batch
uniform int first_word;   // first word of the batch's answers
uniform int n_words;      // words of a group of 8 eyes
uniform int first_block;  // first block of 256 points of this dispatch
uniform int dispatch;     // number of this dispatch

#include "tiles.glsl"
#include "points.glsl"
#include "votes.glsl"

layout(std430, binding = 2) buffer Counts { uint counts[]; };  // doubtful pairs of each dispatch
layout(std430, binding = 3) writeonly buffer Doubtful { uint doubtful[]; };

const uint HIDDEN = 0u, VISIBLE = 1u, DOUBTFUL = 256u;

uint ask(int eye, Point point)
{
    WindowPoint projected = project(tile_of(eye, point.position), point);
    uint votes = projected.aside ? 0u : votes_of(projected, floor(projected.pixel - 0.5));
    if (eye >= n_eyes || votes == 15u) return HIDDEN;
    return votes == 0u ? VISIBLE : DOUBTFUL;
}

void list(uint doubts, uint block)
{
    if (doubts == 0u) return;
    uint index = atomicAdd(counts[dispatch], uint(bitCount(doubts)));
    for (; doubts != 0u; doubts &= doubts - 1u) {
        uint bit = uint(findLSB(doubts));
        uint slot = block * 256u + gl_LocalInvocationID.x * 4u + (bit >> 3), eye = gl_WorkGroupID.y * 8u + (bit & 7u);
        doubtful[index++] = eye << 20 | slot;
    }
}

#include "ask_all.glsl"
