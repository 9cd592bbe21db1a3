// Irregular z-buffer as one compute pass: exact visibility of surface points from many eyes (gl/exact_pass.py).
//
// One work group processes one *packet* (PACKET neighbouring points) and one eye. The packet has a screen of its own, the
// plane through its centre that faces the eye. Its footprint there corresponds to a tile of a z-buffer: the clusters of
// faces in the shaft between footprint and eye are listed, then their triangles, and each point of the packet tests the
// remaining triangles. There is no resolution; the lists are in shared memory.
//
// Spaces: the mesh is centred and scaled by a power of two so that its diagonal is in [1/2, 1). An eye is multiplied by
// a power of two g that brings it into the unit ball, so that far eyes keep their precision. Suffix _g: times g.
//
// Exactness: a point test evaluates four planes, each divided by a bound of its own rounding error (including the
// inputs'). Beyond 1 the sign is certain; values between -1 and 1 are tested in float64 on the original coordinates.
// Pairs that float64 cannot decide are reported as undecided to the caller.
//
// Work: a group stops after BUDGET steps, keeps its results, and lists itself as unfinished; the caller dispatches the
// boxes below. (llvmpipe ends loops silently after 65,535 iterations in all, and short groups suit GPUs.)
#version 430
layout(local_size_x = $THREADS) in;

const uint THREADS = $THREADS, PER_THREAD = $PER_THREAD;
const uint STRANDS = $STRANDS;           // threads that share a point and divide its triangles
const uint COLUMNS = THREADS / STRANDS, PACKET = COLUMNS * PER_THREAD;
const uint WIDTH = $WIDTH;               // children of a box
const uint LEAF = $LEAF;                 // faces of a cluster
const uint OPENED = max(THREADS / WIDTH, 1u);  // boxes opened at a time
const uint CLUSTERS = 4u * THREADS;      // clusters listed before their triangles are tested; OPENED * WIDTH more fit
const uint TRIANGLES = $TRIANGLES;       // triangles listed before the points test them; THREADS more fit
const uint BUDGET = $BUDGET;
const bool COUNTING = $COUNTING;         // count operations, for benchmarks and tests
const uint NONE = 0xffffffffu;
const uint LEVEL_SHIFT = 28u, NODE = (1u << LEVEL_SHIFT) - 1u;  // an entry holds a level of the tree and a box of it
const float EPSILON = $EPSILON;          // unit roundoff of float32
const float SLACK = 4e-6;                // margin of boxes: some 64 roundings of coordinates below 1
const float FAR = 1e6;                   // distance of a packet beyond which float64 decides
const float TINY = 1e-30;

struct Face { vec4 a_ab, ab_ac, ac_n, bc; };  // corner a, edges ab, ac, normal n, edge bc, in sequence
struct ExactPoint { double x, y, z; uint order, unused; };
struct Eye { double x, y, z, unused; vec4 scaled; };

layout(std430, binding = 0) readonly buffer Faces { Face faces[]; };
layout(std430, binding = 1) readonly buffer Corners { double corners[]; };
layout(std430, binding = 2) readonly buffer Boxes { vec4 boxes[]; };            // centre, half size
layout(std430, binding = 3) readonly buffer Points { uvec4 points[]; };         // offset from the packet's centre; own face
layout(std430, binding = 4) readonly buffer ExactPoints { ExactPoint exact_points[]; };
layout(std430, binding = 5) readonly buffer Packets { vec4 packets[]; };        // centre and radius, half size
layout(std430, binding = 6) readonly buffer Eyes { Eye eyes[]; };
layout(std430, binding = 7) buffer Answers { uint answer_bits[]; };            // [eye][hidden, undecided][order / 32]
layout(std430, binding = 8) readonly buffer Tasks { uvec2 tasks[]; };           // pair of eye and packet, entry
layout(std430, binding = 9) buffer Unfinished { uint n_unfinished, unused, done[6]; uvec2 unfinished[]; };

uniform uint n_tasks;                    // 0: every packet and eye, from the root
uniform uint n_packets, first_eye, words;  // words of an eye's row of bits
uniform uint first_face, n_faces, n_levels, level_start[$MAX_LEVELS], level_size[$MAX_LEVELS];
uniform float contact;                   // in the mesh's unit
uniform double contact64;                // in world units

shared uint extent[5];                   // bounds of the packet on its screen, in integers ordered like floats
shared uint stack[$STACK], n_pushed[2];
shared uint clusters[CLUSTERS + OPENED * WIDTH], n_clusters;
shared vec4 planes[(TRIANGLES + THREADS) * 4u];  // u, v, w: through eye and edges; s: the face's plane
shared float contact_slope[TRIANGLES + THREADS];
shared uint triangle[TRIANGLES + THREADS], n_triangles;
shared uint hidden_of[COLUMNS];          // hidden points of each column
shared uint any_alive, over_budget;

#include "blocks64.glsl"

// the packet, the eye, and the packet's screen: origin at its centre, z towards the eye
vec3 centre, half_size, towards_g, x_axis, y_axis, z_axis;
float radius, g, distance_g, nearest_g, size_g;
vec4 eye_g;
bool near, trusted, depth_trusted;

// the shaft: four planes through the footprint's sides and the eye (parallel if the eye is too near), and bounds of z
vec3 side[4], corner[4];
vec4 beyond;
float low_z, high_z;

uint ordered(float value)
{
    uint bits = floatBitsToUint(value);
    return (bits & 0x80000000u) != 0u ? ~bits : bits | 0x80000000u;
}

float unordered(uint key)
{
    return uintBitsToFloat((key & 0x80000000u) != 0u ? key & 0x7fffffffu : ~key);
}

uint blocked64(uint face, uint point, uint eye)
{
    uint i = 9u * face;
    dvec3 a = dvec3(corners[i], corners[i + 1u], corners[i + 2u]);
    dvec3 b = dvec3(corners[i + 3u], corners[i + 4u], corners[i + 5u]);
    dvec3 c = dvec3(corners[i + 6u], corners[i + 7u], corners[i + 8u]);
    dvec3 p = dvec3(exact_points[point].x, exact_points[point].y, exact_points[point].z);
    dvec3 e = dvec3(eyes[eye].x, eyes[eye].y, eyes[eye].z);
    return blocks64(e, p, a, b, c, contact64);
}

bool meets_shaft(uint box)
{
    vec3 at = boxes[2u * box].xyz - centre, half_box = boxes[2u * box + 1u].xyz;
    vec4 inward = vec4(dot(side[0], at), dot(side[1], at), dot(side[2], at), dot(side[3], at))
        - vec4(dot(abs(side[0]), half_box), dot(abs(side[1]), half_box), dot(abs(side[2]), half_box), dot(abs(side[3]), half_box));
    float z = dot(z_axis, at), z_reach = dot(abs(z_axis), half_box);
    bool misses = any(greaterThan(inward, beyond)) || z + z_reach < low_z || z - z_reach > high_z;
    return !(misses && trusted);
}

// Return the smallest and largest value of a plane over the packet: at its footprint's corners (every ray in the shaft
// has the sign of one of them), or over its bounding sphere if the eye is too near for a cone.
vec2 range_of(vec4 plane)
{
    vec4 at = vec4(dot(plane.xyz, corner[0]), dot(plane.xyz, corner[1]),
                   dot(plane.xyz, corner[2]), dot(plane.xyz, corner[3]));
    float spread = length(plane.xyz) * radius;
    vec2 range = vec2(min(min(at.x, at.y), min(at.z, at.w)), max(max(at.x, at.y), max(at.z, at.w)));
    return (near ? vec2(-spread, spread) : range) + plane.w;
}

// List a triangle for the points to test, unless it certainly hides none of them.
void list_triangle(uint face)
{
    Face f = faces[face];
    vec3 a = f.a_ab.xyz, ab = vec3(f.a_ab.w, f.ab_ac.xy), ac = vec3(f.ab_ac.zw, f.ac_n.x), n = f.ac_n.yzw, bc = f.bc.xyz;
    vec3 a_g = a * g - eye_g.xyz, b_g = a_g + ab * g;
    vec3 from_a = centre - a, from_b = from_a - ab;
    float reach_a = length(from_a) + radius, reach_b = length(from_b) + radius;
    // inverse of each plane's error bound; docs/error_bounds.md derives the numbers
    float unit = EPSILON * size_g;
    float per_u = 1.0 / max(unit * length(bc) * (4.0 + 26.0 * reach_b), TINY);
    float per_v = 1.0 / max(unit * length(ac) * (4.0 + 26.0 * reach_a), TINY);
    float per_w = 1.0 / max(unit * length(ab) * (4.0 + 26.0 * reach_a), TINY);
    float steep = depth_trusted ? size_g / (nearest_g - contact * g) : 0.0;
    float size_n = max(length(n), TINY);
    float per_s = 0.5 / (EPSILON * size_n * (0.5 + 6.0 * reach_a + contact * steep * (11.0 + 6.0 * steep)));

    // a point can be hidden only if u, v and w have the sign of the eye's side of the face
    float eye_side_g = -dot(n, a_g);
    bool certain = abs(eye_side_g) > 16.0 * unit * size_n;
    float sigma = eye_side_g > 0.0 ? -1.0 : 1.0;
    vec3 nu = cross(b_g, bc) * (sigma * per_u), nv = cross(ac, a_g) * (sigma * per_v), nw = cross(a_g, ab) * (sigma * per_w);
    vec4 u = vec4(nu, dot(nu, from_b)), v = vec4(nv, dot(nv, from_a)), w = vec4(nw, dot(nw, from_a));
    float use_depth = certain && depth_trusted ? sigma * per_s : 0.0;
    // conditionals, not products with 0: a product with an overflowed number would be NaN
    vec4 s = use_depth != 0.0 ? vec4(n, dot(n, from_a)) * use_depth : vec4(0.0);
    float slope = use_depth != 0.0 ? contact * eye_side_g * use_depth : 0.0;
    vec2 range_u = range_of(u), range_v = range_of(v), range_w = range_of(w);
    bool may = !(min(range_u.y, min(range_v.y, range_w.y)) < -1.0);
    bool may_mirrored = !certain && !(max(range_u.x, max(range_v.x, range_w.x)) > 1.0);
    // the contact tolerance moves the face towards the eye, least for the farthest point
    float deepest = s.w + dot(abs(s.xyz), half_size) + (depth_trusted ? slope / (distance_g + radius * g) : 0.0);
    if (trusted && (!(may || may_mirrored) || deepest < -1.0)) return;

    bool keep = trusted && certain;  // planes of zeros leave every point in doubt
    uint slot = atomicAdd(n_triangles, 1u);
    planes[4u * slot] = keep ? u : vec4(0.0);
    planes[4u * slot + 1u] = keep ? v : vec4(0.0);
    planes[4u * slot + 2u] = keep ? w : vec4(0.0);
    planes[4u * slot + 3u] = s;
    contact_slope[slot] = slope;
    triangle[slot] = first_face + face;
}

void main()
{
    uint lane = gl_LocalInvocationID.x, column = lane % COLUMNS, strand = lane / COLUMNS;
    uint packet, eye_row, root = 0u;
    bool alive = true;                   // a point of the packet may still be visible
    if (n_tasks == 0u) {
        packet = gl_WorkGroupID.x;
        eye_row = gl_WorkGroupID.y;
    } else {
        uint index = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
        alive = index < n_tasks;         // the last row of groups may extend beyond the list
        uvec2 task = tasks[min(index, n_tasks - 1u)];
        packet = task.x % n_packets;
        eye_row = task.x / n_packets;
        root = task.y;
    }
    uint eye = first_eye + eye_row;
    vec4 ball = packets[2u * packet];
    centre = ball.xyz;
    radius = ball.w;
    half_size = packets[2u * packet + 1u].xyz;
    eye_g = eyes[eye].scaled;
    g = eye_g.w;
    trusted = radius < FAR && dot(centre, centre) < FAR * FAR;
    towards_g = eye_g.xyz - centre * g;
    distance_g = length(towards_g);
    nearest_g = distance_g - radius * g;
    depth_trusted = trusted && nearest_g > 4.0 * contact * g;
    size_g = length(eye_g.xyz) + g;      // bounds |corner - eye| g, and its operands
    z_axis = distance_g > 0.0 ? towards_g / distance_g : vec3(0.0, 0.0, 1.0);
    x_axis = normalize(abs(z_axis.x) < 0.5 ? vec3(0.0, -z_axis.z, z_axis.y) : vec3(-z_axis.z, 0.0, z_axis.x));
    y_axis = cross(z_axis, x_axis);
    float eye_z = distance_g / g;
    near = !(eye_z > 2.0 * radius);

    if (lane == 0u) {
        for (uint i = 0u; i < 5u; ++i) extent[i] = 0u;
        bool leaf = (root >> LEVEL_SHIFT) + 1u == n_levels;
        stack[0] = root;
        n_pushed[0] = leaf ? 0u : 1u;
        clusters[0] = root & NODE;
        n_clusters = leaf ? 1u : 0u;
        n_triangles = any_alive = over_budget = 0u;
    }
    if (strand == 0u) hidden_of[column] = 0u;
    barrier();

    // this thread's points: points column + i COLUMNS of the packet
    vec3 p[PER_THREAD];
    float inverse_g[PER_THREAD];
    uint own[PER_THREAD];
    vec2 low = vec2(1e30), high = vec2(-1e30);
    low_z = 1e30;
    for (uint i = 0u; i < PER_THREAD; ++i) {
        uvec4 point = points[packet * PACKET + i * COLUMNS + column];
        p[i] = uintBitsToFloat(point.xyz);
        own[i] = point.w;
        inverse_g[i] = depth_trusted ? 1.0 / (length(towards_g - p[i] * g) - contact * g) : 0.0;
        float z = dot(z_axis, p[i]);
        vec2 on_screen = vec2(dot(x_axis, p[i]), dot(y_axis, p[i])) * (near ? 1.0 : eye_z / (eye_z - z));
        low = min(low, on_screen);
        high = max(high, on_screen);
        low_z = min(low_z, z);
    }
    atomicMax(extent[0], ordered(-low.x));
    atomicMax(extent[1], ordered(high.x));
    atomicMax(extent[2], ordered(-low.y));
    atomicMax(extent[3], ordered(high.y));
    atomicMax(extent[4], ordered(-low_z));
    barrier();
    float slack = SLACK * (1.0 + length(centre) + radius);
    beyond = vec4(unordered(extent[0]), unordered(extent[1]), unordered(extent[2]), unordered(extent[3])) + slack;
    low_z = -unordered(extent[4]) - 2.0 * slack;
    if (near) {
        beyond = vec4(radius + slack);
        low_z = -radius - 2.0 * slack;
    }
    high_z = max(eye_z, radius) + slack * (1.0 + eye_z);
    float narrowing = near ? 0.0 : 1.0 / eye_z;
    side = vec3[4](-x_axis + beyond.x * narrowing * z_axis, x_axis + beyond.y * narrowing * z_axis,
                   -y_axis + beyond.z * narrowing * z_axis, y_axis + beyond.w * narrowing * z_axis);
    corner = vec3[4](-beyond.x * x_axis - beyond.z * y_axis, beyond.y * x_axis - beyond.z * y_axis,
                     -beyond.x * x_axis + beyond.w * y_axis, beyond.y * x_axis + beyond.w * y_axis);
    beyond += slack;

    const uint ALL = (1u << PER_THREAD) - 1u;
    uint hidden = 0u, undecided = 0u;    // one bit per point of this thread
    uint steps = 0u, doubted = 0u;       // steps of the group; float64 tests of this thread
    uint n_boxes = 0u, n_looked = 0u, n_tested = 0u;
    uint first = 0u, turn = 0u;
    bool finished = false;
    while (alive && !finished && steps < BUDGET) {
        // boxes: open some at a time, keep the children that meet the shaft
        while (steps < BUDGET) {
            barrier();
            uint have = first + n_pushed[turn];
            finished = have == 0u;
            if (finished || n_clusters > CLUSTERS) break;
            uint n_opened = min(have, OPENED);
            first = have - n_opened;
            if (lane == 0u) n_pushed[turn ^ 1u] = 0u;
            uint n_kept = 0u, kept[(OPENED * WIDTH + THREADS - 1u) / THREADS];
            for (uint i = lane; i < n_opened * WIDTH; i += THREADS) {
                uint entry = stack[first + i / WIDTH];
                uint level = (entry >> LEVEL_SHIFT) + 1u, node = (entry & NODE) * WIDTH + i % WIDTH;
                if (node < level_size[level] && meets_shaft(level_start[level] + node))
                    kept[n_kept++] = level << LEVEL_SHIFT | node;
            }
            barrier();
            turn ^= 1u;
            for (uint i = 0u; i < n_kept; ++i) {
                if ((kept[i] >> LEVEL_SHIFT) + 1u == n_levels) clusters[atomicAdd(n_clusters, 1u)] = kept[i] & NODE;
                else stack[first + atomicAdd(n_pushed[turn], 1u)] = kept[i];
            }
            ++steps;
            n_boxes += n_opened * WIDTH;
        }
        // triangles of the listed clusters: keep those that may hide a point of the packet; then the points test them
        uint todo = n_clusters * LEAF;
        barrier();
        uint base = 0u;
        while (base < todo && alive && steps < BUDGET) {
            uint listed = 0u;
            while (base < todo && listed <= TRIANGLES) {
                uint i = base + lane;
                uint face = i < todo ? clusters[i / LEAF] * LEAF + i % LEAF : NONE;
                if (face < n_faces) list_triangle(face);
                base += THREADS;
                n_looked += THREADS;
                ++steps;
                barrier();
                listed = n_triangles;
                barrier();
            }
            uint j = hidden == ALL ? listed : strand;
            while (j < listed) {
                uint doubts = 0u, at;
                while (j < listed && doubts == 0u) {
                    at = j;
                    vec4 u = planes[4u * j], v = planes[4u * j + 1u], w = planes[4u * j + 2u], s = planes[4u * j + 3u];
                    float slope = contact_slope[j];
                    uint face = triangle[j];
                    for (uint q = 0u; q < PER_THREAD; ++q) {
                        float least = min(min(dot(u.xyz, p[q]) + u.w, dot(v.xyz, p[q]) + v.w),
                                          min(dot(w.xyz, p[q]) + w.w, dot(s.xyz, p[q]) + s.w + slope * inverse_g[q]));
                        uint bit = face != own[q] ? 1u << q : 0u;
                        if (least > 1.0) hidden |= bit;
                        else if (!(least < -1.0)) doubts |= bit;  // NaN counts as a doubt
                    }
                    doubts &= ~hidden;
                    j += STRANDS;
                }
                while (doubts != 0u) {
                    uint q = uint(findLSB(doubts));
                    doubts &= doubts - 1u;
                    ++doubted;
                    uint face = triangle[at] - first_face;
                    uint answer = blocked64(face, packet * PACKET + q * COLUMNS + column, eye);
                    if (answer == BLOCKED) hidden |= 1u << q;
                    else if (answer == IN_DOUBT) undecided |= 1u << q;
                }
                if (hidden == ALL) j = listed;
            }
            steps += listed;
            n_tested += listed;
            if (STRANDS > 1u) {
                atomicOr(hidden_of[column], hidden);
                barrier();
                hidden = hidden_of[column];
            }
            if (hidden != ALL) any_alive = 1u;
            if (doubted > BUDGET / 8u) over_budget = 1u;
            barrier();
            alive = any_alive != 0u;
            if (over_budget != 0u) steps = BUDGET;
            if (lane == 0u) n_triangles = 0u;
            barrier();
            if (lane == 0u) any_alive = 0u;
        }
        finished = finished && base >= todo;
        barrier();
        if (lane == 0u) n_clusters = 0u;
    }

    if (lane == 0u && alive && !finished) unfinished[atomicAdd(n_unfinished, 1u)] = uvec2(eye_row * n_packets + packet, root);
    if (COUNTING) {
        if (lane == 0u) {
            atomicAdd(done[0], 1u);
            atomicAdd(done[1], n_boxes);
            atomicAdd(done[2], n_looked);
            atomicAdd(done[3], n_tested);
        }
        atomicAdd(done[4], doubted);
    }
    for (uint q = 0u; q < PER_THREAD; ++q) {
        uint order = exact_points[packet * PACKET + q * COLUMNS + column].order;
        if (order == NONE) continue;
        uint word = 2u * eye_row * words + (order >> 5u), bit = 1u << (order & 31u);
        if ((hidden >> q & 1u) != 0u && strand == 0u) atomicOr(answer_bits[word], bit);
        if ((undecided >> q & 1u) != 0u) atomicOr(answer_bits[word + words], bit);
    }
}
