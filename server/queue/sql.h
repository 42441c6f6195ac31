/* A connection to the queue's file with its prepared statements.
 *
 * Every statement is prepared once per connection and found again by the address of its text, so that text must be a literal (or
 * live as long as the connection). A statement is used by one caller at a time; it is given back by bw_sql_done, which also ends
 * the transaction of a reader. An error of fsync ends the process (files.h).
 */
#ifndef BW_SERVER_QUEUE_SQL_H
#define BW_SERVER_QUEUE_SQL_H

#include <sqlite3.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include "base/status.h"

enum { BW_SQL_STATEMENTS_MOST = 256 };

typedef struct bw_sql {
    sqlite3 *db;
    struct {
        const char *text;
        sqlite3_stmt *statement;
    } known[BW_SQL_STATEMENTS_MOST]; /* hash table over the address of the text, linear probing */
} bw_sql;

/* Makes the connection and runs `pragmas`. On failure everything is closed. */
bw_status bw_sql_open(bw_sql *sql, const char *path, int flags, const char *pragmas);
void bw_sql_close(bw_sql *sql);

/* Tells the log about the last error of the connection; returns BW_E_IO. */
bw_status bw_sql_error(bw_sql *sql, const char *what);

/* The statement with its arguments bound: one letter each, i int64_t, s const char * (NULL allowed; it must live until
 * bw_sql_done). NULL after an error. */
sqlite3_stmt *bw_sql_query(bw_sql *sql, const char *text, const char *types, ...);
void bw_sql_done(sqlite3_stmt *statement); /* NULL allowed */
/* Runs a statement without rows; *changes (may be NULL) gets how many rows it changed itself, without triggers. */
bw_status bw_sql_run(bw_sql *sql, int *changes, const char *text, const char *types, ...);
/* The first column of the first row; `otherwise` if there is no row. */
bw_status bw_sql_number(bw_sql *sql, int64_t *value, int64_t otherwise, const char *text, const char *types, ...);
/* Runs text that is not kept. */
bw_status bw_sql_script(bw_sql *sql, const char *text);

/* Columns: a copy (NULL for NULL or without memory), or into a fixed room. */
char *bw_sql_text(sqlite3_stmt *statement, int column);
void bw_sql_put(char *out, size_t size, sqlite3_stmt *statement, int column);

#endif
