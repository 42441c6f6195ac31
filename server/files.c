#include "server/files.h"

#include <errno.h>
#include <fcntl.h>
#include <ftw.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "server/clock.h"
#include "server/log.h"
#include "server/metrics.h"

static bw_status judge(int result, const char *what) {
    if (result == 0) return BW_OK;
    if (errno == ENOSPC || errno == EDQUOT) return BW_E_IO;
    char quoted[512];
    bw_event(BW_ERROR, "sync.failed", "file=%s errno=%d", bw_quoted(what, quoted, sizeof quoted), errno);
    abort();
}

static int timed(int (*sync)(int), int fd) {
    int64_t start = bw_mono_us();
    int result = sync(fd), error = errno;
    bw_observe(BW_METRIC_FSYNC_SECONDS, 0, bw_mono_us() - start);
    errno = error;
    return result;
}

bw_status bw_sync(int fd, const char *what) { return judge(timed(fdatasync, fd), what); }

void bw_write_behind(int fd, uint64_t *begun, uint64_t written) {
    enum { PIECE = 8 << 20 };
    if (written < *begun) *begun = written;
    if (written - *begun < PIECE) return;
    (void)sync_file_range(fd, (off_t)*begun, (off_t)(written - *begun), SYNC_FILE_RANGE_WRITE);
    *begun = written;
}

bw_status bw_sync_path(const char *path) {
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0) return BW_E_IO;
    bw_status status = judge(timed(fsync, fd), path);
    close(fd);
    return status;
}

static bw_status sync_parent(const char *path) {
    char parent[PATH_MAX];
    const char *slash = strrchr(path, '/');
    size_t n = slash ? (size_t)(slash - path) : 0;
    if (!n || n >= sizeof parent) return BW_E_IO;
    memcpy(parent, path, n);
    parent[n] = '\0';
    return bw_sync_path(parent);
}

bw_status bw_make_dir(const char *path) {
    if (mkdir(path, 0700) == 0) return sync_parent(path);
    return errno == EEXIST ? BW_OK : BW_E_IO;
}

static int remove_one(const char *path, const struct stat *st, int kind, struct FTW *ftw) {
    (void)st, (void)kind, (void)ftw;
    return remove(path) == 0 || errno == ENOENT ? 0 : -1;
}

bw_status bw_remove_tree(const char *path) {
    struct stat st;
    if (lstat(path, &st) != 0) return errno == ENOENT ? BW_OK : BW_E_IO;
    if (!S_ISDIR(st.st_mode)) return unlink(path) == 0 ? BW_OK : BW_E_IO;
    return nftw(path, remove_one, 16, FTW_DEPTH | FTW_PHYS) == 0 ? BW_OK : BW_E_IO;
}

bw_status bw_write_file(const char *path, const char *data, size_t size) {
    char temporary[PATH_MAX];
    if (snprintf(temporary, sizeof temporary, "%s.new", path) >= (int)sizeof temporary) return BW_E_IO;
    int fd = open(temporary, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
    if (fd < 0) return BW_E_IO;
    bw_status status = write(fd, data, size) == (ssize_t)size ? bw_sync(fd, temporary) : BW_E_IO;
    close(fd);
    if (status == BW_OK && rename(temporary, path) != 0) status = BW_E_IO;
    return status == BW_OK ? sync_parent(path) : status;
}

int bw_lock_file(const char *path) {
    int fd = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    if (fd < 0 || flock(fd, LOCK_EX | LOCK_NB) == 0) return fd;
    close(fd);
    return -1;
}

void bw_close_all(const int *fds, size_t count) {
    for (size_t i = 0; i < count; i++)
        if (fds[i] >= 0) close(fds[i]);
}
