// THE definition of "blocked" in float64: zbuf_occlude/geometry/predicates.py word for word, so that both decide alike.
// `precise` forbids the compiler to fuse or reorder: cross(b, a) must stay the exact negative of cross(a, b).

dvec3 cross64(dvec3 a, dvec3 b)
{
    precise dvec3 n;
    n.x = a.y * b.z - a.z * b.y;
    n.y = a.z * b.x - a.x * b.z;
    n.z = a.x * b.y - a.y * b.x;
    return n;
}

double dot64(dvec3 a, dvec3 b)
{
    precise double sum = a.x * b.x + a.y * b.y + a.z * b.z;
    return sum;
}

// Whether the closed triangle abc meets the open segment (eye, point) farther than `contact` from the point.
bool blocks64(dvec3 eye, dvec3 point, dvec3 a, dvec3 b, dvec3 c, double contact)
{
    precise dvec3 d = point - eye;
    precise dvec3 to_a = a - point, to_b = b - point, to_c = c - point;
    precise double u = dot64(d, cross64(to_b, to_c));
    precise double v = dot64(d, cross64(to_c, to_a));
    precise double w = dot64(d, cross64(to_a, to_b));
    bool inside = (u >= 0.0LF && v >= 0.0LF && w >= 0.0LF) || (u <= 0.0LF && v <= 0.0LF && w <= 0.0LF);
    precise dvec3 ab = b - a, ac = c - a, n = cross64(ab, ac);
    precise double slope = dot64(d, n);
    precise double volume = u + v + w;
    bool in_plane = slope == 0.0LF || volume == 0.0LF;
    // compared, not divided: drivers may divide by multiplying with a rounded reciprocal
    precise double height = -dot64(to_a, n);
    height = slope < 0.0LF ? -height : height;
    slope = abs(slope);
    precise double farther = height * sqrt(dot64(d, d)), nearest = contact * slope;
    return inside && !in_plane && farther > nearest && height < slope;
}
