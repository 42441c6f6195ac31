/* The reader of server-sent events: in whatever pieces a stream comes, it is the same events. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "clients/cli/stream.h"
#include "kit/kit.h"

typedef struct {
    char text[4000];
    size_t size;
} record;

static void on_event(void *user, const char *event, const char *data, size_t size) {
    record *r = user;
    assert_int_equal(strlen(data), size);
    r->size += (size_t)snprintf(r->text + r->size, sizeof r->text - r->size, "[%s|%s]", event, data);
}

static void take_in_pieces(const char *stream, size_t most, record *r, char last[CLI_EVENT_ID]) {
    cli_events e = {.fn = on_event, .user = r};
    size_t size = strlen(stream);
    r->size = 0;
    for (size_t at = 0, n; at < size; at += n) {
        n = 1 + (size_t)rand() % most;
        if (n > size - at) n = size - at;
        assert_true(cli_events_take(&e, stream + at, n));
    }
    memcpy(last, e.last, CLI_EVENT_ID);
    cli_events_clear(&e);
}

static void pieces_make_no_difference(void **state) {
    static const char stream[] = "retry: 2000\n\n:\n\nid: 7\nevent: log\ndata: one\ndata: two\ndata: \n\n"
                                 "event: progress\r\ndata:{\"a\": 1}\r\n\r\ndata: bare\rid: 9\r\r:comment\n\nunknown: x\nid\n\nid: 10\nevent: cut\ndata: never";
    static const char wanted[] = "[log|one\ntwo\n][progress|{\"a\": 1}][message|bare]";
    unsigned seed = (unsigned)time(NULL);
    record r;
    char last[CLI_EVENT_ID];
    (void)state;
    printf("seed %u\n", seed);
    srand(seed);
    for (int i = 0; i < 300; i++) {
        take_in_pieces(stream, 1 + (size_t)i, &r, last);
        assert_string_equal(r.text, wanted);
        assert_string_equal(last, "9"); /* not of an event whose end has not come */
    }
}

static void what_never_ends_is_refused(void **state) {
    static char line[4096];
    record r = {0};
    cli_events e = {.fn = on_event, .user = &r};
    int taken = 0;
    (void)state;
    memset(line, 'x', sizeof line);
    while (taken < 1000 && cli_events_take(&e, line, sizeof line)) taken++;
    assert_true(taken > 100 && taken < 1000);
    cli_events_clear(&e);
    e = (cli_events){.fn = on_event, .user = &r};
    memcpy(line, "data: ", 6);
    line[sizeof line - 1] = '\n';
    for (taken = 0; taken < 1000 && cli_events_take(&e, line, sizeof line);) taken++;
    assert_true(taken > 100 && taken < 1000);
    cli_events_clear(&e);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(pieces_make_no_difference), cmocka_unit_test(what_never_ends_is_refused)};
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
