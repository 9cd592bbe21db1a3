// Which points does each eye see? One thread per pair, CUDA C++ for NVRTC; cuda/mesh_tree.py makes what it reads.
//
// EXPERIMENTAL: this was never executed on a GPU. The same source compiled as C++, one thread for all pairs, is what the
// tests hold to the oracle, and nvcc compiles it where there is one. docs/torch_on_device.md says what is to come.
//
// A thread walks down a tree of boxes along its line of sight, from the point to the eye, and tests the faces of the
// clusters that it meets by THE definition of "blocked" (zbuf_occlude/predicates.py) in float64, on the mesh's own
// coordinates; the first that blocks is the answer. Boxes are met in float32 and a little too large, so a box that the
// line might touch is never left out. So the answers are the oracle's own, but where a line lies in a face's plane as far
// as float64 can tell and the rounding of brute force finds it blocked by a face that it does not come near. Compile
// without contraction (-fmad=false): cross(b, a) must stay the exact negative of cross(a, b).
//
// Spaces: boxes are in the mesh's unit, centred and scaled by a power of two so that its diagonal is in [1/2, 1);
// everything else is in world units.

#if defined(__CUDACC__) || defined(__CUDACC_RTC__)
#define DEVICE __device__ __forceinline__
#else
#include <cmath>
#define DEVICE static inline
#endif

struct Vector { double x, y, z; };

// What a launch is given besides its arrays; the twin of mesh_tree.PARAMETERS.
struct Parameters {
    double centre[3], scale, contact;
    long long n_points, n_eyes;
    int n_levels, leaf, width, unused;
    int level_start[32], level_size[32];  // of the tree, clusters first
};

DEVICE Vector minus(Vector a, Vector b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
DEVICE double dot(Vector a, Vector b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
DEVICE Vector cross(Vector a, Vector b)
{
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
DEVICE Vector at(const double *values, long long i) { return {values[3 * i], values[3 * i + 1], values[3 * i + 2]}; }

// Whether the closed triangle meets the open segment (eye, point) farther than `contact` from the point.
DEVICE bool blocks(Vector eye, Vector point, const double *corners, double contact)
{
    Vector a = at(corners, 0), b = at(corners, 1), c = at(corners, 2), d = minus(point, eye);
    Vector to_a = minus(a, point), to_b = minus(b, point), to_c = minus(c, point);
    double u = dot(d, cross(to_b, to_c)), v = dot(d, cross(to_c, to_a)), w = dot(d, cross(to_a, to_b));
    if (!((u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0))) return false;
    Vector n = cross(minus(b, a), minus(c, a));
    double slope = dot(d, n);
    if (slope == 0.0 || u + v + w == 0.0) return false;
    double height = dot(minus(point, a), n);
    if (slope < 0.0) { height = -height; slope = -slope; }
    return height * sqrt(dot(d, d)) > contact * slope && height < slope;
}

// The line of sight in the mesh's unit, from the point on.
struct Line {
    float from[3], inverse[3], length;
    bool tests_all;  // so far out that float32 tells nothing: every box is met
};

DEVICE Line line_of(Vector point, Vector eye, const Parameters &parameters)
{
    Line line;
    const double from[3] = {point.x, point.y, point.z}, to[3] = {eye.x, eye.y, eye.z};
    double towards[3], length = 0.0, farthest = 0.0;
    for (int axis = 0; axis < 3; ++axis) {
        towards[axis] = (to[axis] - from[axis]) * parameters.scale;
        length += towards[axis] * towards[axis];
        double place = (from[axis] - parameters.centre[axis]) * parameters.scale;
        farthest = fmax(farthest, fabs(place));
        line.from[axis] = (float)place;
    }
    length = sqrt(length);
    line.tests_all = !(farthest < 4.0) || !(length > 0.0);
    line.length = (float)fmin(length * 1.0001 + 1e-5, 1e30);
    for (int axis = 0; axis < 3; ++axis) {
        double slope = towards[axis] / length;
        line.inverse[axis] = (float)(1.0 / (fabs(slope) < 1e-20 ? 1e-20 : slope));
    }
    return line;
}

// Whether the line may meet a box (low, high). The boxes' margin outweighs what is rounded here: for a point within 4
// units, some 20 roundings of 4, 5e-6.
DEVICE bool meets(const Line &line, const float *box)
{
    float enter = 0.0f, leave = line.length;
    for (int axis = 0; axis < 3; ++axis) {
        float low = (box[axis] - line.from[axis]) * line.inverse[axis];
        float high = (box[axis + 3] - line.from[axis]) * line.inverse[axis];
        enter = fmaxf(enter, fminf(low, high));
        leave = fminf(leave, fmaxf(low, high));
    }
    return line.tests_all || enter <= leave;
}

DEVICE bool sees(
    long long index, const Parameters &parameters, const float *boxes, const double *corners, int n_faces,
    const double *points, const int *own_places, const double *eyes)
{
    long long point_id = index % parameters.n_points;
    Vector point = at(points, point_id), eye = at(eyes, index / parameters.n_points);
    int own = own_places[point_id];
    Line line = line_of(point, eye, parameters);
    int stack_level[96], stack_node[96], depth = 1;  // a level leaves at most width - 1 of its boxes behind
    stack_level[0] = parameters.n_levels - 1;
    stack_node[0] = 0;
    while (depth > 0) {
        --depth;
        int level = stack_level[depth], node = stack_node[depth];
        if (!meets(line, boxes + 6ll * (parameters.level_start[level] + node))) continue;
        if (level > 0) {
            int first = node * parameters.width;
            for (int child = first; child < first + parameters.width; ++child) {
                if (child >= parameters.level_size[level - 1]) break;
                stack_level[depth] = level - 1;
                stack_node[depth++] = child;
            }
            continue;
        }
        for (int face = node * parameters.leaf; face < (node + 1) * parameters.leaf && face < n_faces; ++face)
            if (face != own && blocks(eye, point, corners + 9ll * face, parameters.contact)) return false;
    }
    return true;
}

// All pointers are to memory of the device; `mask` is (eyes, points).
#if defined(__CUDACC__) || defined(__CUDACC_RTC__)
extern "C" __global__ void visible(
#else
extern "C" void visible(
#endif
    const Parameters *parameters, const float *boxes, const double *corners, int n_faces, const double *points,
    const int *own_places, const double *eyes, bool *mask)
{
#if defined(__CUDACC__) || defined(__CUDACC_RTC__)
    long long first = blockIdx.x * (long long)blockDim.x + threadIdx.x, step = gridDim.x * (long long)blockDim.x;
#else
    long long first = 0, step = 1;
#endif
    for (long long i = first; i < parameters->n_points * parameters->n_eyes; i += step)
        mask[i] = sees(i, *parameters, boxes, corners, n_faces, points, own_places, eyes);
}
