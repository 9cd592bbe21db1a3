// main() of a pass that tests 4 points and EYES eyes, at most 8, per invocation. ask(eye, point) returns VISIBLE,
// DOUBTFUL or HIDDEN; list(doubts, block) receives the mask of doubtful pairs, in the order of the answers.
// The compiler unrolls the loops, and the eye is the same for the whole group, so that software rasterisers load
// matrices only once.
void main()
{
    int eye = int(gl_WorkGroupID.y) * 8;
    uint block = uint(first_block) + gl_WorkGroupID.x;
    uint visible = 0u, doubts = 0u;
    for (uint part = 0u; part < 4u; part++) {
        Point point = point_at(block * 256u + gl_LocalInvocationID.x * 4u + part);
        uint found = 0u;
        for (int i = 0; i < $EYES; i++) found |= ask(eye + i, point) << i;
        visible |= (found & 0xFFu) << (8u * part);
        doubts |= (found >> 8) << (8u * part);
    }
    uint word = block * 64u + gl_LocalInvocationID.x;
    answers[uint(first_word) + gl_WorkGroupID.y * uint(n_words) + word] = visible;
    list(doubts, block);
}
