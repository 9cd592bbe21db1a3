// Decides the pairs of eye and point on which the pixels around did not agree. A witness is a face that really crosses
// the line of sight; candidates are the faces seen in the 6 x 6 pixels around. Without one, the votes of the four nearest
// pixels are weighed by their nearness, unless one of them sees the point's own face.
// Twin: tests/visibility/witness_twin.py.
#version 430
layout(local_size_x = 64) in;

uniform int first_word;  // of this batch's answers
uniform int n_words;     // of a group of 8 eyes
uniform float contact;   // unit space

#include "tiles.glsl"
#include "points.glsl"
#include "votes.glsl"

layout(std430, binding = 2) readonly buffer Count { uint count; };
layout(std430, binding = 3) readonly buffer Doubtful { uint doubtful[]; };
layout(std430, binding = 4) readonly buffer Corners { vec4 corners[]; };  // of the faces drawn, 3 each
layout(binding = 1) uniform isampler2D faces;

const float MOST_HIDDEN = $MOST_HIDDEN;  // of the weighed votes, for a point that is visible

// The exact negative of cross_product(b, a): two faces that share an edge then agree on which side of it a line passes.
vec3 cross_product(vec3 a, vec3 b)
{
    precise vec3 n = vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
    return n;
}

// Whether a face blocks the line of sight d from a point: the definition of predicates.py in float32.
bool blocks(int face, vec3 point, vec3 d)
{
    vec3 a = corners[3 * face].xyz - point, b = corners[3 * face + 1].xyz - point, c = corners[3 * face + 2].xyz - point;
    float u = dot(d, cross_product(b, c)), v = dot(d, cross_product(c, a)), w = dot(d, cross_product(a, b));
    bool inside = (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
    vec3 n = cross(b - a, c - a);
    float slope = dot(d, n), fraction = dot(a, n) / slope;
    return inside && slope != 0.0 && fraction * length(d) > contact && fraction < 1.0;
}

// Whether a face is a point's own. A free point has none; faces whose planes it touches are taken for it.
bool is_own(int face, Point point)
{
    if (face < 0 || point.own >= 0) return face >= 0 && face == point.own;
    vec3 a = corners[3 * face].xyz, b = corners[3 * face + 1].xyz, c = corners[3 * face + 2].xyz;
    vec3 n = cross(b - a, c - a);
    return abs(dot(a - point.position, n)) <= contact * length(n);
}

bool hidden(int eye, Point point)
{
    int tile = tile_of(eye, point.position);
    Place place = place_of(tile, point);
    vec2 low = floor(place.pixel - 0.5);
    vec3 d = tiles[tile].eye.xyz - point.position;
    ivec2 size = textureSize(faces, 0), corner = ivec2(low) - 2;
    int last = -1;
    for (int row = 0; row < 6; row++)
        for (int column = 0; column < 6; column++) {
            int face = texelFetch(faces, clamp(corner + ivec2(column, row), ivec2(0), size - 1), 0).r;
            if (face >= 0 && face != last && face != point.own && blocks(face, point.position, d)) return true;
            last = face;
        }
    ivec4 nearest = textureGather(faces, (low + 1.0) * texel);
    for (int i = 0; i < 4; i++)
        if (is_own(nearest[i], point)) return false;
    vec2 high = place.pixel - 0.5 - low, rest = 1.0 - high;
    uint votes = votes_of(place, low);  // upper left, upper right, lower right, lower left
    float weighed = rest.x * high.y * float(votes & 1u) + high.x * high.y * float(votes >> 1 & 1u)
                  + high.x * rest.y * float(votes >> 2 & 1u) + rest.x * rest.y * float(votes >> 3 & 1u);
    return weighed > MOST_HIDDEN;
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
