// Draws the mesh into one tile per instance: all cameras of a batch in one draw.
#version 430
#include "tiles.glsl"

uniform vec2 to_ndc;  // 2 / size of the atlas
uniform float side;   // of a tile, in pixels

in vec3 in_position;  // unit space

#if $FACES
flat out int face;  // each face's last (provoking) vertex is its own, and they come first, in the faces' order
#endif

void main()
{
    int tile = gl_InstanceID;
    vec4 place = tiles[tile].window * vec4(in_position, 1.0);
    gl_Position = vec4(place.xy * to_ndc - place.w, place.z, place.w);
#if $CUBE
    // a cube face's neighbours must not be drawn into
    vec2 low = place.xy - tiles[tile].corner.xy * place.w;
    vec2 high = side * place.w - low;
    gl_ClipDistance[0] = low.x;
    gl_ClipDistance[1] = low.y;
    gl_ClipDistance[2] = high.x;
    gl_ClipDistance[3] = high.y;
#endif
#if $FACES
    face = gl_VertexID;
#endif
}
