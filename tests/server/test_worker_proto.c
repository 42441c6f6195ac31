/* The daemon's decoder of what workers send: good frames in any pieces, hostile ones refused. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cmocka.h>

#include "server/worker/worker_proto.h"

static bw_decoder d;

/* Frames as bw_send_frame makes them. */
static size_t collect(int pair[2], unsigned char *out, size_t size) {
    shutdown(pair[0], SHUT_WR);
    size_t n = 0;
    for (ssize_t got; (got = recv(pair[1], out + n, size - n, 0)) > 0;) n += (size_t)got;
    close(pair[0]);
    close(pair[1]);
    return n;
}

/* Feeds the bytes in pieces of at most `piece`; returns the number of frames. */
static int feed(const unsigned char *data, size_t size, size_t piece, bw_frame_type *types) {
    int frames = 0;
    bw_frame frame;
    bw_decoder_init(&d);
    for (size_t at = 0; at < size;) {
        size_t room;
        void *space = bw_decoder_space(&d, &room);
        size_t n = size - at < piece ? size - at : piece;
        if (n > room) n = room;
        if (!n) break;
        memcpy(space, data + at, n);
        bw_decoder_filled(&d, n);
        at += n;
        while (bw_decoder_next(&d, &frame)) types[frames++] = frame.type;
        if (d.status != BW_OK) break;
    }
    return frames;
}

static void frames_arrive_whole_whatever_the_pieces(void **state) {
    (void)state;
    unsigned char bytes[4096];
    bw_frame_type types[16];
    int pair[2];
    assert_int_equal(socketpair(AF_UNIX, SOCK_STREAM, 0, pair), 0);
    assert_true(bw_send_frame(pair[0], BW_FRAME_HELLO, "{}", 2));
    assert_true(bw_send_progress(pair[0], 0.5));
    assert_true(bw_send_frame(pair[0], BW_FRAME_LOG, "", 0));
    assert_true(bw_send_frame(pair[0], BW_FRAME_RESULT, "{\"status\":\"ok\"}", 15));
    size_t size = collect(pair, bytes, sizeof bytes);
    for (size_t piece = 1; piece <= size; piece++) {
        assert_int_equal(feed(bytes, size, piece, types), 4);
        assert_int_equal(types[0], BW_FRAME_HELLO);
        assert_int_equal(types[3], BW_FRAME_RESULT);
        assert_int_equal(d.status, BW_OK);
    }
}

static void the_largest_frame_fits_and_a_larger_one_does_not(void **state) {
    (void)state;
    size_t size = BW_FRAME_HEADER + BW_FRAME_MOST;
    unsigned char *bytes = calloc(size, 1);
    bw_frame_type types[4];
    memcpy(bytes, "BW\2\1\0\0\1\0", 8); /* 65536 */
    assert_int_equal(feed(bytes, size, 1000, types), 1);
    bytes[4] = 1;
    assert_int_equal(feed(bytes, size, 1000, types), 0);
    assert_int_equal(d.status, BW_E_COUNT);
    free(bytes);
}

static void a_note_is_cut_to_what_the_daemon_takes(void **state) {
    (void)state;
    unsigned char bytes[1024];
    char text[300];
    bw_frame_type types[4];
    int pair[2];
    memset(text, 'x', sizeof text);
    assert_int_equal(socketpair(AF_UNIX, SOCK_STREAM, 0, pair), 0);
    assert_true(bw_send_frame(pair[0], BW_FRAME_HELLO, "{}", 2));
    assert_true(bw_send_frame(pair[0], BW_FRAME_NOTE, text, sizeof text));
    size_t size = collect(pair, bytes, sizeof bytes);
    assert_int_equal(size, 2 * BW_FRAME_HEADER + 2 + BW_FRAME_NOTE_MOST);
    assert_int_equal(feed(bytes, size, 7, types), 2);
    assert_int_equal(types[1], BW_FRAME_NOTE);
    assert_int_equal(d.status, BW_OK);
}

static void a_damaged_frame_is_refused_with_its_reason(void **state) {
    (void)state;
    const struct {
        const char *bytes;
        size_t size;
        bw_status status;
    } cases[] = {
        {"XW\1\1\0\0\0\0", 8, BW_E_SYNTAX},
        {"BX\1\1\0\0\0\0", 8, BW_E_SYNTAX},
        {"BW\1\1\0\0\0\0", 8, BW_E_VERSION},
        {"BW\2\0\0\0\0\0", 8, BW_E_SYNTAX},
        {"BW\2\6\0\0\0\0", 8, BW_E_SYNTAX},
        {"BW\2\1\377\377\377\377", 8, BW_E_COUNT},
        {"BW\2\2\7\0\0\0", 8, BW_E_COUNT},                                                  /* progress of 7 bytes */
        {"BW\2\5\311\0\0\0", 8, BW_E_COUNT},                                                /* note of 201 bytes */
        {"BW\2\3\0\0\0\0", 8, BW_E_SYNTAX},                                                 /* no hello */
        {"BW\2\1\0\0\0\0BW\2\1\0\0\0\0", 16, BW_E_SYNTAX},                                  /* hello twice */
        {"BW\2\1\0\0\0\0BW\2\4\0\0\0\0BW\2\4\0\0\0\0", 24, BW_E_SYNTAX},                    /* after the result */
        {"BW\2\1\0\0\0\0BW\2\2\10\0\0\0\0\0\0\0\0\0\370\177", 24, BW_E_NUMBER},             /* NaN */
        {"BW\2\1\0\0\0\0BW\2\2\10\0\0\0\0\0\0\0\0\0\0\100", 24, BW_E_NUMBER},               /* 2 */
        {"BW\2\1\0\0\0\0BW\2\2\10\0\0\0\0\0\0\0\0\0\360\277", 24, BW_E_NUMBER},             /* -1 */
    };
    bw_frame_type types[4];
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        for (size_t piece = 1; piece <= cases[i].size; piece += 7) {
            feed((const unsigned char *)cases[i].bytes, cases[i].size, piece, types);
            assert_int_equal(d.status, cases[i].status);
        }
}

static void an_incomplete_frame_waits_for_more(void **state) {
    (void)state;
    bw_frame_type types[4];
    for (size_t size = 0; size < 10; size++) {
        assert_int_equal(feed((const unsigned char *)"BW\2\1\2\0\0\0{}", size, 3, types), 0);
        assert_int_equal(d.status, BW_OK);
    }
}

static void nobody_dies_of_writing_to_a_daemon_that_is_gone(void **state) {
    (void)state;
    int pair[2];
    assert_int_equal(socketpair(AF_UNIX, SOCK_STREAM, 0, pair), 0);
    close(pair[1]);
    assert_false(bw_send_frame(pair[0], BW_FRAME_LOG, "x", 1)); /* no SIGPIPE */
    close(pair[0]);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(frames_arrive_whole_whatever_the_pieces),
        cmocka_unit_test(the_largest_frame_fits_and_a_larger_one_does_not),
        cmocka_unit_test(a_note_is_cut_to_what_the_daemon_takes),
        cmocka_unit_test(a_damaged_frame_is_refused_with_its_reason),
        cmocka_unit_test(an_incomplete_frame_waits_for_more),
        cmocka_unit_test(nobody_dies_of_writing_to_a_daemon_that_is_gone),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
