#include "server/files.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
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

/* Moves the folder `name` up into `root`, under a name that is free there. */
static bw_status move_up(int root, int folder, const char *name, unsigned *number) {
    char to[32];
    if (fchmodat(folder, name, 0700, 0) != 0) return BW_E_IO; /* its ".." changes */
    for (;;) {
        snprintf(to, sizeof to, "up.%u", (*number)++);
        if (renameat(folder, name, root, to) == 0) return BW_OK;
        if (errno != EEXIST && errno != ENOTEMPTY && errno != ENOTDIR) return BW_E_IO;
    }
}

/* Empties `folder`, which it closes: `root`, or one directly in it. What a folder in root holds of folders is moved up into root, to be met there
 * again, so that no path and no recursion grows with the tree. */
static bw_status empty_folder(int root, int folder, unsigned *number);

static bw_status remove_entry(int root, int folder, const char *name, unsigned *number) {
    if (unlinkat(folder, name, 0) == 0 || errno == ENOENT) return BW_OK;
    if (errno != EISDIR) return BW_E_IO;
    if (unlinkat(folder, name, AT_REMOVEDIR) == 0) return BW_OK;
    if (folder != root) return move_up(root, folder, name, number);
    if (fchmodat(root, name, 0700, 0) != 0) return BW_E_IO;
    int inner = openat(root, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    bw_status status = inner < 0 ? BW_E_IO : empty_folder(root, inner, number);
    return status == BW_OK && unlinkat(root, name, AT_REMOVEDIR) != 0 ? BW_E_IO : status;
}

static bw_status empty_folder(int root, int folder, unsigned *number) {
    bw_status status = BW_OK;
    DIR *entries = fdopendir(folder);
    if (!entries) {
        close(folder);
        return BW_E_IO;
    }
    for (size_t met = 1; status == BW_OK && met; rewinddir(entries)) {
        met = 0;
        for (struct dirent *e; status == BW_OK && (e = readdir(entries));) {
            if (strcmp(e->d_name, ".") == 0 || strcmp(e->d_name, "..") == 0) continue;
            status = remove_entry(root, folder, e->d_name, number);
            met++;
        }
    }
    closedir(entries);
    return status;
}

bw_status bw_remove_tree(const char *path) {
    struct stat st;
    unsigned number = 0;
    if (lstat(path, &st) != 0) return errno == ENOENT ? BW_OK : BW_E_IO;
    if (!S_ISDIR(st.st_mode)) return unlink(path) == 0 ? BW_OK : BW_E_IO;
    if (rmdir(path) == 0) return BW_OK;
    if (chmod(path, 0700) != 0) return BW_E_IO;
    int root = open(path, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    bw_status status = root < 0 ? BW_E_IO : empty_folder(root, root, &number);
    return status == BW_OK && rmdir(path) != 0 ? BW_E_IO : status;
}

bw_status bw_rename(const char *from, const char *to) { return rename(from, to) == 0 ? sync_parent(to) : BW_E_IO; }

bw_status bw_write_file(const char *path, const char *data, size_t size) {
    char temporary[PATH_MAX];
    if (snprintf(temporary, sizeof temporary, "%s.new", path) >= (int)sizeof temporary) return BW_E_IO;
    int fd = open(temporary, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
    if (fd < 0) return BW_E_IO;
    bw_status status = write(fd, data, size) == (ssize_t)size ? bw_sync(fd, temporary) : BW_E_IO;
    close(fd);
    return status == BW_OK ? bw_rename(temporary, path) : status;
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
