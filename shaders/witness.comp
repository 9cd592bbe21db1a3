// Decides the pairs of eye and point on which the four pixels did not agree. A witness is a face that crosses the line
// of sight; candidates are the faces in the 6 x 6 pixels around the point. Without a witness, a point whose own face is
// in one of the four nearest pixels is visible; otherwise their votes are weighted by nearness.
// The NumPy equivalent is tests/visibility/witness_twin.py.
#version 430
layout(local_size_x = 64) in;

uniform int dispatch;    // number of the dispatch of vote.comp
uniform int first_word;  // first word of this batch's answers
uniform int n_words;     // words of a group of 8 eyes
uniform float contact;   // unit space

#include "tiles.glsl"
#include "points.glsl"
#include "votes.glsl"

layout(std430, binding = 2) readonly buffer Counts { uint counts[]; };
layout(std430, binding = 3) readonly buffer Doubtful { uint doubtful[]; };
layout(std430, binding = 4) readonly buffer Corners { vec4 corners[]; };  // 3 corners per face, in drawing order
layout(binding = 1) uniform isampler2D faces;

const float MAX_HIDDEN = $MAX_HIDDEN;  // maximum share of the weighted votes for "hidden" of a visible point

// Cross product, the exact negative of cross_product(b, a), so that two faces agree on the side of a shared edge.
vec3 cross_product(vec3 a, vec3 b)
{
    precise vec3 n = vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
    return n;
}

// Return whether a face blocks the line of sight d from a point: the definition of predicates.py in float32.
bool blocks(int face, vec3 point, vec3 d)
{
    vec3 a = corners[3 * face].xyz - point, b = corners[3 * face + 1].xyz - point, c = corners[3 * face + 2].xyz - point;
    float u = dot(d, cross_product(b, c)), v = dot(d, cross_product(c, a)), w = dot(d, cross_product(a, b));
    bool inside = (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
    vec3 n = cross(b - a, c - a);
    float slope = dot(d, n), fraction = dot(a, n) / slope;
    return inside && slope != 0.0 && fraction * length(d) > contact && fraction < 1.0;
}

// Return whether a face is a point's own. For a free point these are the faces with a plane that it touches.
bool is_own(int face, Point point)
{
    if (face < 0 || point.own >= 0) return face >= 0 && face == point.own;
    vec3 a = corners[3 * face].xyz, b = corners[3 * face + 1].xyz, c = corners[3 * face + 2].xyz;
    vec3 n = cross(b - a, c - a);
    return abs(dot(a - point.position, n)) <= contact * length(n);
}

// Return a mask of the faces in a block of 2 x 2 pixels (textureGather's order) that are candidates and differ from the
// faces in the pixels to the left and below.
uint candidates_in(ivec4 block, ivec4 left, ivec4 below, int own)
{
    bvec4 beside = equal(block, ivec4(left.y, block.x, block.w, left.z));
    bvec4 under = equal(block, ivec4(block.w, block.z, below.y, below.x));
    bvec4 none = lessThan(block, ivec4(0)), its_own = equal(block, ivec4(own));
    uint found = 0u;
    for (int i = 0; i < 4; i++) found |= uint(!(beside[i] || under[i] || none[i] || its_own[i])) << i;
    return found;
}

// Return whether a face in the 6 x 6 pixels around a point blocks the line of sight d; `nearest` receives the faces in
// the middle. The pixels are read in blocks of 2 x 2: gathering four is much faster than four fetches in software.
bool has_witness(vec2 low, Point point, vec3 d, out ivec4 nearest)
{
    ivec4 row[3] = ivec4[3](ivec4(-1), ivec4(-1), ivec4(-1));
    bool found = false;
    for (int y = -1; y <= 1; y++) {
        uint candidates = 0u;
        ivec4 left = ivec4(-1);
        for (int x = 0; x < 3; x++) {
            ivec4 block = textureGather(faces, (low + vec2(2 * x - 1, 2 * y + 1)) * texel);
            candidates |= candidates_in(block, left, row[x], point.own) << (4 * x);
            row[x] = left = block;
        }
        if (y == 0) nearest = row[1];
        for (; candidates != 0u && !found; candidates &= candidates - 1u) {
            int bit = findLSB(candidates);
            ivec4 block = bit < 4 ? row[0] : bit < 8 ? row[1] : row[2];
            found = blocks(block[bit & 3], point.position, d);
        }
    }
    return found;
}

bool hidden(int eye, Point point)
{
    int tile = tile_of(eye, point.position);
    WindowPoint projected = project(tile, point);
    vec2 low = floor(projected.pixel - 0.5);
    ivec4 nearest;
    if (has_witness(low, point, tiles[tile].eye.xyz - point.position, nearest)) return true;
    for (int i = 0; i < 4; i++)
        if (is_own(nearest[i], point)) return false;
    vec2 high = projected.pixel - 0.5 - low, rest = 1.0 - high;
    uint votes = votes_of(projected, low);  // upper left, upper right, lower right, lower left
    float weighted = rest.x * high.y * float(votes & 1u) + high.x * high.y * float(votes >> 1 & 1u)
                   + high.x * rest.y * float(votes >> 2 & 1u) + rest.x * rest.y * float(votes >> 3 & 1u);
    return weighted > MAX_HIDDEN;
}

void main()
{
    uint stride = gl_NumWorkGroups.x * 64u;
    for (uint i = gl_GlobalInvocationID.x; i < counts[dispatch]; i += stride) {
        uint slot = doubtful[i] & 0xFFFFFu;
        int eye = int(doubtful[i] >> 20);
        if (hidden(eye, point_at(slot))) continue;
        // the bit of this pair's answer in ask_all.glsl
        uint bit = (slot & 3u) * 8u + uint(eye & 7);
        atomicOr(answers[uint(first_word) + uint(eye >> 3) * uint(n_words) + (slot >> 2)], 1u << bit);
    }
}
