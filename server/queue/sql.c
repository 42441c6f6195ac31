#include "server/queue/sql.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "server/log.h"

bw_status bw_sql_error(bw_sql *sql, const char *what) {
    char text[512];
    int code = sqlite3_extended_errcode(sql->db);
    bw_event(BW_ERROR, "queue.error", "code=%d what=%s message=%s", code, what,
             bw_quoted(sqlite3_errmsg(sql->db), text, sizeof text));
    if (code == SQLITE_IOERR_FSYNC || code == SQLITE_IOERR_DIR_FSYNC) abort(); /* see files.h */
    return BW_E_IO;
}

bw_status bw_sql_script(bw_sql *sql, const char *text) {
    return sqlite3_exec(sql->db, text, NULL, NULL, NULL) == SQLITE_OK ? BW_OK : bw_sql_error(sql, "script");
}

bw_status bw_sql_open(bw_sql *sql, const char *path, int flags, const char *pragmas) {
    memset(sql, 0, sizeof *sql);
    bw_status status = BW_OK;
    if (sqlite3_open_v2(path, &sql->db, flags, NULL) != SQLITE_OK) status = bw_sql_error(sql, "open");
    if (status == BW_OK) {
        sqlite3_busy_timeout(sql->db, 10000);
        sqlite3_extended_result_codes(sql->db, 1);
        status = bw_sql_script(sql, pragmas);
    }
    if (status != BW_OK) bw_sql_close(sql);
    return status;
}

void bw_sql_close(bw_sql *sql) {
    for (size_t i = 0; i < BW_SQL_STATEMENTS_MOST; i++) sqlite3_finalize(sql->known[i].statement);
    sqlite3_close(sql->db);
    memset(sql, 0, sizeof *sql);
}

static sqlite3_stmt *find(bw_sql *sql, const char *text) {
    size_t at = (size_t)((uintptr_t)text * UINT64_C(0x9e3779b97f4a7c15) >> 56) % BW_SQL_STATEMENTS_MOST;
    for (size_t n = 0; n < BW_SQL_STATEMENTS_MOST; n++, at = (at + 1) % BW_SQL_STATEMENTS_MOST) {
        if (sql->known[at].text == text) return sql->known[at].statement;
        if (sql->known[at].text) continue;
        sqlite3_stmt *made = NULL;
        if (sqlite3_prepare_v3(sql->db, text, -1, SQLITE_PREPARE_PERSISTENT, &made, NULL) != SQLITE_OK) {
            bw_sql_error(sql, "prepare");
            return NULL;
        }
        sql->known[at].text = text;
        sql->known[at].statement = made;
        return made;
    }
    abort(); /* more statements in the sources than the table holds */
}

static sqlite3_stmt *bound(bw_sql *sql, const char *text, const char *types, va_list args) {
    sqlite3_stmt *statement = find(sql, text);
    for (int i = 1; statement && *types; types++, i++) {
        if (*types == 'i') sqlite3_bind_int64(statement, i, va_arg(args, int64_t));
        else sqlite3_bind_text(statement, i, va_arg(args, const char *), -1, SQLITE_STATIC);
    }
    return statement;
}

sqlite3_stmt *bw_sql_query(bw_sql *sql, const char *text, const char *types, ...) {
    va_list args;
    va_start(args, types);
    sqlite3_stmt *statement = bound(sql, text, types, args);
    va_end(args);
    return statement;
}

void bw_sql_done(sqlite3_stmt *statement) {
    if (!statement) return;
    sqlite3_reset(statement);
    sqlite3_clear_bindings(statement);
}

bw_status bw_sql_run(bw_sql *sql, int *changes, const char *text, const char *types, ...) {
    va_list args;
    va_start(args, types);
    sqlite3_stmt *statement = bound(sql, text, types, args);
    va_end(args);
    if (changes) *changes = 0;
    if (!statement) return BW_E_IO;
    bw_status status = sqlite3_step(statement) == SQLITE_DONE ? BW_OK : bw_sql_error(sql, "step");
    if (status == BW_OK && changes) *changes = sqlite3_changes(sql->db);
    bw_sql_done(statement);
    return status;
}

bw_status bw_sql_number(bw_sql *sql, int64_t *value, int64_t otherwise, const char *text, const char *types, ...) {
    va_list args;
    va_start(args, types);
    sqlite3_stmt *statement = bound(sql, text, types, args);
    va_end(args);
    *value = otherwise;
    if (!statement) return BW_E_IO;
    int step = sqlite3_step(statement);
    if (step == SQLITE_ROW) *value = sqlite3_column_int64(statement, 0);
    bw_status status = step == SQLITE_ROW || step == SQLITE_DONE ? BW_OK : bw_sql_error(sql, "number");
    bw_sql_done(statement);
    return status;
}

char *bw_sql_text(sqlite3_stmt *statement, int column) {
    const unsigned char *text = sqlite3_column_text(statement, column);
    return text ? strdup((const char *)text) : NULL;
}

void bw_sql_put(char *out, size_t size, sqlite3_stmt *statement, int column) {
    const unsigned char *text = sqlite3_column_text(statement, column);
    snprintf(out, size, "%s", text ? (const char *)text : "");
}
