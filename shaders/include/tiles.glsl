// Tiles of the depth atlas, one a picture (gl/tiles.py). Depth is reversed: larger is nearer, 0 is where nothing is.
struct Tile {
    mat4 window;    // unit space -> (x, y, depth, 1) * eye depth; x and y in pixels of the atlas
    vec4 plane[3];  // a plane (normal, offset) of unit space -> its window-space coefficients of x, y and depth
    vec2 depth;     // x: what depth gains per unit of inverse eye depth; y: far - near
    vec2 corner;    // the tile's lower left, in pixels
};

layout(std140, binding = 0) uniform Tiles { Tile tiles[$TILES]; };
