/* Copies: what was accepted before one began is in it, whatever is written meanwhile; a folder made of one has everything, and what is
 * damaged, newer or something else is refused. Old files are copied before they are changed. */
#include "queue_kit.h"

#include <fcntl.h>
#include <pthread.h>
#include <sqlite3.h>
#include <stdatomic.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "server/backup.h"
#include "server/clock.h"
#include "server/store.h"

static bw_store *store;
static bw_config config;
static bw_retention *retention;
static char file[128], fresh[128];

static char synced[1 << 16]; /* the folders and files, a blank before and behind each */
static pthread_mutex_t synced_lock = PTHREAD_MUTEX_INITIALIZER;
static char migrated[200]; /* "", or a database: was its folder synced with the copy of it, and with nothing in its WAL? */
static bool kept_first;
static int stop_at;         /* the n-th sync from now on sets `stopped`; 0: none does */
static atomic_bool stopped; /* what is being made is to end */

static void look_at_migration(const char *synced_file) {
    char name[220];
    struct stat wal;
    size_t n = strlen(synced_file);
    if (strncmp(migrated, synced_file, n) != 0 || migrated[n] != '/') return;
    snprintf(name, sizeof name, "%s-wal", migrated);
    bool begun = stat(name, &wal) == 0 && wal.st_size > 0;
    snprintf(name, sizeof name, "%s.v1.bak", migrated);
    kept_first |= !begun && access(name, F_OK) == 0;
}

int fsync(int fd) {
    char link[32], name[400];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t n = readlink(link, name, sizeof name - 1);
    pthread_mutex_lock(&synced_lock);
    size_t at = strlen(synced);
    name[n > 0 ? n : 0] = '\0';
    if (n > 0 && at + (size_t)n + 3 < sizeof synced) snprintf(synced + at, sizeof synced - at, " %s ", name);
    if (n > 0 && *migrated) look_at_migration(name);
    if (stop_at && --stop_at == 0) stopped = true;
    pthread_mutex_unlock(&synced_lock);
    return (int)syscall(SYS_fsync, fd);
}

static void expect_synced(const char *root, const char *below) {
    char name[400];
    snprintf(name, sizeof name, " %s/%s ", root, below);
    if (!strstr(synced, name)) fail_msg("%s was not synced", name);
}

static int open_all(void **state) {
    if (open_queue(state) != 0 || bw_store_open(folder, &store) != BW_OK) return -1;
    snprintf(file, sizeof file, "%s.backup", folder);
    snprintf(fresh, sizeof fresh, "%s.restored", folder);
    return mkdir(fresh, 0700) == 0 ? bw_retention_open(&config, store, q, &retention) != BW_OK : -1;
}

static int close_all(void **state) {
    char name[160];
    bw_retention_close(retention);
    bw_store_close(store);
    unlink(file);
    snprintf(name, sizeof name, "%s.manifest", file);
    unlink(name);
    snprintf(name, sizeof name, "%s.files", file);
    bw_remove_tree(name);
    bw_remove_tree(fresh);
    return close_queue(state);
}

static void upload(const char *text, char sha256[BW_SHA256_TEXT]) {
    bw_upload *u;
    bool matches;
    char none[BW_SHA256_TEXT] = "";
    assert_int_equal(bw_upload_begin(store, &u), BW_OK);
    assert_int_equal(bw_upload_write(u, text, strlen(text)), BW_OK);
    assert_int_equal(bw_upload_finish(u, none, &matches, sha256), BW_OK);
    assert_int_equal(bw_upload_begin(store, &u), BW_OK);
    assert_int_equal(bw_upload_write(u, text, strlen(text)), BW_OK);
    assert_int_equal(bw_upload_finish(u, sha256, &matches, none), BW_OK);
    assert_true(matches);
}

static void put(bw_job *job, const char *input, int stages) {
    make_job(job, "a", stages, "{}", "[\"t\"]");
    snprintf(job->input, sizeof job->input, "%s", input);
    assert_int_equal(bw_queue_insert(q, job), BW_OK);
}

static bw_status make(bool files, bw_backup_report *report) {
    char error[BW_BACKUP_ERROR];
    return bw_backup_make(folder, q, retention, file, files, &stopped, report, error);
}

static bw_status restore(bw_backup_report *report) {
    char error[BW_BACKUP_ERROR];
    return bw_backup_restore(file, fresh, report, error);
}

/* A job that ended, with a folder of results, and one that waits. */
static void fill(bw_job *ended, bw_job *waits) {
    char sha256[BW_SHA256_TEXT], name[400];
    bool done;
    upload("one", sha256);
    put(ended, sha256, 1);
    upload("two", sha256);
    put(waits, sha256, 2);
    snprintf(name, sizeof name, "%s/cache/01", folder);
    mkdir(name, 0700);
    snprintf(name, sizeof name, "%s/cache/01/%s", folder, hash);
    mkdir(name, 0700);
    snprintf(name, sizeof name, "%s/cache/01/%s/report.json", folder, hash);
    assert_int_equal(bw_write_file(name, "{}", 2), BW_OK);
    assert_int_equal(bw_queue_claim(q, ended, 10, &done), BW_OK);
    assert_int_equal(bw_queue_advance(q, ended->id, 1, &(bw_made){hash, 2, 0, "[]", false, NULL}, 20, NULL, &done), BW_OK);
    int log = bw_store_append_log(store, ended->id);
    assert_int_equal(write(log, "said\n", 5), 5);
    close(log);
}

static void a_restored_folder_has_everything(void **state) {
    (void)state;
    bw_job ended, waits, job;
    bw_backup_report report;
    bw_store *other_store;
    bw_queue *other;
    char name[200];
    bool found;
    uint64_t bytes;
    fill(&ended, &waits);
    assert_int_equal(make(true, &report), BW_OK);
    assert_int_equal(report.jobs, 2);
    assert_int_equal(report.files, 3);
    assert_int_equal(report.missing, 0);
    assert_int_equal(restore(&report), BW_OK);
    assert_int_equal(report.missing + report.damaged, 0);
    snprintf(name, sizeof name, "%s/jobs.db", fresh);
    assert_int_equal(bw_store_open(fresh, &other_store), BW_OK);
    assert_int_equal(bw_queue_open(name, &other), BW_OK);
    assert_int_equal(bw_reconcile(other_store, other, 99), BW_OK);
    assert_int_equal(bw_queue_get(other, ended.id, &job, &found), BW_OK);
    assert_true(found && job.state == BW_JOB_SUCCESSFUL);
    bw_job_clear(&job);
    assert_int_equal(bw_queue_get(other, waits.id, &job, &found), BW_OK);
    assert_true(found && job.state == BW_JOB_QUEUED);
    bw_job_clear(&job);
    int fd = bw_store_open_cached(other_store, hash, "report.json", &bytes);
    assert_true(fd >= 0 && bytes == 2);
    close(fd);
    assert_true(close(bw_store_open_blob(other_store, waits.input, &bytes)) == 0);
    assert_true(close(bw_store_open_log(other_store, ended.id, &bytes)) == 0);
    assert_int_equal(bytes, 5);
    bw_queue_close(other);
    bw_store_close(other_store);
    bw_job_clear(&ended);
    bw_job_clear(&waits);
}

static void jobs_whose_files_were_not_kept_end_as_failed(void **state) {
    (void)state;
    bw_job ended, waits, job;
    bw_backup_report report;
    bw_store *other_store;
    bw_queue *other;
    char name[200];
    bool found;
    fill(&ended, &waits);
    assert_int_equal(make(false, &report), BW_OK);
    assert_int_equal(restore(&report), BW_OK);
    assert_int_equal(report.missing, 3);
    snprintf(name, sizeof name, "%s/jobs.db", fresh);
    assert_int_equal(bw_store_open(fresh, &other_store), BW_OK);
    assert_int_equal(bw_queue_open(name, &other), BW_OK);
    assert_int_equal(bw_reconcile(other_store, other, 99), BW_OK);
    for (int i = 0; i < 2; i++) {
        assert_int_equal(bw_queue_get(other, i ? waits.id : ended.id, &job, &found), BW_OK);
        assert_true(found && job.state == BW_JOB_FAILED);
        assert_non_null(strstr(job.failure, "/problems/files-lost"));
        bw_job_clear(&job);
    }
    bw_queue_close(other);
    bw_store_close(other_store);
    bw_job_clear(&ended);
    bw_job_clear(&waits);
}

static void damage(const char *name, off_t at) {
    int fd = open(name, O_WRONLY);
    if (fd < 0) chmod(name, 0600), fd = open(name, O_WRONLY);
    assert_true(fd >= 0 && pwrite(fd, "\xff\xff\xff\xff\xff\xff\xff\xff", 8, at) == 8);
    close(fd);
}

static void what_is_no_sound_copy_is_refused(void **state) {
    (void)state;
    bw_job ended, waits;
    bw_backup_report report;
    sqlite3 *db;
    char name[400];
    fill(&ended, &waits);
    assert_int_equal(make(false, &report), BW_OK);
    assert_int_equal(make(false, &report), BW_E_USAGE); /* it is there already */
    snprintf(name, sizeof name, "%s/something", fresh);
    assert_int_equal(bw_write_file(name, "x", 1), BW_OK);
    assert_int_equal(restore(&report), BW_E_USAGE); /* not empty */
    unlink(name);
    unlink(file);
    snprintf(name, sizeof name, "%s.manifest", file);
    unlink(name);
    assert_int_equal(mkdir(name, 0700), 0); /* in the manifest's place: the backup fails, and leaves nothing that looks like one */
    assert_int_equal(make(true, &report), BW_E_IO);
    assert_int_equal(access(file, F_OK), -1);
    rmdir(name);
    assert_int_equal(make(false, &report), BW_OK);
    assert_int_equal(sqlite3_open(file, &db), SQLITE_OK);
    assert_int_equal(sqlite3_exec(db, "PRAGMA user_version = 999", NULL, NULL, NULL), SQLITE_OK);
    sqlite3_close(db);
    assert_int_equal(restore(&report), BW_E_VERSION);
    assert_int_equal(sqlite3_open(file, &db), SQLITE_OK);
    assert_int_equal(sqlite3_exec(db, "PRAGMA user_version = 1", NULL, NULL, NULL), SQLITE_OK);
    sqlite3_close(db);
    damage(file, 4096);
    assert_int_equal(restore(&report), BW_E_CHECK);
    unlink(file);
    assert_int_equal(bw_write_file(file, "no database", 11), BW_OK);
    assert_int_equal(restore(&report), BW_E_CHECK);
    unlink(file);
    assert_int_equal(restore(&report), BW_E_IO);
    bw_job_clear(&ended);
    bw_job_clear(&waits);
}

static void a_damaged_input_is_left_out_and_told(void **state) {
    (void)state;
    bw_job ended, waits;
    bw_backup_report report;
    char name[400];
    fill(&ended, &waits);
    assert_int_equal(make(true, &report), BW_OK);
    snprintf(name, sizeof name, "%s.files/blobs/%.2s/%s", file, waits.input, waits.input);
    damage(name, 0);
    assert_int_equal(restore(&report), BW_OK);
    assert_int_equal(report.damaged, 1);
    snprintf(name, sizeof name, "%s/blobs/%.2s/%s", fresh, waits.input, waits.input);
    assert_int_equal(access(name, F_OK), -1);
    bw_job_clear(&ended);
    bw_job_clear(&waits);
}

/* A backup of somebody else's making: results that are not files, or lie elsewhere. */
static void what_is_no_file_is_left_out_and_told(void **state) {
    (void)state;
    static const char *const made[] = {"ln -s /etc/passwd %s.files/cache/01/%s/x", "mkdir %s.files/cache/01/%s/x",
                                       "cd %s.files/cache/01 && set -- %s && rm -r $1 && ln -s /etc $1"};
    bw_job ended, waits;
    bw_backup_report report;
    char command[1000];
    fill(&ended, &waits);
    for (size_t i = 0; i < sizeof made / sizeof *made; i++) {
        snprintf(command, sizeof command, "rm -rf %s %s.files %s.manifest %s/* ", file, file, file, fresh);
        assert_int_equal(system(command), 0);
        assert_int_equal(make(true, &report), BW_OK);
        snprintf(command, sizeof command, made[i], file, hash);
        assert_int_equal(system(command), 0);
        assert_int_equal(restore(&report), BW_OK);
        assert_int_equal(report.damaged, 1);
        snprintf(command, sizeof command, "%s/cache/01/%s", fresh, hash);
        assert_int_equal(access(command, F_OK), -1);
    }
    bw_job_clear(&ended);
    bw_job_clear(&waits);
}

static void what_is_copied_is_synced_by_name(void **state) {
    (void)state;
    bw_job ended, waits;
    bw_backup_report report;
    char files[160], below[20];
    fill(&ended, &waits);
    snprintf(files, sizeof files, "%s.files", file);
    snprintf(below, sizeof below, "blobs/%.2s", waits.input);
    *synced = '\0';
    assert_int_equal(make(true, &report), BW_OK);
    expect_synced(files, below);
    expect_synced(files, "cache/01");
    expect_synced(files, "logs");
    *synced = '\0';
    assert_int_equal(restore(&report), BW_OK);
    expect_synced(fresh, below);
    expect_synced(fresh, "cache/01");
    expect_synced(fresh, "logs");
    bw_job_clear(&ended);
    bw_job_clear(&waits);
}

static bool anything_is_left(void) {
    static const char *const ends[] = {"", "-journal", ".manifest", ".manifest.new", ".files"};
    char name[200];
    for (size_t i = 0; i < sizeof ends / sizeof *ends; i++) {
        snprintf(name, sizeof name, "%s%s", file, ends[i]);
        if (access(name, F_OK) == 0) return true;
    }
    return false;
}

static void a_backup_that_is_stopped_leaves_nothing(void **state) {
    (void)state;
    bw_job ended, waits;
    bw_backup_report report;
    bw_copy_facts facts;
    char command[500];
    int ends = 0;
    fill(&ended, &waits);
    stopped = true;
    assert_int_equal(bw_queue_copy(q, file, &stopped, &facts), BW_E_CANCELLED);
    assert_int_equal(make(true, &report), BW_E_CANCELLED);
    assert_false(anything_is_left());
    for (int n = 1; stopped; n++) { /* at the n-th sync, until it has no more of them */
        stopped = false;
        stop_at = n;
        bw_status status = make(true, &report);
        if (status == BW_OK) { /* behind the last question */
            snprintf(command, sizeof command, "rm -rf %s %s.manifest %s.files", file, file, file);
            assert_int_equal(system(command), 0);
        } else {
            assert_int_equal(status, BW_E_CANCELLED);
            ends++;
        }
        assert_false(anything_is_left());
    }
    stop_at = 0;
    print_message("stopped at %d places\n", ends);
    assert_true(ends > 3);
    bw_job_clear(&ended);
    bw_job_clear(&waits);
}

/* ---- under load ---- */

enum { MOST = 20000 };
static char (*acknowledged)[BW_JOB_ID_TEXT];
static atomic_int count, stop;

static void *submit_jobs(void *user) {
    (void)user;
    while (!stop && count < MOST) {
        bw_job job;
        put_job(&job, "a", 4);
        memcpy(acknowledged[count], job.id, sizeof *acknowledged);
        count++;
        bw_job_clear(&job);
    }
    return NULL;
}

static bool has(sqlite3 *db, const char *id) {
    sqlite3_stmt *stmt;
    assert_int_equal(sqlite3_prepare_v2(db, "SELECT (SELECT count(*) FROM events WHERE job = id) FROM jobs WHERE id = ?", -1, &stmt, NULL), SQLITE_OK);
    sqlite3_bind_text(stmt, 1, id, -1, SQLITE_STATIC);
    bool there = sqlite3_step(stmt) == SQLITE_ROW && sqlite3_column_int(stmt, 0) == 1;
    sqlite3_finalize(stmt);
    return there;
}

static void a_copy_under_load_has_all_that_was_accepted_before_it_began(void **state) {
    (void)state;
    pthread_t thread;
    bw_backup_report report;
    acknowledged = calloc(MOST, sizeof *acknowledged);
    count = stop = 0;
    assert_int_equal(pthread_create(&thread, NULL, submit_jobs, NULL), 0);
    for (int round = 0; round < 3; round++) {
        sqlite3 *db;
        int seen = count;
        while (count < seen + 50) usleep(1000);
        int before = count;
        assert_int_equal(make(false, &report), BW_OK);
        assert_int_equal(sqlite3_open_v2(file, &db, SQLITE_OPEN_READONLY, NULL), SQLITE_OK);
        for (int i = 0; i < before; i++) assert_true(has(db, acknowledged[i]));
        int all = count, in = before; /* and of the later ones the first so many: a prefix */
        while (in < all && has(db, acknowledged[in])) in++;
        for (int i = in; i < all; i++) assert_false(has(db, acknowledged[i]));
        print_message("%d before, %d in the copy, %d after it\n", before, (int)report.jobs, all);
        sqlite3_close(db);
        unlink(file);
    }
    stop = 1;
    pthread_join(thread, NULL);
    free(acknowledged);
}

/* ---- migrations ---- */

static void an_old_file_is_copied_before_it_is_changed(void **state) {
    (void)state;
    char old[200], kept[220];
    sqlite3 *db;
    sqlite3_stmt *stmt;
    bw_queue *other;
    bw_job job;
    bool found;
    snprintf(old, sizeof old, "%s/old.db", fresh);
    snprintf(kept, sizeof kept, "%s.v1.bak", old);
    assert_int_equal(sqlite3_open(old, &db), SQLITE_OK);
    assert_int_equal(sqlite3_exec(db,
        "CREATE TABLE jobs (seq INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE, name TEXT, input TEXT NOT NULL, options TEXT NOT NULL,"
        " state INTEGER NOT NULL, open INTEGER NOT NULL DEFAULT 0, cancel INTEGER NOT NULL DEFAULT 0, stage INTEGER NOT NULL DEFAULT 0,"
        " stage_count INTEGER NOT NULL, attempt INTEGER NOT NULL DEFAULT 0, tries INTEGER NOT NULL DEFAULT 0, interruptions INTEGER NOT NULL DEFAULT 0,"
        " due INTEGER NOT NULL DEFAULT 0, created INTEGER NOT NULL, started INTEGER NOT NULL DEFAULT 0, finished INTEGER NOT NULL DEFAULT 0,"
        " failure TEXT, result_key TEXT NOT NULL DEFAULT '');"
        "CREATE INDEX jobs_waiting ON jobs(seq) WHERE open = 0 AND state IN (0, 1); CREATE INDEX jobs_by_state ON jobs(state, seq);"
        "CREATE TABLE attempts (job TEXT NOT NULL REFERENCES jobs(id), attempt INTEGER NOT NULL, stage TEXT NOT NULL, reused INTEGER NOT NULL,"
        " started INTEGER NOT NULL, finished INTEGER NOT NULL DEFAULT 0, outcome TEXT NOT NULL DEFAULT '', PRIMARY KEY (job, attempt)) WITHOUT ROWID;"
        "CREATE INDEX attempts_open ON attempts(job) WHERE finished = 0;"
        "CREATE TABLE outputs (key TEXT PRIMARY KEY, bytes INTEGER NOT NULL, manifest TEXT, created INTEGER NOT NULL) WITHOUT ROWID;"
        "INSERT INTO outputs VALUES ('k', 70, NULL, 5), ('l', 7, NULL, 6);"
        "INSERT INTO jobs (id, input, options, state, stage, stage_count, created) VALUES ('old', 'x', '{}', 1, 2, 4, 7);"
        "PRAGMA user_version = 1", NULL, NULL, NULL), SQLITE_OK);
    sqlite3_close(db);
    memcpy(migrated, old, sizeof migrated);
    assert_int_equal(bw_queue_open(old, &other), BW_OK);
    *migrated = '\0';
    assert_true(kept_first);
    assert_int_equal(bw_queue_get(other, "old", &job, &found), BW_OK);
    assert_true(found);
    assert_int_equal(job.stage, 0); /* begins again: what it would read next was not written down then */
    bw_job_clear(&job);
    int64_t bytes;
    assert_int_equal(bw_queue_cache_bytes(other, &bytes), BW_OK);
    assert_int_equal(bytes, 77);
    bw_queue_close(other);
    assert_int_equal(sqlite3_open_v2(kept, &db, SQLITE_OPEN_READONLY, NULL), SQLITE_OK);
    assert_int_equal(sqlite3_prepare_v2(db, "SELECT stage, user_version FROM jobs, pragma_user_version", -1, &stmt, NULL), SQLITE_OK);
    assert_int_equal(sqlite3_step(stmt), SQLITE_ROW);
    assert_int_equal(sqlite3_column_int(stmt, 0), 2);
    assert_int_equal(sqlite3_column_int(stmt, 1), 1);
    sqlite3_finalize(stmt);
    sqlite3_close(db);
    unlink(kept);
    assert_int_equal(bw_queue_open(old, &other), BW_OK);
    bw_queue_close(other);
    assert_int_equal(access(kept, F_OK), -1); /* nothing to migrate: no copy */
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(a_restored_folder_has_everything, open_all, close_all),
        cmocka_unit_test_setup_teardown(jobs_whose_files_were_not_kept_end_as_failed, open_all, close_all),
        cmocka_unit_test_setup_teardown(what_is_no_sound_copy_is_refused, open_all, close_all),
        cmocka_unit_test_setup_teardown(a_damaged_input_is_left_out_and_told, open_all, close_all),
        cmocka_unit_test_setup_teardown(what_is_no_file_is_left_out_and_told, open_all, close_all),
        cmocka_unit_test_setup_teardown(what_is_copied_is_synced_by_name, open_all, close_all),
        cmocka_unit_test_setup_teardown(a_backup_that_is_stopped_leaves_nothing, open_all, close_all),
        cmocka_unit_test_setup_teardown(a_copy_under_load_has_all_that_was_accepted_before_it_began, open_all, close_all),
        cmocka_unit_test_setup_teardown(an_old_file_is_copied_before_it_is_changed, open_all, close_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
