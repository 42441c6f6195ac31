#include "server/worker/scratch.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { DEPTH_MOST = 8, ENTRY_BYTES = 4096, ENTRIES_MOST = 20000 };

typedef struct {
    uint64_t bytes, most;
    int entries;
} count;

static void add_folder(count *c, int folder, int depth);

/* What cannot be looked at may hold anything, unless it has gone meanwhile. */
static void add_unknown(count *c) {
    if (errno != ENOENT) c->bytes = UINT64_MAX;
}

static void add_entry(count *c, int folder, const char *name, int depth) {
    struct stat st;
    c->bytes += ENTRY_BYTES;
    if (++c->entries > ENTRIES_MOST) {
        c->bytes = UINT64_MAX;
    } else if (fstatat(folder, name, &st, AT_SYMLINK_NOFOLLOW) != 0) {
        add_unknown(c);
    } else if (!S_ISDIR(st.st_mode)) {
        c->bytes += (uint64_t)st.st_size;
    } else if (depth == DEPTH_MOST) {
        c->bytes = UINT64_MAX;
    } else {
        add_folder(c, openat(folder, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC), depth + 1);
    }
}

/* Closes `folder`; negative: it could not be opened. */
static void add_folder(count *c, int folder, int depth) {
    DIR *entries = folder < 0 ? NULL : fdopendir(folder);
    if (!entries) {
        add_unknown(c);
        if (folder >= 0) close(folder);
        return;
    }
    while (c->bytes <= c->most) {
        errno = ENOENT; /* the end of a folder is no error */
        struct dirent *e = readdir(entries);
        if (!e) {
            add_unknown(c);
            break;
        }
        if (strcmp(e->d_name, ".") != 0 && strcmp(e->d_name, "..") != 0) add_entry(c, folder, e->d_name, depth);
    }
    closedir(entries);
}

uint64_t bw_scratch_bytes(int folder, uint64_t most) {
    count c = {.most = most};
    add_folder(&c, openat(folder, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC), 0);
    return c.bytes;
}
