#include "server/partial.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/queue.h>
#include <sys/stat.h>
#include <unistd.h>

#include "server/files.h"
#include "server/log.h"

enum { SIDECAR_MOST = 1 << 16 };

struct bw_partial {
    bw_partials *all;
    char id[BW_JOB_ID_TEXT], owner[BW_OWNER_TEXT], expected[BW_SHA256_TEXT], blob[BW_SHA256_TEXT];
    char *metadata;
    uint64_t length, written, durable, mark, behind; /* behind: see bw_write_behind */
    int64_t expires;
    bool taken, kept, complete;      /* under the lock; kept: there is a sidecar; complete: it has become a blob */
    int fd;                          /* while it is taken and incomplete; else -1 */
    bw_digest *digest, *mark_digest; /* of what is written; NULL: not known */
    TAILQ_ENTRY(bw_partial) link;
};

struct bw_partials {
    char folder[PATH_MAX - 200];
    bw_store *store;
    pthread_mutex_t lock;
    TAILQ_HEAD(, bw_partial) list;
};

static void part_path(const bw_partial *p, const char *ending, char path[PATH_MAX]) {
    snprintf(path, PATH_MAX, "%s/%s.%s", p->all->folder, p->id, ending);
}

static void free_partial(bw_partial *p) {
    if (p->fd >= 0) close(p->fd);
    bw_digest_free(p->digest);
    bw_digest_free(p->mark_digest);
    free(p->metadata);
    free(p);
}

static void list_partial(bw_partial *p) {
    pthread_mutex_lock(&p->all->lock);
    TAILQ_INSERT_TAIL(&p->all->list, p, link);
    pthread_mutex_unlock(&p->all->lock);
}

static void unlist_partial(bw_partial *p) {
    pthread_mutex_lock(&p->all->lock);
    TAILQ_REMOVE(&p->all->list, p, link);
    pthread_mutex_unlock(&p->all->lock);
}

/* ---- sidecars ---- */

static bw_status write_sidecar(const bw_partial *p) {
    char path[PATH_MAX];
    json_t *o = json_pack("{s:s, s:I, s:I, s:I, s:s, s:s, s:s*}", "owner", p->owner, "length", (json_int_t)p->length, "offset",
                          (json_int_t)p->durable, "expires", (json_int_t)p->expires, "expected", p->expected, "blob", p->blob,
                          "metadata", p->metadata);
    char *text = o ? json_dumps(o, JSON_INDENT(1)) : NULL;
    part_path(p, "json", path);
    bw_status status = text ? bw_write_file(path, text, strlen(text)) : BW_E_MEMORY;
    free(text);
    json_decref(o);
    return status;
}

static bool copy_text(const json_t *object, const char *name, char *to, size_t size) {
    const char *text = json_string_value(json_object_get(object, name));
    return text && snprintf(to, size, "%s", text) < (int)size;
}

static bool read_size(const json_t *object, const char *name, uint64_t *to) {
    const json_t *value = json_object_get(object, name);
    *to = (uint64_t)json_integer_value(value);
    return json_is_integer(value) && json_integer_value(value) >= 0;
}

static bool parse_sidecar(bw_partial *p, const json_t *o) {
    uint64_t expires;
    const char *metadata = json_string_value(json_object_get(o, "metadata"));
    if (!copy_text(o, "owner", p->owner, sizeof p->owner) || !copy_text(o, "expected", p->expected, sizeof p->expected) ||
        !copy_text(o, "blob", p->blob, sizeof p->blob) || !read_size(o, "length", &p->length) ||
        !read_size(o, "offset", &p->durable) || !read_size(o, "expires", &expires) || p->durable > p->length)
        return false;
    if ((*p->expected && !bw_is_sha256(p->expected)) || (*p->blob && !bw_is_sha256(p->blob))) return false;
    if (metadata && !(p->metadata = strdup(metadata))) return false;
    p->expires = (int64_t)expires;
    p->written = p->durable;
    p->complete = *p->blob;
    p->kept = true;
    return true;
}

static void delete_files(const bw_partial *p) {
    char path[PATH_MAX];
    part_path(p, "json", path);
    unlink(path);
    part_path(p, "part", path);
    unlink(path);
}

/* Does the file hold what the sidecar promises? Cuts off what is more; finishes what was complete. */
static bool put_right(bw_partial *p) {
    struct stat st;
    char path[PATH_MAX];
    part_path(p, "part", path);
    bool there = lstat(path, &st) == 0 && S_ISREG(st.st_mode);
    if (*p->blob) return (!there || ((uint64_t)st.st_size == p->length && chmod(path, 0400) == 0)) && bw_store_adopt(p->all->store, path, p->blob) == BW_OK;
    return there && (uint64_t)st.st_size >= p->durable && truncate(path, (off_t)p->durable) == 0;
}

static void load(bw_partials *all, const char *name) {
    char path[PATH_MAX];
    bw_partial *p = calloc(1, sizeof *p);
    if (!p) return;
    p->all = all;
    p->fd = -1;
    snprintf(p->id, sizeof p->id, "%.*s", (int)strcspn(name, "."), name);
    part_path(p, "json", path);
    json_t *o = json_load_file(path, JSON_REJECT_DUPLICATES, NULL);
    bool good = parse_sidecar(p, o) && put_right(p);
    json_decref(o);
    if (good) {
        list_partial(p);
    } else {
        bw_event(BW_WARN, "upload.forgotten", "upload=%s", p->id);
        delete_files(p);
        free_partial(p);
    }
}

static bool has_id(const char *name, const char *ending) {
    size_t n = strspn(name, "0123456789abcdef");
    return n == BW_JOB_ID_TEXT - 1 && strcmp(name + n, ending) == 0;
}

static bw_partial *find(bw_partials *all, const char *id) {
    bw_partial *p;
    TAILQ_FOREACH(p, &all->list, link)
        if (strcmp(p->id, id) == 0) return p;
    return NULL;
}

/* In two rounds: sidecars first, then files that belong to none. */
static bw_status load_all(bw_partials *all) {
    for (int round = 0; round < 2; round++) {
        DIR *folder = opendir(all->folder);
        if (!folder) return BW_E_IO;
        for (struct dirent *e; (e = readdir(folder));) {
            char id[BW_JOB_ID_TEXT], path[PATH_MAX];
            snprintf(id, sizeof id, "%.24s", e->d_name);
            if (round == 0 && has_id(e->d_name, ".json")) load(all, e->d_name);
            if (round == 0 || *e->d_name == '.' || find(all, id)) continue;
            snprintf(path, sizeof path, "%s/%.100s", all->folder, e->d_name);
            unlink(path);
        }
        closedir(folder);
    }
    return BW_OK;
}

bw_status bw_partials_open(const char *data, bw_store *store, bw_partials **out) {
    bw_partials *all = calloc(1, sizeof *all);
    if (!all) return BW_E_MEMORY;
    snprintf(all->folder, sizeof all->folder, "%s/uploads", data);
    all->store = store;
    TAILQ_INIT(&all->list);
    pthread_mutex_init(&all->lock, NULL);
    bw_status status = bw_make_dir(all->folder);
    if (status == BW_OK) status = load_all(all);
    if (status != BW_OK) {
        bw_partials_close(all);
        return status;
    }
    *out = all;
    return BW_OK;
}

void bw_partials_close(bw_partials *all) {
    if (!all) return;
    for (bw_partial *p; (p = TAILQ_FIRST(&all->list));) {
        TAILQ_REMOVE(&all->list, p, link);
        free_partial(p);
    }
    pthread_mutex_destroy(&all->lock);
    free(all);
}

/* ---- taking ---- */

void bw_partials_tally(bw_partials *all, const char *owner, bw_partial_tally *tally) {
    *tally = (bw_partial_tally){0};
    bw_partial *p;
    pthread_mutex_lock(&all->lock);
    TAILQ_FOREACH(p, &all->list, link) {
        if (p->complete) continue;
        tally->uploads++;
        if (strcmp(p->owner, owner) != 0) continue;
        tally->of_owner++;
        tally->bytes_of_owner += p->length;
    }
    pthread_mutex_unlock(&all->lock);
}

bw_status bw_partial_create(bw_partials *all, const bw_partial_new *wanted, bw_partial **out) {
    char path[PATH_MAX];
    bw_partial *p = calloc(1, sizeof *p);
    if (!p) return BW_E_MEMORY;
    p->all = all;
    p->taken = true;
    bw_job_id_make(p->id);
    snprintf(p->owner, sizeof p->owner, "%s", wanted->owner);
    snprintf(p->expected, sizeof p->expected, "%s", wanted->expected ? wanted->expected : "");
    p->length = wanted->length;
    p->expires = wanted->expires;
    p->metadata = wanted->metadata ? strdup(wanted->metadata) : NULL;
    p->digest = bw_digest_new();
    part_path(p, "part", path);
    p->fd = open(path, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    if (p->fd < 0 || !p->digest || (wanted->metadata && !p->metadata)) {
        bw_status status = p->fd < 0 ? BW_E_IO : BW_E_MEMORY;
        if (p->fd >= 0) unlink(path);
        free_partial(p);
        return status;
    }
    list_partial(p);
    *out = p;
    return BW_OK;
}

bw_partial_found bw_partial_take(bw_partials *all, const char *id, const char *owner, int64_t now, bw_partial **out) {
    char path[PATH_MAX];
    bw_partial_found found = BW_PARTIAL_UNKNOWN;
    pthread_mutex_lock(&all->lock);
    bw_partial *p = find(all, id);
    if (p && p->kept && strcmp(p->owner, owner) == 0) found = p->taken ? BW_PARTIAL_BUSY : p->expires > now ? BW_PARTIAL_TAKEN : BW_PARTIAL_UNKNOWN;
    if (found == BW_PARTIAL_TAKEN) p->taken = true;
    pthread_mutex_unlock(&all->lock);
    if (found != BW_PARTIAL_TAKEN) return found;
    if (!*p->blob) {
        part_path(p, "part", path);
        p->fd = open(path, O_RDWR | O_CLOEXEC | O_NOFOLLOW);
        if (p->fd < 0) {
            bw_partial_release(p);
            return BW_PARTIAL_FAILED;
        }
    }
    *out = p;
    return BW_PARTIAL_TAKEN;
}

void bw_partial_release(bw_partial *p) {
    if (!p->kept) {
        bw_partial_remove(p);
        return;
    }
    if (p->fd >= 0) close(p->fd);
    p->fd = -1;
    pthread_mutex_lock(&p->all->lock);
    p->taken = false;
    pthread_mutex_unlock(&p->all->lock);
}

void bw_partial_remove(bw_partial *p) {
    delete_files(p);
    unlist_partial(p);
    free_partial(p);
}

/* The next one to go, taken: what is due, or the oldest of too many that are complete. */
static bw_partial *take_old(bw_partials *all, int64_t now, int most) {
    bw_partial *p, *oldest = NULL, *due = NULL;
    int complete = 0;
    pthread_mutex_lock(&all->lock);
    TAILQ_FOREACH(p, &all->list, link) {
        complete += p->complete;
        if (p->taken) continue;
        if (p->complete && (!oldest || p->expires < oldest->expires)) oldest = p; /* a start lists them in any order */
        if (!due && p->expires <= now) due = p;
    }
    if (!due && complete > most) due = oldest;
    if (due) due->taken = true;
    pthread_mutex_unlock(&all->lock);
    return due;
}

int bw_partials_expire(bw_partials *all, int64_t now, int most) {
    int removed = 0;
    for (;;) {
        bw_partial *p = take_old(all, now, most);
        if (!p) return removed;
        bw_event(BW_INFO, "upload.expired", "upload=%s bytes=%llu", p->id, (unsigned long long)p->written);
        bw_partial_remove(p);
        removed++;
    }
}

/* ---- a taken one ---- */

const char *bw_partial_id(const bw_partial *p) { return p->id; }
uint64_t bw_partial_length(const bw_partial *p) { return p->length; }
uint64_t bw_partial_offset(const bw_partial *p) { return p->written; }
bool bw_partial_durable(const bw_partial *p) { return p->kept && p->durable == p->written && (p->written < p->length || *p->blob); }
int64_t bw_partial_expires(const bw_partial *p) { return p->expires; }
const char *bw_partial_metadata(const bw_partial *p) { return p->metadata; }
const char *bw_partial_blob(const bw_partial *p) { return p->blob; }

bw_status bw_partial_write(bw_partial *p, const void *data, size_t size) {
    if (size > p->length - p->written) return BW_E_LIMIT;
    if (p->digest && !bw_digest_add(p->digest, data, size)) return BW_E_INTERNAL;
    for (const char *at = data; size;) {
        ssize_t n = pwrite(p->fd, at, size, (off_t)p->written);
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) { /* the hash is ahead of the file now */
            bw_digest_free(p->digest);
            p->digest = NULL;
            return BW_E_IO;
        }
        at += n;
        size -= (size_t)n;
        p->written += (uint64_t)n;
    }
    bw_write_behind(p->fd, &p->behind, p->written);
    return BW_OK;
}

bw_status bw_partial_mark(bw_partial *p) {
    bw_digest_free(p->mark_digest);
    p->mark_digest = p->digest ? bw_digest_copy(p->digest) : NULL;
    p->mark = p->written;
    return p->digest && !p->mark_digest ? BW_E_MEMORY : BW_OK;
}

bw_status bw_partial_undo(bw_partial *p) {
    bw_digest_free(p->digest);
    p->digest = p->mark_digest;
    p->mark_digest = NULL;
    p->written = p->mark;
    return ftruncate(p->fd, (off_t)p->mark) == 0 ? BW_OK : BW_E_IO;
}

/* All bytes are there and synced. */
static bw_status complete(bw_partial *p, char actual[BW_SHA256_TEXT]) {
    char path[PATH_MAX];
    bw_status status = BW_OK;
    if (!p->digest) status = bw_digest_file(p->fd, actual, NULL);
    else if (!bw_digest_end(p->digest, actual)) status = BW_E_INTERNAL;
    bw_digest_free(p->digest);
    p->digest = NULL;
    if (status != BW_OK) return status;
    if (*p->expected && strcmp(p->expected, actual) != 0) return BW_E_CHECK;
    snprintf(p->blob, sizeof p->blob, "%s", actual);
    part_path(p, "part", path);
    status = write_sidecar(p);
    if (status == BW_OK && fchmod(p->fd, 0400) != 0) status = BW_E_IO;
    if (status == BW_OK) status = bw_store_adopt(p->all->store, path, actual);
    if (status != BW_OK && access(path, F_OK) == 0 && fchmod(p->fd, 0600) == 0) *p->blob = '\0'; /* it is no blob yet; another commit tries again */
    return status;
}

/* After a sync that failed nobody knows what is on the disk of the bytes since the last one, nor would another sync tell. */
static bw_status back_to_durable(bw_partial *p) {
    bw_digest_free(p->digest);
    p->digest = NULL;
    p->written = p->durable;
    return ftruncate(p->fd, (off_t)p->durable) == 0 ? BW_OK : BW_E_IO;
}

bw_status bw_partial_commit(bw_partial *p, int64_t expires, char actual[BW_SHA256_TEXT]) {
    char path[PATH_MAX];
    *actual = '\0';
    if (*p->blob && p->durable == p->written) return BW_OK;
    bw_status status = *p->blob ? BW_OK : bw_sync(p->fd, p->id);
    if (status != BW_OK) {
        if (back_to_durable(p) != BW_OK) bw_event(BW_WARN, "upload.undo", "upload=%s", p->id);
        return status;
    }
    uint64_t before = p->durable;
    p->durable = p->written;
    p->expires = expires;
    part_path(p, "part", path);
    if (*p->blob) status = bw_store_adopt(p->all->store, path, p->blob); /* renamed, but the folder could not be synced */
    else status = p->written == p->length ? complete(p, actual) : write_sidecar(p);
    if (status != BW_OK) {
        p->durable = before;
        return status;
    }
    pthread_mutex_lock(&p->all->lock);
    p->kept = true;
    p->complete = *p->blob;
    pthread_mutex_unlock(&p->all->lock);
    return BW_OK;
}
