/* Rotations form the octahedral group; determinants have the right sign however close to zero. */
#include "kit/kit.h"

#include "exact/det.h"
#include "exact/rotation.h"

static void rotations_are_a_group_of_determinant_one(void **state) {
    (void)state;
    for (bw_rotation a = 0; a < BW_ROTATIONS; a++) {
        int64_t m[3][3];
        for (int k = 0; k < 3; k++) {
            int64_t unit[3] = {k == 0, k == 1, k == 2};
            bw_rotate(a, unit, m[k]);
        }
        assert_int_equal(bw_det3_sign_exact(m[0], m[1], m[2]), 1);
        assert_int_equal(bw_rotation_compose(a, bw_rotation_inverse(a)), 0);
        for (bw_rotation b = 0; b < BW_ROTATIONS; b++) {
            int64_t u[3] = {3, -5, 11}, step[3], once[3];
            bw_rotate(b, u, step);
            bw_rotate(a, step, step);
            bw_rotate(bw_rotation_compose(a, b), u, once);
            assert_memory_equal(step, once, sizeof once);
        }
    }
}

static void fixed_axes_are_kept_by_nine_rotations(void **state) {
    (void)state;
    int about_axis = 0, about_diagonal = 0;
    for (bw_rotation r = 0; r < BW_ROTATIONS; r++) {
        about_axis += bw_rotation_kind(r) == 1;
        about_diagonal += bw_rotation_kind(r) == 2;
        int axis = bw_rotation_fixed_axis(r);
        if (axis < 0) continue;
        int64_t u[3] = {0, 0, 0}, v[3];
        u[axis] = 7;
        bw_rotate(r, u, v);
        assert_memory_equal(u, v, sizeof u);
    }
    assert_int_equal(about_axis, 9);
    assert_int_equal(about_diagonal, 14);
}

static bw_transition random_transition(kit_random *random) {
    bw_transition t = {.rotation = (bw_rotation)kit_random_below(random, BW_ROTATIONS)};
    for (int k = 0; k < 3; k++) t.shift[k] = (int64_t)kit_random_below(random, 2001) - 1000;
    return t;
}

static void transitions_compose_invert_and_carry_planes(void **state) {
    (void)state;
    kit_random random = kit_random_start(1);
    for (int i = 0; i < 1000; i++) {
        bw_transition a = random_transition(&random), b = random_transition(&random);
        bw_transition ab = bw_transition_compose(&a, &b), back = bw_transition_inverse(&a), one = bw_transition_compose(&back, &a);
        int64_t u[3] = {17, -4, (int64_t)kit_random_below(&random, 100)}, step[3], once[3];
        bw_transition_apply(&b, u, step);
        bw_transition_apply(&a, step, step);
        bw_transition_apply(&ab, u, once);
        assert_memory_equal(step, once, sizeof once);
        assert_true(bw_transition_is_identity(&one));
        for (int8_t k = 0; k < 3; k++) {
            int64_t image[3];
            bw_plane p = bw_transition_plane(&a, (bw_plane){u[k], k});
            bw_transition_apply(&a, u, image);
            assert_int_equal(image[p.axis], p.value);
        }
    }
}

/* Third rows that are combinations of the first two, moved by at most one unit: the filter alone cannot decide these. */
static void determinants_near_zero_are_decided_exactly(void **state) {
    (void)state;
    kit_random random = kit_random_start(2);
    int zero = 0, nonzero = 0;
    for (int i = 0; i < 20000; i++) {
        int64_t m[3][3], f[2];
        for (int j = 0; j < 6; j++) m[j / 3][j % 3] = (int64_t)(kit_random_next(&random) >> 20) - ((int64_t)1 << 43);
        for (int j = 0; j < 2; j++) f[j] = (int64_t)kit_random_below(&random, 9) - 4;
        for (int k = 0; k < 3; k++) m[2][k] = f[0] * m[0][k] + f[1] * m[1][k];
        if (i & 1) m[2][kit_random_below(&random, 3)] += (i & 2) - 1;
        int sign = bw_det3_sign(m[0], m[1], m[2]);
        assert_int_equal(sign, bw_det3_sign_exact(m[0], m[1], m[2]));
        assert_int_equal(bw_det3_sign(m[1], m[0], m[2]), -sign);
        zero += sign == 0, nonzero += sign != 0;
    }
    assert_true(zero >= 10000);
    assert_true(nonzero > 5000);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rotations_are_a_group_of_determinant_one),
        cmocka_unit_test(fixed_axes_are_kept_by_nine_rotations),
        cmocka_unit_test(transitions_compose_invert_and_carry_planes),
        cmocka_unit_test(determinants_near_zero_are_decided_exactly),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
