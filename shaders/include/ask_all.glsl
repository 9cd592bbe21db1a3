// main() of a pass that asks for 4 points and 8 eyes in one invocation: ask(eye, slot, point) is 1 for visible.
// Unrolled, with the eye known to be the same for the whole group: software rasterisers then load matrices only once.
void main()
{
    int eye = int(gl_WorkGroupID.y) * 8;
    uint bits = 0u;
    for (uint part = 0u; part < 4u; part++) {
        uint slot = gl_WorkGroupID.x * 256u + part * 64u + gl_LocalInvocationID.x;
        Point point = point_at(slot);
        uint seen = ask(eye, slot, point);
        seen |= ask(eye + 1, slot, point) << 1;
        seen |= ask(eye + 2, slot, point) << 2;
        seen |= ask(eye + 3, slot, point) << 3;
        seen |= ask(eye + 4, slot, point) << 4;
        seen |= ask(eye + 5, slot, point) << 5;
        seen |= ask(eye + 6, slot, point) << 6;
        seen |= ask(eye + 7, slot, point) << 7;
        bits |= seen << (8u * part);
    }
    answers[first_word + int(gl_WorkGroupID.y) * n_words + int(gl_GlobalInvocationID.x)] = bits;
}
