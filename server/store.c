#include "server/store.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "server/files.h"
#include "server/log.h"
#include "server/metrics.h"

enum { RESULTS_MOST = 1000, NAME_MOST = 100 };

struct bw_store {
    char root[PATH_MAX - 256];
    atomic_uint uploads;   /* numbers the temporaries */
    atomic_uint discarded; /* numbers what was taken out of its place */
    unsigned emptied;      /* as many of these are deleted */
};

struct bw_upload {
    bw_store *store;
    bw_digest *digest;
    int fd;
    uint64_t bytes, behind; /* of these the writing has begun */
    char path[PATH_MAX];
};

static void blob_path(const bw_store *store, const char *sha256, char path[PATH_MAX]) {
    snprintf(path, PATH_MAX, "%s/blobs/%.2s/%.64s", store->root, sha256, sha256);
}

static void cache_path(const bw_store *store, const char *key, char path[PATH_MAX]) {
    snprintf(path, PATH_MAX, "%s/cache/%.2s/%.64s", store->root, key, key);
}

static void attempt_path(const bw_store *store, const char *job, int attempt, const char *name, char path[PATH_MAX]) {
    snprintf(path, PATH_MAX, "%s/work/%s.%d%s", store->root, job, attempt, name);
}

/* Which of DATA/<kind>/00 to ff are there. */
static void look_at_fan(const char *path, bool there[256]) {
    DIR *folder = opendir(path);
    for (struct dirent *entry; folder && (entry = readdir(folder));) {
        const char *name = entry->d_name;
        if (entry->d_type == DT_DIR && strspn(name, "0123456789abcdef") == 2 && !name[2]) there[strtoul(name, NULL, 16)] = true;
    }
    if (folder) closedir(folder);
}

/* DATA/<kind>/00 to ff, synced, though a daemon that was killed may have made them and not got so far. */
static bw_status make_fan(const char *data, const char *kind) {
    bool there[256] = {false};
    char path[PATH_MAX];
    snprintf(path, sizeof path, "%.3800s/%s", data, kind);
    look_at_fan(path, there);
    for (unsigned i = 0; i < 256; i++) {
        snprintf(path, sizeof path, "%.3800s/%s/%02x", data, kind, i);
        if (!there[i] && mkdir(path, 0700) != 0 && errno != EEXIST) return BW_E_IO;
    }
    snprintf(path, sizeof path, "%.3800s/%s", data, kind);
    return bw_sync_path(path);
}

bw_status bw_store_open(const char *data, bw_store **out) {
    static const char *const kept[] = {"blobs", "cache", "logs"}, *const emptied[] = {"tmp", "work"}, *const fans[] = {"blobs", "cache"};
    bw_status status = BW_OK;
    char path[PATH_MAX];
    bw_store *store = calloc(1, sizeof *store);
    if (!store) return BW_E_MEMORY;
    snprintf(store->root, sizeof store->root, "%s", data);
    for (size_t i = 0; status == BW_OK && i < sizeof emptied / sizeof *emptied; i++) {
        snprintf(path, sizeof path, "%s/%s", data, emptied[i]);
        status = bw_remove_tree(path);
        if (status == BW_OK) status = bw_make_dir(path);
    }
    for (size_t i = 0; status == BW_OK && i < sizeof kept / sizeof *kept; i++) {
        snprintf(path, sizeof path, "%s/%s", data, kept[i]);
        status = bw_make_dir(path);
    }
    if (status == BW_OK) status = bw_sync_path(data); /* as for the fans */
    for (size_t i = 0; status == BW_OK && i < sizeof fans / sizeof *fans; i++) status = make_fan(data, fans[i]);
    if (status != BW_OK) {
        free(store);
        return status;
    }
    *out = store;
    return BW_OK;
}

void bw_store_close(bw_store *store) { free(store); }

uint64_t bw_store_room(const bw_store *store) {
    struct statvfs fs;
    if (statvfs(store->root, &fs) != 0) return 0;
    return (uint64_t)fs.f_bavail * fs.f_frsize;
}

bw_status bw_upload_begin(bw_store *store, bw_upload **out) {
    bw_upload *u = calloc(1, sizeof *u);
    if (!u || !(u->digest = bw_digest_new())) {
        free(u);
        return BW_E_MEMORY;
    }
    u->store = store;
    snprintf(u->path, sizeof u->path, "%s/tmp/upload.%u", store->root, atomic_fetch_add(&store->uploads, 1));
    u->fd = open(u->path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0400);
    if (u->fd < 0) {
        bw_digest_free(u->digest);
        free(u);
        return BW_E_IO;
    }
    *out = u;
    return BW_OK;
}

bw_status bw_upload_write(bw_upload *u, const void *data, size_t size) {
    if (!bw_digest_add(u->digest, data, size)) return BW_E_INTERNAL;
    bw_count(BW_METRIC_UPLOAD_BYTES, 0, 0, size);
    for (const char *at = data; size;) {
        ssize_t n = write(u->fd, at, size);
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) return BW_E_IO;
        at += n;
        size -= (size_t)n;
        u->bytes += (uint64_t)n;
    }
    bw_write_behind(u->fd, &u->behind, u->bytes);
    return BW_OK;
}

uint64_t bw_upload_bytes(const bw_upload *u) { return u->bytes; }

/* Renames `from` to DIR/ab/<name>, syncs the folder; after a failure of the last step it may be called again. */
static bw_status file_away(const char *from, const char *to) {
    char folder[PATH_MAX];
    if (rename(from, to) != 0 && !(errno == ENOENT && access(to, F_OK) == 0)) return BW_E_IO;
    snprintf(folder, sizeof folder, "%s", to);
    *strrchr(folder, '/') = '\0';
    return bw_sync_path(folder);
}

bw_status bw_upload_finish(bw_upload *u, const char *sha256, bool *matches, char actual[BW_SHA256_TEXT]) {
    bw_status status = BW_OK;
    *matches = false;
    if (!bw_digest_end(u->digest, actual)) status = BW_E_INTERNAL;
    if (status == BW_OK && (!sha256 || strcmp(actual, sha256) == 0)) {
        char path[PATH_MAX];
        blob_path(u->store, actual, path);
        status = bw_sync(u->fd, u->path);
        if (status == BW_OK) status = file_away(u->path, path);
        *matches = status == BW_OK;
    }
    int saved = errno;
    bw_upload_abort(u);
    errno = saved;
    return status;
}

void bw_upload_abort(bw_upload *u) {
    if (!u) return;
    close(u->fd);
    unlink(u->path); /* gone already if it was filed away */
    bw_digest_free(u->digest);
    free(u);
}

bw_status bw_store_adopt(bw_store *store, const char *path, const char *sha256) {
    char to[PATH_MAX];
    blob_path(store, sha256, to);
    return file_away(path, to);
}

static int open_regular(const char *path, uint64_t *bytes) {
    struct stat st;
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    if (fd < 0) return -1;
    if (fstat(fd, &st) != 0 || !S_ISREG(st.st_mode)) {
        close(fd);
        errno = EIO;
        return -1;
    }
    *bytes = (uint64_t)st.st_size;
    return fd;
}

int bw_store_open_blob(const bw_store *store, const char *sha256, uint64_t *bytes) {
    char path[PATH_MAX];
    errno = ENOENT;
    if (!bw_is_sha256(sha256)) return -1;
    blob_path(store, sha256, path);
    return open_regular(path, bytes);
}

static bool plain_name(const char *name) {
    static const char good[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-";
    size_t n = strspn(name, good);
    return n > 0 && n <= NAME_MOST && name[n] == '\0' && name[0] != '.';
}

int bw_store_open_cached(const bw_store *store, const char *key, const char *name, uint64_t *bytes) {
    char path[PATH_MAX];
    if (!bw_is_sha256(key) || (name && !plain_name(name))) return -1;
    cache_path(store, key, path);
    if (name) {
        size_t n = strlen(path);
        snprintf(path + n, sizeof path - n, "/%s", name);
    }
    return open_regular(path, bytes);
}

bool bw_store_has_cached(const bw_store *store, const char *key) {
    char path[PATH_MAX];
    cache_path(store, key, path);
    return access(path, F_OK) == 0;
}

bw_status bw_store_drop_cached(bw_store *store, const char *key) {
    char path[PATH_MAX];
    cache_path(store, key, path);
    return bw_remove_tree(path);
}

bool bw_store_has_blob(const bw_store *store, const char *sha256) {
    char path[PATH_MAX];
    blob_path(store, sha256, path);
    return access(path, F_OK) == 0;
}

/* ---- what goes ---- */

static void discarded_path(const bw_store *store, unsigned number, char path[PATH_MAX]) {
    snprintf(path, PATH_MAX, "%s/tmp/gone.%u", store->root, number);
}

static void discard(bw_store *store, const char *path) {
    char to[PATH_MAX];
    discarded_path(store, atomic_fetch_add(&store->discarded, 1), to);
    if (rename(path, to) != 0 && errno != ENOENT) bw_event(BW_WARN, "store.discard", "errno=%d", errno); /* without its row: swept at the next start */
}

void bw_store_discard_cached(bw_store *store, const char *key) {
    char path[PATH_MAX];
    cache_path(store, key, path);
    discard(store, path);
}

void bw_store_discard_blob(bw_store *store, const char *sha256) {
    char path[PATH_MAX];
    blob_path(store, sha256, path);
    discard(store, path);
}

void bw_store_empty_discarded(bw_store *store) {
    char path[PATH_MAX];
    for (unsigned end = atomic_load(&store->discarded); store->emptied != end; store->emptied++) {
        discarded_path(store, store->emptied, path);
        bw_remove_tree(path);
    }
}

/* ---- all entries ---- */

typedef struct {
    bw_store *store;
    bw_status (*visit)(void *user, const char *name, const char *path);
    void *user;
} walk;

static bw_status walk_folder(const walk *w, const char *path) {
    bw_status status = BW_OK;
    DIR *folder = opendir(path);
    if (!folder) return BW_E_IO;
    for (struct dirent *e; status == BW_OK && (e = readdir(folder));) {
        char entry[PATH_MAX];
        if (!bw_is_sha256(e->d_name)) continue;
        if (snprintf(entry, sizeof entry, "%.3800s/%.64s", path, e->d_name) > 0) status = w->visit(w->user, e->d_name, entry);
    }
    closedir(folder);
    return status;
}

/* Visits all entries of DATA/<kind>/xx/. */
static bw_status walk_entries(const walk *w, const char *kind) {
    bw_status status = BW_OK;
    char path[PATH_MAX];
    snprintf(path, sizeof path, "%s/%s", w->store->root, kind);
    DIR *folder = opendir(path);
    if (!folder) return BW_E_IO;
    for (struct dirent *e; status == BW_OK && (e = readdir(folder));) {
        if (strspn(e->d_name, "0123456789abcdef") != 2 || e->d_name[2]) continue;
        snprintf(path, sizeof path, "%s/%s/%.2s", w->store->root, kind, e->d_name);
        status = walk_folder(w, path);
    }
    closedir(folder);
    return status;
}

typedef struct {
    bool (*known)(void *user, const char *name);
    void *user;
    int dropped;
} sweep;

static bw_status sweep_entry(void *user, const char *name, const char *path) {
    sweep *s = user;
    if (s->known(s->user, name)) return BW_OK;
    s->dropped++;
    return bw_remove_tree(path);
}

bw_status bw_store_sweep_cache(bw_store *store, bool (*known)(void *, const char *), void *user, int *dropped) {
    sweep s = {known, user, 0};
    bw_status status = walk_entries(&(walk){store, sweep_entry, &s}, "cache");
    *dropped = s.dropped;
    return status;
}

typedef struct {
    void (*visit)(void *user, const char *sha256, uint64_t bytes);
    void *user;
} listing;

static bw_status list_entry(void *user, const char *name, const char *path) {
    const listing *l = user;
    struct stat st;
    if (lstat(path, &st) == 0 && S_ISREG(st.st_mode)) l->visit(l->user, name, (uint64_t)st.st_size);
    return BW_OK;
}

bw_status bw_store_each_blob(bw_store *store, void (*visit)(void *, const char *, uint64_t), void *user) {
    listing l = {visit, user};
    return walk_entries(&(walk){store, list_entry, &l}, "blobs");
}

static void log_path(const bw_store *store, const char *job, char path[PATH_MAX]) {
    snprintf(path, PATH_MAX, "%s/logs/%s.log", store->root, job);
}

int bw_store_append_log(const bw_store *store, const char *job) {
    char path[PATH_MAX];
    log_path(store, job, path);
    return open(path, O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC, 0600);
}

void bw_store_drop_log(const bw_store *store, const char *job) {
    char path[PATH_MAX];
    log_path(store, job, path);
    unlink(path);
}

int bw_store_unlink_blob(bw_store *store, const char *sha256) {
    char path[PATH_MAX];
    blob_path(store, sha256, path);
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    if (unlink(path) != 0 && errno != ENOENT) bw_event(BW_WARN, "store.unlink", "errno=%d", errno);
    return fd;
}

void bw_store_discard_log(bw_store *store, const char *job) {
    char path[PATH_MAX];
    log_path(store, job, path);
    discard(store, path);
}

bw_status bw_store_sweep_logs(bw_store *store, bool (*known)(void *, const char *), void *user, int *dropped) {
    char path[PATH_MAX];
    *dropped = 0;
    snprintf(path, sizeof path, "%s/logs", store->root);
    DIR *folder = opendir(path);
    if (!folder) return BW_E_IO;
    for (struct dirent *e; (e = readdir(folder));) {
        char job[64];
        size_t n = strlen(e->d_name);
        if (n < 5 || n - 4 >= sizeof job || strcmp(e->d_name + n - 4, ".log") != 0) continue;
        snprintf(job, sizeof job, "%.*s", (int)(n - 4), e->d_name);
        if (known(user, job)) continue;
        bw_store_drop_log(store, job);
        ++*dropped;
    }
    closedir(folder);
    return BW_OK;
}

int bw_store_open_log(const bw_store *store, const char *job, uint64_t *bytes) {
    char path[PATH_MAX];
    log_path(store, job, path);
    return open_regular(path, bytes);
}

bw_status bw_attempt_begin(bw_store *store, const char *job, int attempt, int *folder) {
    char path[PATH_MAX];
    attempt_path(store, job, attempt, "", path);
    bw_status status = bw_remove_tree(path);
    if (status != BW_OK || mkdir(path, 0700) != 0) return BW_E_IO;
    *folder = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    return *folder < 0 ? BW_E_IO : BW_OK;
}

static const char *media_type(const char *name) {
    static const char *const types[][2] = {{".json", "application/json"}, {".txt", "text/plain; charset=utf-8"}, {".drc", "application/octet-stream"},
                                           {".mesh", "text/plain; charset=utf-8"},
                                           {".vtk", "text/plain; charset=utf-8"}, {".msh", "text/plain; charset=utf-8"},
                                           {".ovm", "text/plain; charset=utf-8"}, {".inp", "text/plain; charset=utf-8"},
                                           {".hexex", "text/plain; charset=utf-8"}}; /* .vtu, .cgns, .bwh are binary */
    const char *dot = strrchr(name, '.');
    for (size_t i = 0; dot && i < sizeof types / sizeof *types; i++)
        if (strcmp(dot, types[i][0]) == 0) return types[i][1];
    return "application/octet-stream";
}

/* Checks, syncs and freezes one file a worker wrote; appends its manifest row when there is a manifest. */
static bw_status take_file(const char *path, const char *name, json_t *manifest, uint64_t *total) {
    char hash[BW_SHA256_TEXT];
    uint64_t bytes;
    bw_status status = BW_OK;
    int fd = open_regular(path, &bytes);
    if (fd < 0) return BW_E_CHECK;
    if (manifest) {
        status = bw_digest_file(fd, hash, &bytes);
        if (status == BW_OK && json_array_append_new(manifest, json_pack("{s:s, s:I, s:s, s:s}", "name", name, "bytes",
                                                         (json_int_t)bytes, "sha256", hash, "media_type",
                                                         media_type(name))) != 0)
            status = BW_E_MEMORY;
    }
    if (status == BW_OK && fchmod(fd, 0400) != 0) status = BW_E_IO;
    if (status == BW_OK) status = bw_sync(fd, path);
    close(fd);
    *total += bytes;
    return status;
}

typedef char result_name[NAME_MOST + 1];

static int by_name(const void *a, const void *b) { return strcmp(a, b); }

/* The names of what is in the folder; stops at the first that is none, and when there are too many, for a worker may have made millions. */
static bw_status list_results(const char *path, result_name names[RESULTS_MOST], size_t *count) {
    bw_status status = BW_OK;
    DIR *folder = opendir(path);
    if (!folder) return errno == EACCES ? BW_E_CHECK : BW_E_IO;
    errno = 0;
    for (struct dirent *e; status == BW_OK && (e = readdir(folder));) {
        if (strcmp(e->d_name, ".") == 0 || strcmp(e->d_name, "..") == 0) continue;
        if (*count == RESULTS_MOST || !plain_name(e->d_name)) status = BW_E_CHECK;
        else snprintf(names[(*count)++], sizeof *names, "%.*s", NAME_MOST, e->d_name);
    }
    if (status == BW_OK && errno) status = BW_E_IO;
    closedir(folder);
    return status;
}

static bw_status take_folder(const char *path, json_t *manifest, uint64_t *total) {
    char file[PATH_MAX + NAME_MOST + 2];
    size_t count = 0;
    result_name *names = calloc(RESULTS_MOST, sizeof *names);
    bw_status status = names ? list_results(path, names, &count) : BW_E_MEMORY;
    if (status == BW_OK) qsort(names, count, sizeof *names, by_name);
    for (size_t i = 0; status == BW_OK && i < count; i++) {
        snprintf(file, sizeof file, "%s/%s", path, names[i]);
        status = take_file(file, names[i], manifest, total);
    }
    free(names);
    return status == BW_OK ? bw_sync_path(path) : status;
}

bw_status bw_attempt_publish(bw_store *store, const char *job, int attempt, const char *key, uint64_t *bytes,
                             json_t **manifest) {
    char from[PATH_MAX], to[PATH_MAX];
    struct stat st;
    json_t *list = NULL;
    bw_status status;
    *bytes = 0;
    attempt_path(store, job, attempt, "/out", from);
    cache_path(store, key, to);
    if (lstat(from, &st) != 0) return BW_E_CHECK;
    if (S_ISDIR(st.st_mode)) {
        if (!(list = json_array())) return BW_E_MEMORY;
        status = take_folder(from, list, bytes);
    } else {
        status = take_file(from, "out", NULL, bytes);
    }
    if (status == BW_OK) status = bw_remove_tree(to); /* left by a daemon that died between rename and row */
    if (status == BW_OK) status = file_away(from, to);
    if (status == BW_OK) {
        *manifest = list;
        bw_count(BW_METRIC_CACHE_BYTES, 0, 0, *bytes);
        return BW_OK;
    }
    json_decref(list);
    return status;
}

void bw_attempt_end(bw_store *store, const char *job, int attempt) {
    char path[PATH_MAX];
    attempt_path(store, job, attempt, "", path);
    bw_remove_tree(path); /* what stays is deleted at the next start */
}
