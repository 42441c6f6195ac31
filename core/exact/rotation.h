/* The 24 rotations of the octahedral group, and chart transitions on the integer grid.
 *
 * Rotation r maps u to v with v[i] = sign[r][i] * u[axis[r][i]]. Rotation 0 is the identity.
 */
#ifndef BW_EXACT_ROTATION_H
#define BW_EXACT_ROTATION_H

#include <stdbool.h>
#include <stdint.h>

enum { BW_ROTATIONS = 24 };
typedef uint8_t bw_rotation;

extern const int8_t bw_rotation_axis[BW_ROTATIONS][3];
extern const int8_t bw_rotation_sign[BW_ROTATIONS][3];
extern const int8_t bw_rotation_image[BW_ROTATIONS][3]; /* axis[r][image[r][k]] is k: where axis k goes */
extern const bw_rotation bw_rotation_inverse_of[BW_ROTATIONS];
extern const bw_rotation bw_rotation_product[BW_ROTATIONS][BW_ROTATIONS]; /* [after][before] */

/* u -> after(before(u)) */
static inline bw_rotation bw_rotation_compose(bw_rotation after, bw_rotation before) {
    return bw_rotation_product[after][before];
}
static inline bw_rotation bw_rotation_inverse(bw_rotation r) { return bw_rotation_inverse_of[r]; }
/* 0: identity; 1: about a coordinate axis (quarter or half turn); 2: other (no coordinate direction is kept). */
int bw_rotation_kind(bw_rotation r);
/* Axis (0..2) of a rotation of kind 1; -1 otherwise. */
int bw_rotation_fixed_axis(bw_rotation r);

/* u -> rotation(u) + shift, in grid units. */
typedef struct {
    int64_t shift[3];
    bw_rotation rotation;
} bw_transition;

static inline void bw_rotate(bw_rotation r, const int64_t u[3], int64_t out[3]) {
    int64_t v[3];
    for (int i = 0; i < 3; i++) v[i] = bw_rotation_sign[r][i] * u[bw_rotation_axis[r][i]];
    for (int i = 0; i < 3; i++) out[i] = v[i];
}
static inline void bw_transition_apply(const bw_transition *t, const int64_t u[3], int64_t out[3]) {
    bw_rotate(t->rotation, u, out);
    for (int i = 0; i < 3; i++) out[i] += t->shift[i];
}
static inline bw_transition bw_transition_compose(const bw_transition *after, const bw_transition *before) {
    bw_transition t = {.rotation = bw_rotation_compose(after->rotation, before->rotation)};
    bw_transition_apply(after, before->shift, t.shift);
    return t;
}
static inline bw_transition bw_transition_inverse(const bw_transition *t) {
    bw_transition i = {.rotation = bw_rotation_inverse(t->rotation)};
    bw_rotate(i.rotation, t->shift, i.shift);
    for (int k = 0; k < 3; k++) i.shift[k] = -i.shift[k];
    return i;
}
bool bw_transition_is_identity(const bw_transition *t);
static inline bool bw_transition_equal(const bw_transition *a, const bw_transition *b) {
    return a->rotation == b->rotation && a->shift[0] == b->shift[0] && a->shift[1] == b->shift[1] && a->shift[2] == b->shift[2];
}

/* The plane u[axis] = value, carried along a transition. */
typedef struct {
    int64_t value;
    int8_t axis;
} bw_plane;
static inline bw_plane bw_transition_plane(const bw_transition *t, bw_plane plane) {
    int8_t i = bw_rotation_image[t->rotation][plane.axis];
    return (bw_plane){bw_rotation_sign[t->rotation][i] * plane.value + t->shift[i], i};
}

#endif
