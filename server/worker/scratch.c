#include "server/worker/scratch.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { DEPTH_MOST = 8, ENTRY_BYTES = 4096 };

static uint64_t below(int folder, uint64_t most, int depth);

static uint64_t entry_bytes(int folder, const char *name, uint64_t most, int depth) {
    struct stat st;
    if (fstatat(folder, name, &st, AT_SYMLINK_NOFOLLOW) != 0) return 0; /* gone meanwhile */
    if (!S_ISDIR(st.st_mode)) return ENTRY_BYTES + (uint64_t)st.st_size;
    if (depth == DEPTH_MOST) return UINT64_MAX / 2;
    int inner = openat(folder, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    if (inner < 0 && errno == EACCES) return UINT64_MAX / 2; /* one that hides what it holds */
    return ENTRY_BYTES + (inner < 0 ? 0 : below(inner, most, depth + 1));
}

/* Closes `folder`. */
static uint64_t below(int folder, uint64_t most, int depth) {
    uint64_t bytes = 0;
    DIR *entries = fdopendir(folder);
    if (!entries) {
        close(folder);
        return 0;
    }
    for (struct dirent *e; bytes <= most && (e = readdir(entries));)
        if (strcmp(e->d_name, ".") != 0 && strcmp(e->d_name, "..") != 0) bytes += entry_bytes(folder, e->d_name, most, depth);
    closedir(entries);
    return bytes;
}

uint64_t bw_scratch_bytes(int folder, uint64_t most) {
    int again = openat(folder, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    return again < 0 ? 0 : below(again, most, 0);
}
