/* Access tokens: rows that are never deleted, so that a daemon which once had a token never opens again. */
#include <stdlib.h>
#include <string.h>

#include "server/queue/writer.h"

/* Scopes are stored as words, so that the numbers of the flags may change. */
static void scopes_text(int scopes, char text[80]) {
    text[0] = '\0';
    for (int i = 0; i < BW_SCOPE_COUNT; i++) {
        if (!(scopes & 1 << i)) continue;
        if (*text) strcat(text, " ");
        strcat(text, bw_scope_names[i]);
    }
}

static int scopes_of(const char *text) {
    int scopes = 0;
    for (size_t n; *text; text += n + strspn(text + n, " ")) {
        n = strcspn(text, " ");
        for (int i = 0; i < BW_SCOPE_COUNT; i++)
            if (strlen(bw_scope_names[i]) == n && strncmp(bw_scope_names[i], text, n) == 0) scopes |= 1 << i;
    }
    return scopes;
}

bw_status bw_write_token(bw_writer *w, void *user) {
    const bw_token *t = user;
    char scopes[80];
    scopes_text(t->scopes, scopes);
    return bw_sql_run(&w->sql, NULL, "INSERT INTO tokens (id, hash, owner, scopes, note, created, expires) VALUES (?, ?, ?, ?, ?, ?, ?)",
                      "sssssii", t->id, t->hash, t->owner, scopes, t->note ? t->note : "", t->created, t->expires);
}

bw_status bw_write_revocation(bw_writer *w, void *user) {
    bw_revocation *r = user;
    int64_t known = 0;
    bw_status status = bw_sql_number(&w->sql, &known, 0, "SELECT 1 FROM tokens WHERE id = ?", "s", r->id);
    r->found = known != 0;
    if (status != BW_OK || !known) return status;
    return bw_sql_run(&w->sql, NULL, "UPDATE tokens SET revoked = ? WHERE id = ? AND revoked = 0", "is", r->now, r->id);
}

void bw_tokens_free(bw_token *tokens, size_t count) {
    for (size_t i = 0; i < count; i++) free(tokens[i].note);
    free(tokens);
}

static bool read_token(sqlite3_stmt *stmt, bw_token *t) {
    memset(t, 0, sizeof *t);
    bw_sql_put(t->id, sizeof t->id, stmt, 0);
    bw_sql_put(t->hash, sizeof t->hash, stmt, 1);
    bw_sql_put(t->owner, sizeof t->owner, stmt, 2);
    t->scopes = scopes_of((const char *)sqlite3_column_text(stmt, 3));
    t->note = bw_sql_text(stmt, 4);
    t->created = sqlite3_column_int64(stmt, 5);
    t->expires = sqlite3_column_int64(stmt, 6);
    t->revoked = sqlite3_column_int64(stmt, 7);
    return t->note != NULL;
}

static bw_status collect(bw_sql *sql, bw_token **list, size_t *n) {
    size_t room = 0;
    int step = SQLITE_ERROR;
    bw_status status = BW_OK;
    sqlite3_stmt *stmt = bw_sql_query(sql, "SELECT id, hash, owner, scopes, note, created, expires, revoked FROM tokens"
                                      " ORDER BY created, id", "");
    while (stmt && status == BW_OK && (step = sqlite3_step(stmt)) == SQLITE_ROW) {
        if (*n == room) {
            bw_token *more = realloc(*list, (room = room ? 2 * room : 16) * sizeof *more);
            if (!more) status = BW_E_MEMORY;
            else *list = more;
        }
        if (status == BW_OK && !read_token(stmt, &(*list)[(*n)++])) status = BW_E_MEMORY;
    }
    if (status == BW_OK && step != SQLITE_DONE) status = bw_sql_error(sql, "tokens");
    bw_sql_done(stmt);
    return status;
}

bw_status bw_queue_tokens(bw_queue *q, bw_token **tokens, size_t *count) {
    bw_sql *reader = bw_reader_borrow(q);
    *tokens = NULL;
    *count = 0;
    bw_status status = reader ? collect(reader, tokens, count) : BW_E_IO;
    bw_reader_return(q, reader);
    if (status == BW_OK) return BW_OK;
    bw_tokens_free(*tokens, *count);
    *tokens = NULL;
    *count = 0;
    return status;
}
