// Points of the compute passes of the depth test, and their positions in window space.
struct Point {
    vec3 position;  // unit space
    int own;        // own face, -1 for none
    vec3 normal;    // normal of the own face; 0 for none
};

layout(std430, binding = 0) readonly buffer Points { uvec4 points[]; };
layout(std430, binding = 1) buffer Answers { uint answers[]; };  // 8 eyes per byte, 4 points per word

uniform float tolerance;  // eye depth, unit space

Point point_at(uint slot)
{
    uvec4 first = points[2u * slot], second = points[2u * slot + 1u];
    return Point(uintBitsToFloat(first.xyz), int(first.w), uintBitsToFloat(second.xyz));
}

// Return the tile in which an eye sees a point: its only one, or that of the cube face that contains the point.
int tile_of(int eye, vec3 position)
{
#if $CUBE
    vec3 d = position - tiles[6 * eye].eye.xyz, size = abs(d);
    int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    float along = axis == 0 ? d.x : axis == 1 ? d.y : d.z;
    return 6 * eye + 2 * axis + int(along < 0.0);
#else
    return eye;
#endif
}

// Point in window space, and the slope of its own plane there.
struct WindowPoint {
    vec2 pixel;
    float depth;      // reversed: larger is nearer
    vec2 gain;        // gain of the plane's depth per pixel to the right and upwards; 0 for a free point
    float allowance;  // depth equivalent here of `tolerance`
    bool aside;       // outside the picture, which holds the whole mesh, or behind the eye: no face is in front of it
};

WindowPoint project(int tile, Point point)
{
    vec4 c = tiles[tile].to_window * vec4(point.position, 1.0);
    float inverse = 1.0 / c.w;
    // depth of one unit of eye depth, and of the whole frustum, which limits the gain of a plane per pixel
    float unit = tiles[tile].across.w * inverse * inverse, most = tiles[tile].upward.w * unit;
    vec3 d = tiles[tile].eye.xyz - point.position;
    float facing = dot(d, point.normal);
    vec2 gain = vec2(dot(tiles[tile].across.xyz, point.normal), dot(tiles[tile].upward.xyz, point.normal));
    gain = facing == 0.0 ? vec2(0.0) : clamp(gain / facing, -most, most);
    vec2 pixel = c.xy * inverse;
#if $CUBE
    bool aside = false;
#else
    // the border of a picture, two pixels wide, is empty
    vec2 inner = pixel - tiles[tile].corner.xy;
    bool aside = c.w <= 0.0 || any(lessThan(inner, vec2(1.0))) || any(greaterThan(inner, vec2(tiles[tile].corner.z - 1.0)));
#endif
    return WindowPoint(pixel, c.z * inverse, gain, tolerance * unit, aside);
}
