// Definition of "blocked" (zbuf_occlude/geometry/predicates.py) in float64: blocked, not blocked, or in doubt. Each volume
// has a bound on its error. `precise` prevents optimisations that change the rounding.

const double FILTER64 = 1e-15LF, TINY64 = 1e-150LF;  // error bound per permanent (9 roundings), and for underflow
const double CLEAR64 = 1e9LF;                      // least ratio of a divisor to its error
const double UNSURE64 = 1e-6LF;                    // relative distance from the contact tolerance
const uint NOT_BLOCKED = 0u, BLOCKED = 1u, IN_DOUBT = 2u;

// Determinant x . (y x z), and a bound on its error.
dvec2 filtered64(dvec3 x, dvec3 y, dvec3 z)
{
    precise dvec3 p = y.yzx * z.zxy, q = y.zxy * z.yzx, size = abs(x) * (abs(p) + abs(q));
    precise dvec3 terms = x * (p - q);
    return dvec2(terms.x + terms.y + terms.z, FILTER64 * (size.x + size.y + size.z) + TINY64);
}

// Return whether the closed triangle abc meets the open segment (eye, point) farther than `contact` from the point.
uint blocks64(dvec3 eye, dvec3 point, dvec3 a, dvec3 b, dvec3 c, double contact)
{
    dvec3 d = point - eye;
    dvec2 u = filtered64(d, b - point, c - b), v = filtered64(d, c - point, a - c), w = filtered64(d, a - point, b - a);
    bool above = u.x > u.y || v.x > v.y || w.x > w.y, below = u.x < -u.y || v.x < -v.y || w.x < -w.y;
    if (above && below) return NOT_BLOCKED;
    dvec2 near = filtered64(point - a, b - a, c - a), far = filtered64(eye - a, b - a, c - a);
    if (near.x > near.y && far.x > far.y || near.x < -near.y && far.x < -far.y) return NOT_BLOCKED;
    if (!(abs(near.x) > CLEAR64 * near.y && abs(far.x) > CLEAR64 * far.y)) return IN_DOUBT;
    double farther = abs(near.x) * sqrt(dot(d, d)), nearest = contact * (abs(near.x) + abs(far.x));
    if (farther < nearest * (1.0LF - UNSURE64)) return NOT_BLOCKED;
    bool passes = abs(u.x) > u.y && abs(v.x) > v.y && abs(w.x) > w.y;
    return passes && farther > nearest * (1.0LF + UNSURE64) ? BLOCKED : IN_DOUBT;
}
