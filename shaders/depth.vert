// Draws the mesh into one tile per instance: all cameras of a batch in one draw.
#version 430
#include "tiles.glsl"

uniform vec2 to_ndc;  // 2 / size of the atlas
uniform float side;   // side of a tile, in pixels

in vec3 in_position;  // unit space

#if $FACES
flat out int face;  // each face has a last (provoking) vertex of its own; these come first, in drawing order
#endif

void main()
{
    int tile = gl_InstanceID;
    vec4 projected = tiles[tile].to_window * vec4(in_position, 1.0);
    gl_Position = vec4(projected.xy * to_ndc - projected.w, projected.z, projected.w);
#if $CUBE
    // clip at the tile's sides, beyond which are other cube faces
    vec2 low = projected.xy - tiles[tile].corner.xy * projected.w;
    vec2 high = side * projected.w - low;
    gl_ClipDistance[0] = low.x;
    gl_ClipDistance[1] = low.y;
    gl_ClipDistance[2] = high.x;
    gl_ClipDistance[3] = high.y;
#endif
#if $FACES
    face = gl_VertexID;
#endif
}
