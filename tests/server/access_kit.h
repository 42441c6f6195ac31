/* Access tokens for tests: made and revoked by the program itself, as an operator does. Everything asserts (cmocka). */
#ifndef BW_TESTS_ACCESS_KIT_H
#define BW_TESTS_ACCESS_KIT_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>

#include "daemon_kit.h"
#include "server/access.h"

typedef struct {
    char secret[BW_TOKEN_TEXT];
    char id[BW_TOKEN_ID_TEXT];
} kit_token;

/* Runs `blockwrightd WORDS --data DIR` with its errors in DIR.log; the first line it prints, without its end. Returns the exit code. */
static inline int kit_blockwrightd(const kit_daemon *d, const char *words, char *line, size_t size) {
    char command[700];
    snprintf(command, sizeof command, "%s/blockwrightd %s --data %s 2>>%s.log", BW_BIN_DIR, words, d->data, d->data);
    FILE *f = popen(command, "r");
    assert_non_null(f);
    *line = '\0';
    if (fgets(line, (int)size, f)) line[strcspn(line, "\n")] = '\0';
    char rest[4096];
    while (fread(rest, 1, sizeof rest, f) > 0) continue;
    int status = pclose(f);
    assert_true(WIFEXITED(status));
    return WEXITSTATUS(status);
}

/* A token with the rest of the words of `token create`. */
static inline kit_token kit_new_token(const kit_daemon *d, const char *owner, const char *rest) {
    kit_token token;
    char words[300], line[200];
    snprintf(words, sizeof words, "token create --owner %s %s", owner, rest);
    assert_int_equal(kit_blockwrightd(d, words, line, sizeof line), 0);
    assert_int_equal(strlen(line), BW_TOKEN_TEXT - 1);
    memcpy(token.secret, line, sizeof token.secret);
    /* Its id is that of the youngest: list --json is sorted by age. */
    snprintf(words, sizeof words, "%s/blockwrightd token list --json --data %s", BW_BIN_DIR, d->data);
    FILE *f = popen(words, "r");
    json_t *all = json_loadf(f, 0, NULL), *list = json_object_get(all, "tokens");
    assert_int_equal(pclose(f), 0);
    snprintf(token.id, sizeof token.id, "%s", kit_text(json_array_get(list, json_array_size(list) - 1), "id"));
    json_decref(all);
    return token;
}

static inline int kit_revoke(const kit_daemon *d, const char *id) {
    char words[100], line[200];
    snprintf(words, sizeof words, "token revoke %s", id);
    return kit_blockwrightd(d, words, line, sizeof line);
}

/* A request with a token (NULL: none); `json` is the body if it is not NULL. */
static inline kit_reply kit_ask(const kit_daemon *d, const char *secret, const char *method, const char *path, const char *json) {
    char headers[300] = "";
    if (secret) snprintf(headers, sizeof headers, "Authorization: Bearer %s", secret);
    if (json) strcat(headers, "\nContent-Type: application/json");
    return kit_request(d, method, path, headers, json, json ? strlen(json) : 0);
}

#endif
