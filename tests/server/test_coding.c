/* Content codings: which one a client wants, there and back, and what is refused. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <zlib.h>
#include <zstd.h>

#include "server/http/coding.h"

static void the_coding_that_the_client_likes_best_is_taken(void **state) {
    (void)state;
    static const struct {
        const char *accept;
        bw_coding coding;
    } cases[] = {
        {NULL, BW_CODING_IDENTITY}, {"", BW_CODING_IDENTITY}, {"gzip", BW_CODING_GZIP}, {"GZip", BW_CODING_GZIP}, {"zstd", BW_CODING_ZSTD},
        {"gzip, zstd", BW_CODING_ZSTD}, {"gzip;q=1, zstd;q=0.9", BW_CODING_GZIP}, {"gzip;q=0.5,zstd;q=0.501", BW_CODING_ZSTD},
        {"br", BW_CODING_IDENTITY}, {"br, gzip;q=0", BW_CODING_IDENTITY}, {"*", BW_CODING_ZSTD}, {"*;q=0", BW_CODING_IDENTITY},
        {"zstd;q=0, *", BW_CODING_GZIP}, {"identity, gzip;q=0.5", BW_CODING_IDENTITY}, {"identity;q=0.5, gzip;q=0.5", BW_CODING_GZIP},
        {"identity;q=0, gzip;q=0.001", BW_CODING_GZIP}, {"gzip ; q=0.3 , deflate", BW_CODING_GZIP}, {"gzipped", BW_CODING_IDENTITY},
        {"gzip;q=", BW_CODING_IDENTITY}, {"gzip;q=x", BW_CODING_IDENTITY}, {";;;,,q=1", BW_CODING_IDENTITY}, {"gzip;q=2", BW_CODING_IDENTITY},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        if (bw_coding_accepted(cases[i].accept) != cases[i].coding) fail_msg("Accept-Encoding: %s", cases[i].accept);
}

static void only_one_known_coding_is_found(void **state) {
    (void)state;
    bw_coding c;
    assert_true(bw_coding_find("identity", &c) && c == BW_CODING_IDENTITY);
    assert_true(bw_coding_find("gzip", &c) && c == BW_CODING_GZIP);
    assert_true(bw_coding_find("x-gzip ", &c) && c == BW_CODING_GZIP);
    assert_true(bw_coding_find("ZSTD", &c) && c == BW_CODING_ZSTD);
    for (const char *const *bad = (const char *const[]){"", "deflate", "br", "gzip, zstd", "gzip,gzip", "gzip x", NULL}; *bad; bad++)
        assert_false(bw_coding_find(*bad, &c));
}

typedef struct {
    char *data;
    size_t size, room, most, piece; /* piece: the largest that came */
} buffer;

static bool take(void *user, const char *data, size_t size) {
    buffer *b = user;
    if (!size) return true;
    if (size > b->piece) b->piece = size;
    if (b->size + size > b->most) return false;
    if (b->size + size > b->room) b->data = realloc(b->data, b->room = 2 * (b->size + size));
    memcpy(b->data + b->size, data, size);
    b->size += size;
    return true;
}

/* Packs in pieces of `in` bytes into spaces of `out` bytes. */
static buffer pack(bw_coding coding, const char *data, size_t size, size_t in, size_t out) {
    buffer b = {.most = SIZE_MAX};
    char *space = malloc(out);
    bool done = false;
    bw_packer *p = bw_packer_new(coding, size);
    const char *at = data;
    while (!done) {
        size_t rest = (size_t)(data + size - at), given = rest < in ? rest : in, left = given, written;
        assert_int_equal(bw_pack(p, &at, &left, given == rest, space, out, &written, &done), BW_OK);
        assert_true(written <= out);
        take(&b, space, written);
    }
    bw_packer_free(p);
    free(space);
    return b;
}

static bw_status unpack(bw_coding coding, const char *data, size_t size, size_t in, size_t most, buffer *b, bool *complete) {
    bw_status status = BW_OK;
    bw_unpacker *u = bw_unpacker_new(coding);
    *b = (buffer){.most = most};
    for (size_t at = 0; status == BW_OK && at < size; at += in) status = bw_unpack(u, data + at, size - at < in ? size - at : in, take, b);
    *complete = bw_unpacker_complete(u);
    bw_unpacker_free(u);
    assert_true(b->piece <= BW_UNPACK_PIECE);
    return status;
}

static char *sample_text(size_t size) {
    char *text = malloc(size + 1);
    srand(11);
    for (size_t i = 0; i < size; i++) text[i] = rand() % 3 ? "0123456789 .\n"[rand() % 13] : 'a';
    return text;
}

static void what_was_packed_is_unpacked_whatever_the_pieces(void **state) {
    (void)state;
    static const size_t sizes[] = {0, 1, 100, 65535, 65536, 65537, 400000}, pieces[] = {1000, 65536, 1 << 20};
    for (int c = BW_CODING_GZIP; c < BW_CODING_COUNT; c++)
        for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++)
            for (size_t k = 0; k < 9; k++) {
                char *text = sample_text(sizes[i]);
                buffer packed = pack((bw_coding)c, text, sizes[i], pieces[k / 3], pieces[k % 3]), back;
                bool complete;
                assert_int_equal(unpack((bw_coding)c, packed.data, packed.size, pieces[(k + 1) % 3], SIZE_MAX, &back, &complete), BW_OK);
                assert_true(complete);
                assert_int_equal(back.size, sizes[i]);
                assert_true(!sizes[i] || memcmp(back.data, text, sizes[i]) == 0);
                free(text), free(packed.data), free(back.data);
            }
}

static void a_bomb_is_left_as_soon_as_there_is_enough(void **state) {
    (void)state;
    enum { HUGE_SIZE = 64 << 20, MOST = 100000 };
    char *zeros = calloc(HUGE_SIZE, 1);
    for (int c = BW_CODING_GZIP; c < BW_CODING_COUNT; c++) {
        buffer packed = pack((bw_coding)c, zeros, HUGE_SIZE, 1 << 20, 65536), back;
        bool complete;
        assert_true(packed.size < HUGE_SIZE / 500);
        assert_int_equal(unpack((bw_coding)c, packed.data, packed.size, packed.size, MOST, &back, &complete), BW_E_LIMIT);
        assert_true(back.size <= MOST);
        free(packed.data), free(back.data);
    }
    free(zeros);
}

static void what_ends_early_is_not_complete(void **state) {
    (void)state;
    char *text = sample_text(5000);
    for (int c = BW_CODING_GZIP; c < BW_CODING_COUNT; c++) {
        buffer packed = pack((bw_coding)c, text, 5000, 5000, 5000), back;
        for (size_t size = 0; size < packed.size; size += 7) {
            bool complete;
            assert_int_equal(unpack((bw_coding)c, packed.data, size, 100, SIZE_MAX, &back, &complete), BW_OK);
            assert_false(complete);
            free(back.data);
        }
        free(packed.data);
    }
    free(text);
}

static void damage_is_noticed(void **state) {
    (void)state;
    char *text = sample_text(5000);
    for (int c = BW_CODING_GZIP; c < BW_CODING_COUNT; c++) {
        buffer packed = pack((bw_coding)c, text, 5000, 5000, 5000), back;
        for (size_t at = 10; at < packed.size; at += 13) { /* behind the header, whose time and name nobody checks */
            bool complete;
            packed.data[at] ^= 4;
            bw_status status = unpack((bw_coding)c, packed.data, packed.size, 100, SIZE_MAX, &back, &complete);
            if (status == BW_OK && complete) fail_msg("coding %d, byte %zu", c, at);
            packed.data[at] ^= 4;
            free(back.data);
        }
        packed.data = realloc(packed.data, packed.size + 5);
        memcpy(packed.data + packed.size, "junk!", 5);
        bool complete;
        assert_int_equal(unpack((bw_coding)c, packed.data, packed.size + 5, 100, SIZE_MAX, &back, &complete), BW_E_SYNTAX);
        free(packed.data), free(back.data);
    }
    free(text);
}

static void members_one_after_another_are_one(void **state) {
    (void)state;
    for (int c = BW_CODING_GZIP; c < BW_CODING_COUNT; c++)
        for (size_t in = 1; in < 200; in += 9) {
            buffer a = pack((bw_coding)c, "first ", 6, 6, 100), b = pack((bw_coding)c, "second", 6, 6, 100), back;
            bool complete;
            a.most = SIZE_MAX;
            take(&a, b.data, b.size);
            assert_int_equal(unpack((bw_coding)c, a.data, a.size, in, SIZE_MAX, &back, &complete), BW_OK);
            assert_true(complete && back.size == 12 && memcmp(back.data, "first second", 12) == 0);
            free(a.data), free(b.data), free(back.data);
        }
}

/* RFC 9659: more than 8 MiB of window is refused, however little data comes. */
static void a_large_window_is_refused(void **state) {
    (void)state;
    for (int log = 23; log <= 24; log++) {
        char packed[1000];
        ZSTD_CCtx *ctx = ZSTD_createCCtx();
        ZSTD_CCtx_setParameter(ctx, ZSTD_c_windowLog, log);
        ZSTD_inBuffer from = {"little", 6, 0};
        ZSTD_outBuffer to = {packed, sizeof packed, 0};
        assert_false(ZSTD_isError(ZSTD_compressStream2(ctx, &to, &from, ZSTD_e_flush))); /* size unknown: the header states the window */
        assert_int_equal(ZSTD_compressStream2(ctx, &to, &from, ZSTD_e_end), 0);
        ZSTD_freeCCtx(ctx);
        buffer back;
        bool complete;
        bw_status status = unpack(BW_CODING_ZSTD, packed, to.pos, to.pos, SIZE_MAX, &back, &complete);
        assert_int_equal(status, log == 23 ? BW_OK : BW_E_SYNTAX);
        free(back.data);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_coding_that_the_client_likes_best_is_taken),
        cmocka_unit_test(only_one_known_coding_is_found),
        cmocka_unit_test(what_was_packed_is_unpacked_whatever_the_pieces),
        cmocka_unit_test(a_bomb_is_left_as_soon_as_there_is_enough),
        cmocka_unit_test(what_ends_early_is_not_complete),
        cmocka_unit_test(damage_is_noticed),
        cmocka_unit_test(members_one_after_another_are_one),
        cmocka_unit_test(a_large_window_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
