#include "server/queue/backup.h"

#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "server/files.h"
#include "server/queue/writer.h"

enum { STEP_PAGES = 1024, STEP_INSTRUCTIONS = 100000 };

/* Nothing else may use the connection meanwhile; with a read transaction open on it the copy never begins anew. */
static bw_status copy_pages(sqlite3 *from, sqlite3 *to, const atomic_bool *stop) {
    sqlite3_backup *copy = sqlite3_backup_init(to, "main", from, "main");
    int code = copy ? SQLITE_OK : SQLITE_ERROR;
    while (code == SQLITE_OK && !bw_stopped(stop)) code = sqlite3_backup_step(copy, STEP_PAGES);
    sqlite3_backup_finish(copy);
    return code == SQLITE_DONE ? BW_OK : code == SQLITE_OK ? BW_E_CANCELLED : BW_E_IO;
}

bw_status bw_sql_copy(bw_sql *from, const char *to, const atomic_bool *stop) {
    bw_sql copy = {0};
    int fd = open(to, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    if (fd < 0) return BW_E_IO;
    close(fd);
    bw_status status = bw_sql_open(&copy, to, SQLITE_OPEN_READWRITE | SQLITE_OPEN_NOMUTEX, "PRAGMA synchronous=FULL");
    if (status == BW_OK) status = copy_pages(from->db, copy.db, stop);
    if (status == BW_OK) status = bw_sql_script(&copy, "PRAGMA journal_mode=DELETE"); /* one file, nothing beside it */
    if (copy.db) bw_sql_close(&copy);
    if (status == BW_OK) status = bw_sync_path(to);
    if (status != BW_OK) unlink(to);
    return status;
}

bw_status bw_queue_copy(bw_queue *q, const char *to, const atomic_bool *stop, bw_copy_facts *facts) {
    bw_sql from = {0};
    char error[BW_COPY_ERROR];
    int64_t n;
    bw_status status = bw_sql_open(&from, q->path, SQLITE_OPEN_READWRITE | SQLITE_OPEN_NOMUTEX,
                                   "PRAGMA query_only=ON; PRAGMA wal_autocheckpoint=0; BEGIN");
    if (status == BW_OK) status = bw_sql_number(&from, &n, 0, "SELECT 1 FROM jobs LIMIT 1", ""); /* now the snapshot is taken */
    if (status == BW_OK) status = bw_sql_copy(&from, to, stop);
    if (from.db) bw_sql_script(&from, "ROLLBACK"), bw_sql_close(&from);
    if (status == BW_OK && (status = bw_copy_check(to, stop, facts, error)) != BW_OK) unlink(to);
    return status;
}

/* ---- looking at copies ---- */

static bw_status open_copy(bw_sql *sql, const char *path) {
    return access(path, R_OK) == 0 ? bw_sql_open(sql, path, SQLITE_OPEN_READONLY | SQLITE_OPEN_NOMUTEX, "PRAGMA query_only=ON") : BW_E_IO;
}

static int ask_stopped(void *stop) { return bw_stopped(stop); }

static bool is_sound(bw_sql *sql, const atomic_bool *stop) {
    sqlite3_progress_handler(sql->db, STEP_INSTRUCTIONS, ask_stopped, (void *)stop);
    sqlite3_stmt *stmt = bw_sql_query(sql, "PRAGMA integrity_check(1)", "");
    bool sound = stmt && sqlite3_step(stmt) == SQLITE_ROW && strcmp((const char *)sqlite3_column_text(stmt, 0), "ok") == 0;
    bw_sql_done(stmt);
    sqlite3_progress_handler(sql->db, 0, NULL, NULL);
    return sound;
}

static bw_status refuse(char error[BW_COPY_ERROR], bw_status status, const char *why) {
    snprintf(error, BW_COPY_ERROR, "%s", why);
    return status;
}

bw_status bw_copy_check(const char *path, const atomic_bool *stop, bw_copy_facts *facts, char error[BW_COPY_ERROR]) {
    bw_sql sql = {0};
    bw_status status = BW_OK;
    *facts = (bw_copy_facts){0};
    if (open_copy(&sql, path) != BW_OK) return refuse(error, BW_E_IO, "it cannot be opened");
    if (bw_sql_number(&sql, &facts->version, 0, "PRAGMA user_version", "") != BW_OK || facts->version < 1)
        status = refuse(error, BW_E_CHECK, "it is no copy of a queue");
    else if (facts->version > bw_schema_version()) status = refuse(error, BW_E_VERSION, "it is of a newer version of this program");
    else if (!is_sound(&sql, stop))
        status = bw_stopped(stop) ? refuse(error, BW_E_CANCELLED, "there is no time to look at it") : refuse(error, BW_E_CHECK, "it is damaged");
    else if (bw_sql_number(&sql, &facts->jobs, 0, "SELECT count(*) FROM jobs", "") != BW_OK)
        status = refuse(error, BW_E_CHECK, "it is no copy of a queue");
    bw_sql_close(&sql);
    return status;
}

bw_status bw_copy_files(const char *path, bw_copy_visit visit, void *user) {
    bw_sql sql = {0};
    int step = SQLITE_ERROR;
    bw_status status = open_copy(&sql, path);
    if (status != BW_OK) return status;
    sqlite3_stmt *stmt = bw_sql_query(&sql, "SELECT 'blobs', sha256, max(bytes) FROM blobs GROUP BY sha256 UNION ALL"
                                      " SELECT 'cache', key, bytes FROM outputs WHERE"
                                      " EXISTS (SELECT 1 FROM jobs WHERE result_key <> '' AND result_key = outputs.key) OR"
                                      " EXISTS (SELECT 1 FROM jobs WHERE state < 2 AND state_key <> '' AND state_key = outputs.key)", "");
    while (stmt && status == BW_OK && (step = sqlite3_step(stmt)) == SQLITE_ROW)
        status = visit(user, (const char *)sqlite3_column_text(stmt, 0), (const char *)sqlite3_column_text(stmt, 1), sqlite3_column_int64(stmt, 2));
    if (status == BW_OK && step != SQLITE_DONE) status = bw_sql_error(&sql, "files");
    bw_sql_done(stmt);
    bw_sql_close(&sql);
    return status;
}
