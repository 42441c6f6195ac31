/* Clients of event streams for tests, on libcurl's multi interface: any number of them in one thread. Everything asserts (cmocka). */
#ifndef BW_TESTS_STREAM_KIT_H
#define BW_TESTS_STREAM_KIT_H

#include <curl/curl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon_kit.h"

typedef struct {
    CURL *easy;
    struct curl_slist *headers;
    char *text; /* NUL-terminated */
    size_t size, most; /* most: bytes after which the client hangs up; 0: never */
    long status;
    CURLcode code;
    bool over;
} kit_stream;

typedef struct {
    long long id; /* -1: none */
    char event[16], *data;
    const char *next; /* where the search goes on */
} kit_sse;

static size_t kit_on_stream(char *data, size_t one, size_t size, void *user) {
    kit_stream *s = user;
    (void)one;
    size_t wanted = s->most && s->size + size > s->most ? s->most - s->size : size;
    s->text = realloc(s->text, s->size + wanted + 1);
    assert_non_null(s->text);
    memcpy(s->text + s->size, data, wanted);
    s->text[s->size += wanted] = '\0';
    return wanted == size ? size : 0;
}

/* `headers`: lines separated by \n, or NULL. */
static inline void kit_stream_open(kit_stream *s, CURLM *multi, const kit_daemon *d, const char *path, const char *headers, size_t most) {
    char url[300], line[300];
    memset(s, 0, sizeof *s);
    s->text = calloc(1, 1);
    s->most = most;
    s->easy = curl_easy_init();
    snprintf(url, sizeof url, "http://%s%s", d->address, path);
    for (const char *at = headers ? headers : ""; *at; at += *at == '\n') {
        size_t n = strcspn(at, "\n");
        snprintf(line, sizeof line, "%.*s", (int)n, at);
        if (n) s->headers = curl_slist_append(s->headers, line);
        at += n;
    }
    curl_easy_setopt(s->easy, CURLOPT_URL, url);
    curl_easy_setopt(s->easy, CURLOPT_HTTPHEADER, s->headers);
    curl_easy_setopt(s->easy, CURLOPT_WRITEFUNCTION, kit_on_stream);
    curl_easy_setopt(s->easy, CURLOPT_WRITEDATA, s);
    curl_easy_setopt(s->easy, CURLOPT_NOSIGNAL, 1L);
    curl_easy_setopt(s->easy, CURLOPT_PRIVATE, s);
    assert_int_equal(curl_multi_add_handle(multi, s->easy), CURLM_OK);
}

static inline void kit_stream_close(kit_stream *s, CURLM *multi) {
    if (s->easy) curl_multi_remove_handle(multi, s->easy);
    curl_easy_cleanup(s->easy);
    curl_slist_free_all(s->headers);
    free(s->text);
    memset(s, 0, sizeof *s);
}

/* Lets all streams of `multi` go on for about `ms`; how many still do. */
static inline int kit_stream_run(CURLM *multi, int ms) {
    int running = 0, left;
    CURLMsg *message;
    assert_int_equal(curl_multi_poll(multi, NULL, 0, ms, NULL), CURLM_OK);
    assert_int_equal(curl_multi_perform(multi, &running), CURLM_OK);
    while ((message = curl_multi_info_read(multi, &left))) {
        kit_stream *s;
        curl_easy_getinfo(message->easy_handle, CURLINFO_PRIVATE, (char **)&s);
        s->code = message->data.result;
        s->over = true;
        curl_easy_getinfo(s->easy, CURLINFO_RESPONSE_CODE, &s->status);
    }
    return running;
}

/* The next complete event at or after e->next (first: the stream's text). Its data (malloc'ed, lines joined by \n) is the caller's. */
static inline bool kit_stream_next(kit_sse *e) {
    for (;;) {
        const char *end = strstr(e->next, "\n\n");
        if (!end) return false;
        const char *at = e->next;
        e->next = end + 2;
        e->id = -1;
        e->event[0] = '\0';
        e->data = calloc(1, (size_t)(end - at) + 2);
        size_t n = 0;
        for (; at < end; at++) {
            size_t line = strcspn(at, "\n");
            if (strncmp(at, "id: ", 4) == 0) e->id = atoll(at + 4);
            if (strncmp(at, "event: ", 7) == 0) snprintf(e->event, sizeof e->event, "%.*s", (int)line - 7, at + 7);
            if (strncmp(at, "data: ", 6) == 0) {
                if (n) e->data[n++] = '\n';
                memcpy(e->data + n, at + 6, line - 6);
                n += line - 6;
            }
            at += line;
        }
        if (*e->event) return true;
        free(e->data);
    }
}

/* How many complete events of this name there are. */
static inline int kit_stream_count(const kit_stream *s, const char *event) {
    kit_sse e = {.next = s->text};
    int n = 0;
    while (kit_stream_next(&e)) {
        n += strcmp(e.event, event) == 0;
        free(e.data);
    }
    return n;
}

/* Reads one stream to its end, for `seconds` at most. */
static inline void kit_stream_whole(kit_stream *s, CURLM *multi, const kit_daemon *d, const char *path, const char *headers, int seconds) {
    kit_stream_open(s, multi, d, path, headers, 0);
    for (int i = 0; !s->over && i < seconds * 1000; i++) kit_stream_run(multi, 20);
    assert_true(s->over);
    assert_int_equal(s->code, CURLE_OK);
}

#endif
