// Tiles of the depth atlas, one per picture (gl/tiles.py). Depth is reversed: larger is nearer, 0 is the background.
struct Tile {
    mat4 to_window;  // unit space -> (x, y, depth, 1) * eye depth; x and y in pixels of the atlas
    vec4 across;  // for a plane of unit normal n through p, dot(n, across) / dot(n, eye - p) is the gain of its depth
    vec4 upward;  // per pixel to the right; with upward, per pixel upwards. across.w: gain of depth per unit of inverse
                  // eye depth; upward.w: far - near
    vec4 eye;     // unit space
    vec4 corner;  // lower left of the tile, and its side, in pixels; one unused
};

layout(std140, binding = 0) uniform Tiles { Tile tiles[$TILES]; };
