// Writes the id of the nearest face at each pixel's centre, beside the depth.
#version 430

#if $FACES
flat in int face;
out int seen;

void main() { seen = face; }
#else
void main() {}
#endif
