#include "server/backup.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "server/digest.h"
#include "server/files.h"

static bw_status refuse(char error[BW_BACKUP_ERROR], bw_status status, const char *what, const char *why) {
    snprintf(error, BW_BACKUP_ERROR, "%.150s: %.140s", what, why);
    return status;
}

/* ---- files ---- */

static bw_status copy_bytes(int from, int to, const atomic_bool *stop) {
    char buffer[65536];
    ssize_t n;
    while ((n = read(from, buffer, sizeof buffer)) > 0) {
        if (bw_stopped(stop)) return BW_E_CANCELLED;
        if (write(to, buffer, (size_t)n) != n) return BW_E_IO;
    }
    return n == 0 ? BW_OK : BW_E_IO;
}

static bw_status copy_file(const char *from, const char *to, mode_t mode, const atomic_bool *stop) {
    int in = open(from, O_RDONLY | O_CLOEXEC | O_NOFOLLOW), out = in < 0 ? -1 : open(to, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, mode);
    bw_status status = in >= 0 && out >= 0 ? copy_bytes(in, out, stop) : BW_E_IO;
    if (status == BW_OK) status = bw_sync(out, to);
    if (in >= 0) close(in);
    if (out >= 0) close(out);
    return status;
}

/* A file that nobody changes: linked, or on another file system copied. BW_E_CHECK: it is no file, so nothing of ours. */
static bw_status copy_plain(const char *from, const char *to, const atomic_bool *stop) {
    struct stat st;
    if (lstat(from, &st) != 0) return BW_E_IO;
    if (!S_ISREG(st.st_mode)) return BW_E_CHECK;
    return link(from, to) == 0 ? BW_OK : copy_file(from, to, 0400, stop);
}

static bw_status copy_folder(const char *from, const char *to, const atomic_bool *stop) {
    DIR *folder = opendir(from);
    bw_status status = folder ? bw_make_dir(to) : BW_E_IO;
    for (struct dirent *e; status == BW_OK && (e = readdir(folder));) {
        char a[PATH_MAX], b[PATH_MAX];
        if (*e->d_name == '.') continue;
        bool fits = snprintf(a, sizeof a, "%s/%s", from, e->d_name) < (int)sizeof a && snprintf(b, sizeof b, "%s/%s", to, e->d_name) < (int)sizeof b;
        status = fits ? copy_plain(a, b, stop) : BW_E_IO;
    }
    if (folder) closedir(folder);
    return status == BW_OK ? bw_sync_path(to) : status;
}

/* A blob or a state, or a folder of results. */
static bw_status copy_entry(const char *from, const char *to, const atomic_bool *stop) {
    struct stat st;
    if (lstat(from, &st) != 0) return BW_E_IO;
    return S_ISDIR(st.st_mode) ? copy_folder(from, to, stop) : copy_plain(from, to, stop);
}

/* ROOT/<kind>/<two letters>/<name>; makes the folders if asked. False: the path is too long. */
static bool entry_path(char path[PATH_MAX], const char *root, const char *kind, const char *name, bool make) {
    if (snprintf(path, PATH_MAX, "%s/%s", root, kind) >= PATH_MAX - 70) return false;
    size_t n = strlen(path);
    if (make && bw_make_dir(path) != BW_OK) return false;
    snprintf(path + n, PATH_MAX - n, "/%.2s", name);
    if (make && bw_make_dir(path) != BW_OK) return false;
    snprintf(path + n, PATH_MAX - n, "/%.2s/%.64s", name, name);
    return true;
}

/* Logs grow: they are copied as far as they are. */
static bw_status copy_logs(const char *from_root, const char *to_root, const atomic_bool *stop) {
    char from[PATH_MAX], to[PATH_MAX], to_logs[PATH_MAX];
    bw_status status = BW_OK;
    snprintf(to_logs, sizeof to_logs, "%.3800s/logs", to_root);
    snprintf(from, sizeof from, "%.3800s/logs", from_root);
    DIR *folder = opendir(from);
    if (!folder) return BW_OK;
    status = bw_make_dir(to_logs);
    for (struct dirent *e; status == BW_OK && (e = readdir(folder));) {
        size_t n = strlen(e->d_name);
        if (n < 5 || n > 100 || strcmp(e->d_name + n - 4, ".log") != 0) continue;
        snprintf(from, sizeof from, "%.3800s/logs/%.100s", from_root, e->d_name);
        snprintf(to, sizeof to, "%.3800s/logs/%.100s", to_root, e->d_name);
        if (access(from, F_OK) == 0) status = copy_file(from, to, 0600, stop); /* else its job was deleted just now */
    }
    closedir(folder);
    return status == BW_OK ? bw_sync_path(to_logs) : status;
}

/* Makes the names durable that copy_entry has put into ROOT/<kind>/<two letters>; the folders' own names are. */
static bw_status sync_kind(const char *root, const char *kind, const atomic_bool *stop) {
    char path[PATH_MAX];
    bw_status status = BW_OK;
    snprintf(path, sizeof path, "%.3800s/%s", root, kind);
    DIR *folder = opendir(path);
    if (!folder) return errno == ENOENT ? BW_OK : BW_E_IO;
    for (struct dirent *e; status == BW_OK && (e = readdir(folder));) {
        if (*e->d_name == '.') continue;
        snprintf(path, sizeof path, "%.3800s/%s/%.200s", root, kind, e->d_name);
        status = bw_stopped(stop) ? BW_E_CANCELLED : bw_sync_path(path);
    }
    closedir(folder);
    return status;
}

static bw_status sync_entries(const char *root, const atomic_bool *stop) {
    bw_status status = sync_kind(root, "blobs", stop);
    return status == BW_OK ? sync_kind(root, "cache", stop) : status;
}

/* ---- backup ---- */

typedef struct {
    const char *from, *to; /* data folders; to: NULL, only listed */
    FILE *manifest;        /* NULL: none is written */
    const atomic_bool *stop;
    bool check;            /* blobs are to have the hash that their name says */
    bw_backup_report *report;
} copying;

static bool has_right_hash(const char *path, const char *name) {
    char hash[BW_SHA256_TEXT] = "";
    uint64_t bytes;
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    bool right = fd >= 0 && bw_digest_file(fd, hash, &bytes) == BW_OK && strcmp(hash, name) == 0;
    if (fd >= 0) close(fd);
    return right;
}

static bw_status copy_one(void *user, const char *kind, const char *name, int64_t bytes) {
    copying *c = user;
    char from[PATH_MAX], to[PATH_MAX];
    if (bw_stopped(c->stop)) return BW_E_CANCELLED;
    c->report->files++;
    c->report->bytes += bytes;
    if (!bw_is_sha256(name)) return BW_E_CHECK;
    if (c->manifest) fprintf(c->manifest, "%s %s %" PRId64 "\n", kind, name, bytes);
    if (!entry_path(from, c->from, kind, name, false)) return BW_E_IO;
    if (access(from, F_OK) != 0) {
        c->report->missing++;
        return BW_OK;
    }
    if (c->check && strcmp(kind, "blobs") == 0 && !has_right_hash(from, name)) {
        c->report->damaged++;
        return BW_OK;
    }
    if (!c->to) return BW_OK;
    if (!entry_path(to, c->to, kind, name, true)) return BW_E_IO;
    bw_status status = copy_entry(from, to, c->stop);
    if (status != BW_E_CHECK) return status;
    c->report->damaged++;
    return bw_remove_tree(to);
}

static bw_status write_manifest(const char *file, copying *c) {
    char path[PATH_MAX], *text = NULL;
    size_t size = 0;
    snprintf(path, sizeof path, "%.4000s.manifest", file);
    if (!(c->manifest = open_memstream(&text, &size))) return BW_E_MEMORY;
    bw_status status = bw_copy_files(file, copy_one, c);
    if (fclose(c->manifest) != 0) status = BW_E_MEMORY;
    if (status == BW_OK) status = bw_write_file(path, text, size);
    free(text);
    return status;
}

bw_status bw_backup_make(const char *data, bw_queue *queue, bw_retention *retention, const char *file, bool with_files, const atomic_bool *stop,
                         bw_backup_report *report, char error[BW_BACKUP_ERROR]) {
    char files[PATH_MAX], manifest[PATH_MAX];
    bw_copy_facts facts;
    copying c = {.from = data, .to = with_files ? files : NULL, .stop = stop, .report = report};
    *report = (bw_backup_report){0};
    snprintf(files, sizeof files, "%.4000s.files", file);
    if (*file != '/') return refuse(error, BW_E_USAGE, file, "the name must be absolute");
    if (access(file, F_OK) == 0) return refuse(error, BW_E_USAGE, file, "it is there already");
    if (with_files && mkdir(files, 0700) != 0) return refuse(error, BW_E_IO, files, strerror(errno));
    bw_retention_hold(retention); /* what the copy names stays until it is copied */
    bw_status status = bw_queue_copy(queue, file, stop, &facts);
    if (status == BW_OK) report->jobs = facts.jobs;
    if (status == BW_OK) status = write_manifest(file, &c);
    if (status == BW_OK && with_files) status = copy_logs(data, files, stop);
    if (status == BW_OK && with_files) status = sync_entries(files, stop);
    bw_retention_release(retention);
    if (status == BW_OK) return BW_OK;
    unlink(file); /* half a backup is none */
    snprintf(manifest, sizeof manifest, "%.4000s.manifest", file);
    unlink(manifest);
    if (with_files) bw_remove_tree(files);
    return refuse(error, status, file, status == BW_E_CANCELLED ? "the daemon is stopping" : "cannot be written, or not whole");
}

/* ---- restore ---- */

static bool is_empty(const char *path) {
    DIR *folder = opendir(path);
    bool empty = folder != NULL;
    for (struct dirent *e; empty && (e = readdir(folder));) empty = strcmp(e->d_name, ".") == 0 || strcmp(e->d_name, "..") == 0;
    if (folder) closedir(folder);
    return empty;
}

bw_status bw_backup_restore(const char *file, const char *data, bw_backup_report *report, char error[BW_BACKUP_ERROR]) {
    char files[PATH_MAX], fresh[PATH_MAX], database[PATH_MAX], why[BW_COPY_ERROR];
    bw_copy_facts facts;
    copying c = {.from = files, .to = data, .check = true, .report = report};
    *report = (bw_backup_report){0};
    snprintf(files, sizeof files, "%.4000s.files", file);
    snprintf(fresh, sizeof fresh, "%.4000s/jobs.db.new", data);
    snprintf(database, sizeof database, "%.4000s/jobs.db", data);
    if (!is_empty(data)) return refuse(error, BW_E_USAGE, data, "the folder is not empty");
    bw_status status = bw_copy_check(file, NULL, &facts, why);
    if (status != BW_OK) return refuse(error, status, file, why);
    report->jobs = facts.jobs;
    status = copy_file(file, fresh, 0600, NULL);
    if (status == BW_OK) status = bw_copy_files(fresh, copy_one, &c);
    if (status == BW_OK) status = copy_logs(files, data, NULL);
    if (status == BW_OK) status = sync_entries(data, NULL);
    if (status == BW_OK) status = bw_rename(fresh, database); /* last: a folder without it is no whole one */
    return status == BW_OK ? BW_OK : refuse(error, status, data, "cannot be filled");
}
