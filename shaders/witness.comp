// Decides the pairs of eye and point on which the pixels around did not agree. A witness is a face seen in one of 4 x 4
// pixels that really crosses the line of sight. Without one, the pixels' votes are weighed by their nearness, unless
// one of the four nearest sees the point's own face. Twin: zbuf_occlude/visibility/depth_test.py, witness_test.
#version 430
layout(local_size_x = 64) in;

uniform int first_eye;   // of this batch
uniform int first_word;  // of its answers
uniform int n_words;     // of a group of 8 eyes
uniform float contact;   // unit space

#include "tiles.glsl"
#include "points.glsl"
#include "votes.glsl"

layout(std430, binding = 3) readonly buffer Count { uint count; };
layout(std430, binding = 4) readonly buffer Doubtful { uint doubtful[]; };
layout(std430, binding = 5) readonly buffer Corners { uint corners[]; };
layout(std430, binding = 6) readonly buffer Vertices { float vertices[]; };
layout(binding = 1) uniform isampler2D faces;

const float MOST_HIDDEN = $MOST_HIDDEN;  // of the weighed votes, for a point that is visible

vec3 corner(int face, int i)
{
    uint at = 3u * corners[3 * face + i];
    return vec3(vertices[at], vertices[at + 1u], vertices[at + 2u]);
}

// The exact negative of cross_product(b, a): two faces that share an edge then agree on which side of it a line passes.
vec3 cross_product(vec3 a, vec3 b)
{
    precise vec3 n = vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
    return n;
}

const int MISSES = 0, BLOCKS = 1, OWN = 2;

// What a face is to the line of sight d from a point: the definition of predicates.py in float32. A free point has no
// face of its own; those whose planes it touches are taken for it.
int witness(int face, Point point, vec3 d)
{
    if (face < 0) return MISSES;
    if (face == point.own) return OWN;
    vec3 a = corner(face, 0) - point.position, b = corner(face, 1) - point.position, c = corner(face, 2) - point.position;
    float u = dot(d, cross_product(b, c)), v = dot(d, cross_product(c, a)), w = dot(d, cross_product(a, b));
    vec3 n = cross(b - a, c - a);
    float offset = dot(a, n), slope = dot(d, n);
    if (point.own < 0 && abs(offset) <= contact * length(n)) return OWN;
    bool inside = (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
    float fraction = offset / slope;
    return int(inside && slope != 0.0 && fraction * length(d) > contact && fraction < 1.0);
}

bool hidden(int eye, Point point)
{
    Votes votes = votes_of(place_of(tile_of(eye, point.position), point));
    vec3 d = eyes[first_eye + eye].xyz - point.position;
    bool sees_own = false;
    int last = -1, found = MISSES;
    for (int y = -1; y <= 2; y++) {
        for (int x = -1; x <= 2; x++) {
            int face = texelFetch(faces, votes.low + ivec2(x, y), 0).r;
            if (face != last) found = witness(face, point, d);
            last = face;
            if (found == BLOCKS) return true;
            if (found == OWN && x >= 0 && x <= 1 && y >= 0 && y <= 1) sees_own = true;
        }
    }
    vec2 high = votes.between, low = 1.0 - high;
    vec4 weights = vec4(low.x * high.y, high.x * high.y, high.x * low.y, low.x * low.y);
    return !sees_own && dot(weights, vec4(votes.hidden)) > MOST_HIDDEN;
}

void main()
{
    uint stride = gl_NumWorkGroups.x * 64u;
    for (uint i = gl_GlobalInvocationID.x; i < count; i += stride) {
        uint slot = doubtful[i] & 0xFFFFFu;
        int eye = int(doubtful[i] >> 20);
        if (hidden(eye, point_at(slot))) continue;
        // where ask_all.glsl put the answer of this pair
        uint word = (slot >> 8) * 64u + (slot & 63u), bit = (slot >> 6 & 3u) * 8u + uint(eye & 7);
        atomicOr(answers[uint(first_word) + uint(eye >> 3) * uint(n_words) + word], 1u << bit);
    }
}
