#include <inttypes.h>
#include <limits.h>
#include <stdio.h>
#include <unistd.h>

#include "server/files.h"
#include "server/log.h"
#include "server/queue/writer.h"

/* Migrations: entry i leads from version i to version i + 1 (PRAGMA user_version). To change the schema append an entry;
 * never edit one that has been released. */
static const char *const migrations[] = {
    "CREATE TABLE jobs ("
    " seq INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE, name TEXT, input TEXT NOT NULL,"
    " options TEXT NOT NULL, state INTEGER NOT NULL, open INTEGER NOT NULL DEFAULT 0, cancel INTEGER NOT NULL DEFAULT 0,"
    " stage INTEGER NOT NULL DEFAULT 0, stage_count INTEGER NOT NULL, attempt INTEGER NOT NULL DEFAULT 0,"
    " tries INTEGER NOT NULL DEFAULT 0, interruptions INTEGER NOT NULL DEFAULT 0, due INTEGER NOT NULL DEFAULT 0,"
    " created INTEGER NOT NULL, started INTEGER NOT NULL DEFAULT 0, finished INTEGER NOT NULL DEFAULT 0,"
    " failure TEXT, result_key TEXT NOT NULL DEFAULT '');"
    "CREATE INDEX jobs_waiting ON jobs(seq) WHERE open = 0 AND state IN (0, 1);"
    "CREATE INDEX jobs_by_state ON jobs(state, seq);"
    "CREATE TABLE attempts ("
    " job TEXT NOT NULL REFERENCES jobs(id), attempt INTEGER NOT NULL, stage TEXT NOT NULL, reused INTEGER NOT NULL,"
    " started INTEGER NOT NULL, finished INTEGER NOT NULL DEFAULT 0, outcome TEXT NOT NULL DEFAULT '',"
    " PRIMARY KEY (job, attempt)) WITHOUT ROWID;"
    "CREATE INDEX attempts_open ON attempts(job) WHERE finished = 0;"
    "CREATE TABLE outputs (key TEXT PRIMARY KEY, bytes INTEGER NOT NULL, manifest TEXT, created INTEGER NOT NULL)"
    " WITHOUT ROWID;",

    "ALTER TABLE jobs ADD COLUMN parameters TEXT NOT NULL DEFAULT '';",

    "ALTER TABLE jobs ADD COLUMN finish INTEGER NOT NULL DEFAULT 0;"
    "ALTER TABLE jobs ADD COLUMN cut INTEGER NOT NULL DEFAULT 0;",

    /* 4: owners and their turns, tags, events, idempotency, tokens, who may name a blob, what was deleted.
     * owners' counters are kept by triggers, so that no statement about jobs can forget them. */
    "ALTER TABLE jobs ADD COLUMN owner TEXT NOT NULL DEFAULT '';"
    "ALTER TABLE jobs ADD COLUMN priority INTEGER NOT NULL DEFAULT 0;"
    "ALTER TABLE jobs ADD COLUMN pinned INTEGER NOT NULL DEFAULT 0;"
    "DROP INDEX jobs_waiting;"
    "CREATE INDEX jobs_waiting ON jobs(owner, state DESC, priority DESC, seq) WHERE open = 0 AND state < 2;"
    "CREATE INDEX jobs_due ON jobs(due) WHERE open = 0 AND state < 2 AND due > 0;"
    "CREATE INDEX jobs_open ON jobs(owner) WHERE open = 1;"
    "CREATE INDEX jobs_by_owner ON jobs(owner, seq);"
    "CREATE INDEX jobs_by_owner_state ON jobs(owner, state, seq);"
    "CREATE TABLE tags (tag TEXT NOT NULL, seq INTEGER NOT NULL, PRIMARY KEY (tag, seq)) WITHOUT ROWID;"
    "CREATE INDEX tags_of_job ON tags(seq, tag);"
    "CREATE TABLE owners (owner TEXT PRIMARY KEY, waiting INTEGER NOT NULL DEFAULT 0, running INTEGER NOT NULL DEFAULT 0,"
    " finished INTEGER NOT NULL DEFAULT 0, bytes INTEGER NOT NULL DEFAULT 0, served INTEGER NOT NULL DEFAULT 0)"
    " WITHOUT ROWID;"
    "CREATE INDEX owners_turn ON owners(served, owner) WHERE waiting > 0;"
    "INSERT INTO owners (owner, waiting, running, finished)"
    " SELECT owner, sum(open = 0 AND state < 2), sum(open = 1), sum(open = 0 AND state > 1) FROM jobs GROUP BY owner;"
    "CREATE TRIGGER jobs_added AFTER INSERT ON jobs BEGIN"
    " INSERT INTO owners (owner, waiting, running, finished)"
    " VALUES (new.owner, new.open = 0 AND new.state < 2, new.open = 1, new.open = 0 AND new.state > 1)"
    " ON CONFLICT (owner) DO UPDATE SET waiting = waiting + excluded.waiting, running = running + excluded.running,"
    " finished = finished + excluded.finished; END;"
    "CREATE TRIGGER jobs_changed AFTER UPDATE OF state, open ON jobs"
    " WHEN new.open <> old.open OR (new.state > 1) <> (old.state > 1) BEGIN"
    " UPDATE owners SET waiting = waiting + (new.open = 0 AND new.state < 2) - (old.open = 0 AND old.state < 2),"
    " running = running + (new.open = 1) - (old.open = 1),"
    " finished = finished + (new.open = 0 AND new.state > 1) - (old.open = 0 AND old.state > 1)"
    " WHERE owner = new.owner; END;"
    "CREATE TRIGGER jobs_removed AFTER DELETE ON jobs BEGIN"
    " UPDATE owners SET waiting = waiting - (old.open = 0 AND old.state < 2), running = running - (old.open = 1),"
    " finished = finished - (old.open = 0 AND old.state > 1) WHERE owner = old.owner;"
    " DELETE FROM tags WHERE seq = old.seq; DELETE FROM events WHERE job = old.id; END;"
    "CREATE TABLE idempotency (owner TEXT NOT NULL, key TEXT NOT NULL, digest TEXT NOT NULL, response TEXT NOT NULL,"
    " created INTEGER NOT NULL, PRIMARY KEY (owner, key)) WITHOUT ROWID;"
    "CREATE INDEX idempotency_by_age ON idempotency(created);"
    "CREATE TABLE events (seq INTEGER PRIMARY KEY AUTOINCREMENT, job TEXT NOT NULL, kind TEXT NOT NULL,"
    " data TEXT NOT NULL, at INTEGER NOT NULL);"
    "CREATE INDEX events_of_job ON events(job, seq);"
    "CREATE TABLE tokens (id TEXT PRIMARY KEY, hash TEXT NOT NULL UNIQUE, owner TEXT NOT NULL, scopes TEXT NOT NULL,"
    " note TEXT NOT NULL DEFAULT '', created INTEGER NOT NULL, expires INTEGER NOT NULL DEFAULT 0,"
    " revoked INTEGER NOT NULL DEFAULT 0);"
    "CREATE TABLE blobs (sha256 TEXT NOT NULL, owner TEXT NOT NULL, bytes INTEGER NOT NULL, created INTEGER NOT NULL,"
    " used INTEGER NOT NULL DEFAULT 0, PRIMARY KEY (sha256, owner)) WITHOUT ROWID;"
    "CREATE INDEX blobs_by_use ON blobs(used);"
    "CREATE TRIGGER blobs_added AFTER INSERT ON blobs BEGIN"
    " INSERT INTO owners (owner, bytes) VALUES (new.owner, new.bytes)"
    " ON CONFLICT (owner) DO UPDATE SET bytes = bytes + excluded.bytes; END;"
    "CREATE TRIGGER blobs_removed AFTER DELETE ON blobs BEGIN"
    " UPDATE owners SET bytes = bytes - old.bytes WHERE owner = old.owner; END;"
    "ALTER TABLE outputs ADD COLUMN used INTEGER NOT NULL DEFAULT 0;"
    "ALTER TABLE outputs ADD COLUMN need INTEGER NOT NULL DEFAULT 0;"
    "UPDATE outputs SET used = created;"
    "CREATE INDEX outputs_by_use ON outputs(used);"
    "CREATE TABLE gone (id TEXT PRIMARY KEY, owner TEXT NOT NULL, at INTEGER NOT NULL) WITHOUT ROWID;"
    "CREATE INDEX gone_by_age ON gone(at);",
    "ALTER TABLE jobs ADD COLUMN limits TEXT;",

    /* 6: limits of owners of their own. -1: as configured; no limit is the largest number. */
    "CREATE TABLE quotas (owner TEXT PRIMARY KEY, queued INTEGER NOT NULL, running INTEGER NOT NULL, bytes INTEGER NOT NULL)"
    " WITHOUT ROWID;",

    /* 7: what may go. state_key is the output that the job's next stage reads; a job that was on its way begins again and takes
     * what is in the cache. totals: bytes of all outputs. */
    "ALTER TABLE jobs ADD COLUMN state_key TEXT NOT NULL DEFAULT '';"
    "UPDATE jobs SET stage = 0 WHERE state < 2 AND stage > 0;"
    "CREATE INDEX jobs_expiring ON jobs(state, finished) WHERE state > 1 AND pinned = 0;"
    "CREATE INDEX jobs_by_result ON jobs(result_key) WHERE result_key <> '';"
    "CREATE INDEX jobs_by_state_key ON jobs(state_key) WHERE state < 2 AND state_key <> '';"
    "CREATE INDEX jobs_by_input ON jobs(input, owner);"
    "CREATE INDEX jobs_by_parameters ON jobs(parameters, owner) WHERE parameters <> '';"
    "CREATE TABLE totals (name TEXT PRIMARY KEY, value INTEGER NOT NULL) WITHOUT ROWID;"
    "INSERT INTO totals SELECT 'cache', ifnull(sum(bytes), 0) FROM outputs;"
    "CREATE TRIGGER outputs_added AFTER INSERT ON outputs BEGIN"
    " UPDATE totals SET value = value + new.bytes WHERE name = 'cache'; END;"
    "CREATE TRIGGER outputs_changed AFTER UPDATE OF bytes ON outputs BEGIN"
    " UPDATE totals SET value = value + new.bytes - old.bytes WHERE name = 'cache'; END;"
    "CREATE TRIGGER outputs_removed AFTER DELETE ON outputs BEGIN"
    " UPDATE totals SET value = value - old.bytes WHERE name = 'cache'; END;",

    /* 8: what the workers of a job have taken. */
    "ALTER TABLE jobs ADD COLUMN spent_wall_ms INTEGER NOT NULL DEFAULT 0;"
    "ALTER TABLE jobs ADD COLUMN spent_cpu_ms INTEGER NOT NULL DEFAULT 0;",

    /* 9: what a job's input was found to be; a job that finds its stages in the cache has it from there. */
    "ALTER TABLE jobs ADD COLUMN kind TEXT NOT NULL DEFAULT '';"
    "ALTER TABLE outputs ADD COLUMN kind TEXT NOT NULL DEFAULT '';"};
enum { SCHEMA_VERSION = sizeof migrations / sizeof *migrations };
/* The numbers stored in jobs.state, which indexes and triggers above spell out, are the enumeration of the API. */
_Static_assert(BW_JOB_QUEUED == 0 && BW_JOB_RUNNING == 1 && BW_JOB_SUCCESSFUL == 2 && BW_JOB_FAILED == 3 &&
                   BW_JOB_DISMISSED == 4, "stored states changed: write a migration");

static bw_status migrate_one(bw_sql *sql, int64_t version) {
    char pragma[64];
    snprintf(pragma, sizeof pragma, "PRAGMA user_version = %" PRId64, version + 1);
    bw_status status = bw_sql_script(sql, "BEGIN IMMEDIATE");
    if (status == BW_OK) status = bw_sql_script(sql, migrations[version]);
    if (status == BW_OK) status = bw_sql_script(sql, pragma);
    if (status == BW_OK) status = bw_sql_script(sql, "COMMIT");
    if (!sqlite3_get_autocommit(sql->db)) bw_sql_script(sql, "ROLLBACK");
    return status;
}

/* A copy of the file as it is, for who wants to go back to an older program. */
static bw_status keep_old(bw_sql *sql, const char *path, int64_t version) {
    char name[PATH_MAX], fresh[PATH_MAX];
    if (snprintf(name, sizeof name, "%s.v%" PRId64 ".bak", path, version) >= (int)sizeof name - 4) return BW_E_IO;
    snprintf(fresh, sizeof fresh, "%.4000s.new", name);
    unlink(fresh);
    bw_status status = bw_sql_copy(sql, fresh, NULL);
    if (status == BW_OK) status = bw_rename(fresh, name); /* durable before the file is changed */
    bw_event(status == BW_OK ? BW_INFO : BW_ERROR, "queue.migrating", "version=%" PRId64 " to=%d copy=%s", version, SCHEMA_VERSION, name);
    return status;
}

int64_t bw_schema_version(void) { return SCHEMA_VERSION; }

bw_status bw_schema_migrate(bw_sql *sql, const char *path) {
    int64_t version;
    bw_status status = bw_sql_number(sql, &version, 0, "PRAGMA user_version", "");
    if (status == BW_OK && version > SCHEMA_VERSION) {
        bw_event(BW_ERROR, "queue.newer", "version=%" PRId64 " known=%d", version, SCHEMA_VERSION);
        return BW_E_VERSION;
    }
    if (status == BW_OK && version > 0 && version < SCHEMA_VERSION) status = keep_old(sql, path, version);
    for (; status == BW_OK && version < SCHEMA_VERSION; version++) status = migrate_one(sql, version);
    return status;
}
