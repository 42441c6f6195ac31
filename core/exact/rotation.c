#include "exact/rotation.h"

/* Even permutations with an even number of minus signs, then odd permutations with an odd number. */
const int8_t bw_rotation_axis[BW_ROTATIONS][3] = {
    {0, 1, 2}, {0, 1, 2}, {0, 1, 2}, {0, 1, 2}, {1, 2, 0}, {1, 2, 0}, {1, 2, 0}, {1, 2, 0},
    {2, 0, 1}, {2, 0, 1}, {2, 0, 1}, {2, 0, 1}, {0, 2, 1}, {0, 2, 1}, {0, 2, 1}, {0, 2, 1},
    {2, 1, 0}, {2, 1, 0}, {2, 1, 0}, {2, 1, 0}, {1, 0, 2}, {1, 0, 2}, {1, 0, 2}, {1, 0, 2}};
const int8_t bw_rotation_sign[BW_ROTATIONS][3] = {
    {1, 1, 1},  {1, -1, -1}, {-1, 1, -1}, {-1, -1, 1},  {1, 1, 1},  {1, -1, -1}, {-1, 1, -1}, {-1, -1, 1},
    {1, 1, 1},  {1, -1, -1}, {-1, 1, -1}, {-1, -1, 1},  {-1, 1, 1}, {1, -1, 1},  {1, 1, -1},  {-1, -1, -1},
    {-1, 1, 1}, {1, -1, 1},  {1, 1, -1},  {-1, -1, -1}, {-1, 1, 1}, {1, -1, 1},  {1, 1, -1},  {-1, -1, -1}};

static bw_rotation find(const int8_t axis[3], const int8_t sign[3]) {
    for (bw_rotation r = 0; r < BW_ROTATIONS; r++) {
        bool same = true;
        for (int i = 0; i < 3; i++)
            same = same && bw_rotation_axis[r][i] == axis[i] && bw_rotation_sign[r][i] == sign[i];
        if (same) return r;
    }
    __builtin_unreachable(); /* the 24 rotations are closed under composition and inversion */
}

bw_rotation bw_rotation_compose(bw_rotation after, bw_rotation before) {
    int8_t axis[3], sign[3];
    for (int i = 0; i < 3; i++) {
        int j = bw_rotation_axis[after][i];
        axis[i] = bw_rotation_axis[before][j];
        sign[i] = (int8_t)(bw_rotation_sign[after][i] * bw_rotation_sign[before][j]);
    }
    return find(axis, sign);
}

bw_rotation bw_rotation_inverse(bw_rotation r) {
    int8_t axis[3] = {0, 0, 0}, sign[3] = {0, 0, 0};
    for (int i = 0; i < 3; i++) {
        axis[bw_rotation_axis[r][i]] = (int8_t)i;
        sign[bw_rotation_axis[r][i]] = bw_rotation_sign[r][i];
    }
    return find(axis, sign);
}

int bw_rotation_fixed_axis(bw_rotation r) {
    if (r == 0) return -1;
    for (int i = 0; i < 3; i++)
        if (bw_rotation_axis[r][i] == i && bw_rotation_sign[r][i] == 1) return i;
    return -1;
}

int bw_rotation_kind(bw_rotation r) { return r == 0 ? 0 : bw_rotation_fixed_axis(r) >= 0 ? 1 : 2; }

bw_transition bw_transition_compose(const bw_transition *after, const bw_transition *before) {
    bw_transition t = {.rotation = bw_rotation_compose(after->rotation, before->rotation)};
    bw_transition_apply(after, before->shift, t.shift);
    return t;
}

bw_transition bw_transition_inverse(const bw_transition *t) {
    bw_transition i = {.rotation = bw_rotation_inverse(t->rotation)};
    bw_rotate(i.rotation, t->shift, i.shift);
    for (int k = 0; k < 3; k++) i.shift[k] = -i.shift[k];
    return i;
}

bool bw_transition_is_identity(const bw_transition *t) {
    return t->rotation == 0 && !t->shift[0] && !t->shift[1] && !t->shift[2];
}

bw_plane bw_transition_plane(const bw_transition *t, bw_plane plane) {
    for (int i = 0; i < 3; i++)
        if (bw_rotation_axis[t->rotation][i] == plane.axis)
            return (bw_plane){bw_rotation_sign[t->rotation][i] * plane.value + t->shift[i], (int8_t)i};
    __builtin_unreachable(); /* every axis is the image of one axis */
}
