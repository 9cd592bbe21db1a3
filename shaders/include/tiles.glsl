// Tiles of the depth atlas, one a picture (gl/tiles.py). Depth is reversed: larger is nearer, 0 is where nothing is.
struct Tile {
    mat4 window;  // unit space -> (x, y, depth, 1) * eye depth; x and y in pixels of the atlas
    vec4 across;  // for a plane of unit normal n through p, dot(n, across) / dot(n, eye - p) is what its depth gains
    vec4 upward;  // from a pixel to the next, to the right and upwards. across.w: what depth gains per unit of inverse
                  // eye depth; upward.w: far - near
    vec4 eye;     // unit space
    vec4 corner;  // the tile's lower left, and its side, in pixels; one unused
};

layout(std140, binding = 0) uniform Tiles { Tile tiles[$TILES]; };
