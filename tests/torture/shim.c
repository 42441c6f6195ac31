/* An LD_PRELOAD library that lets system calls of one daemon go wrong by plan, and moves its clock.
 *
 * BW_SHIM holds rules, separated by `;`, each a list of KEY=VALUE, separated by `,`:
 *
 *     call=A|B    write read open fsync fdatasync ftruncate rename mkdir unlink; write is write, pwrite, pwritev and writev, read is
 *                 read, pread and sendfile, open is also openat, each with its 64-bit form. `*` for all of these
 *     path=GLOB   only files whose path matches (fnmatch over the whole path); else regular files and folders below /
 *     nth=N       the N-th call that matches, from 1 (default 1), counted from the moment the shim was armed
 *     times=N     so many calls from there on (default 1; 0: all)
 *     do=WHAT     EIO ENOSPC EDQUOT EINTR EMFILE: fails with this error and does nothing
 *                 short: writes or reads at most half (of one byte: all)
 *                 kill: SIGKILL instead of the call; torn: SIGKILL after half of a write
 *                 skip: claims success and does nothing (of fsync and fdatasync only)
 *                 delay:MS: waits first
 *                 count: nothing but counting
 *
 * BW_SHIM_CONTROL names a file that the harness maps as well:
 *     int32 armed          0: no rule is looked at
 *     int32 pid            only this process, 0: whoever has the library loaded
 *     int64 realtime_ms    added to CLOCK_REALTIME, gettimeofday and time
 *     int64 matched[16]    calls that matched, by rule
 *     int64 fired[16]      calls that were changed, by rule
 * Without that file the rules are in force from the start. */
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <fnmatch.h>
#include <limits.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/sendfile.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

enum { RULES_MOST = 16 };
enum { WRITE = 1, READ = 2, OPEN = 4, FSYNC = 8, FDATASYNC = 16, FTRUNCATE = 32, RENAME = 64, MKDIR = 128, UNLINK = 256, ALL = 511 };
typedef enum { PASS, FAIL, SHORT, KILL, TORN, SKIP, DELAY } act;

typedef struct {
    int calls;
    char path[200];
    long nth, times;
    act what;
    int argument; /* errno or ms */
} rule;

typedef struct {
    _Atomic int32_t armed, pid;
    _Atomic int64_t realtime_ms, matched[RULES_MOST], fired[RULES_MOST];
} control;

static rule rules[RULES_MOST];
static int rule_count, calls_of_any;
static control own, *shared = &own;

static void mistake(const char *text) {
    fprintf(stderr, "shim: cannot understand '%s'\n", text);
    abort();
}

static int calls_of(char *list) {
    static const char *const names[] = {"write", "read", "open", "fsync", "fdatasync", "ftruncate", "rename", "mkdir", "unlink"};
    int calls = 0;
    for (char *name; (name = strsep(&list, "|"));) {
        int before = calls;
        if (strcmp(name, "*") == 0) calls = ALL;
        for (int i = 0; i < 9; i++)
            if (strcmp(name, names[i]) == 0) calls |= 1 << i;
        if (calls == before && calls != ALL) mistake(name);
    }
    return calls;
}

static void set_action(rule *r, const char *text) {
    static const struct {
        const char *name;
        act what;
        int argument;
    } known[] = {{"EIO", FAIL, EIO}, {"ENOSPC", FAIL, ENOSPC}, {"EDQUOT", FAIL, EDQUOT}, {"EINTR", FAIL, EINTR}, {"EMFILE", FAIL, EMFILE},
                 {"short", SHORT, 0}, {"kill", KILL, 0}, {"torn", TORN, 0}, {"skip", SKIP, 0}, {"count", PASS, 0}};
    for (size_t i = 0; i < sizeof known / sizeof *known; i++) {
        if (strcmp(text, known[i].name) != 0) continue;
        r->what = known[i].what;
        r->argument = known[i].argument;
        return;
    }
    if (strncmp(text, "delay:", 6) != 0) mistake(text);
    r->what = DELAY;
    r->argument = atoi(text + 6);
}

static void read_rule(char *text) {
    rule *r = &rules[rule_count];
    if (rule_count == RULES_MOST) mistake("more than 16 rules");
    *r = (rule){.calls = ALL, .nth = 1, .times = 1};
    for (char *pair; (pair = strsep(&text, ","));) {
        char *value = strchr(pair, '=');
        if (!value) mistake(pair);
        *value++ = '\0';
        if (strcmp(pair, "call") == 0) r->calls = calls_of(value);
        else if (strcmp(pair, "path") == 0) snprintf(r->path, sizeof r->path, "%s", value);
        else if (strcmp(pair, "nth") == 0) r->nth = atol(value);
        else if (strcmp(pair, "times") == 0) r->times = atol(value);
        else if (strcmp(pair, "do") == 0) set_action(r, value);
        else mistake(pair);
    }
    rule_count++;
    calls_of_any |= r->calls;
}

__attribute__((constructor)) static void set_up(void) {
    const char *text = getenv("BW_SHIM"), *file = getenv("BW_SHIM_CONTROL");
    char *copy = strdup(text ? text : ""), *rest = copy;
    for (char *one; (one = strsep(&rest, ";"));)
        if (*one) read_rule(one);
    free(copy);
    own.armed = 1;
    int fd = file ? (int)syscall(SYS_openat, AT_FDCWD, file, O_RDWR | O_CLOEXEC) : -1;
    if (file && fd < 0) mistake(file);
    if (fd < 0) return;
    void *map = mmap(NULL, sizeof *shared, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    syscall(SYS_close, fd);
    if (map == MAP_FAILED) mistake(file);
    shared = map;
}

/* ---- what happens to a call ---- */

typedef struct {
    act what;
    int argument;
} fate;

/* The path that a descriptor was opened with; false if it is no file. */
static bool path_of(int fd, char path[PATH_MAX]) {
    char link[40];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t n = readlink(link, path, PATH_MAX - 1);
    if (n <= 0 || path[0] != '/') return false;
    path[n] = '\0';
    return strncmp(path, "/dev/", 5) != 0 && strncmp(path, "/proc/", 6) != 0;
}

static fate consult(int call, const char *path) {
    fate f = {PASS, 0};
    for (int i = 0; i < rule_count; i++) {
        const rule *r = &rules[i];
        if (!(r->calls & call) || (*r->path && fnmatch(r->path, path, 0) != 0)) continue;
        int64_t n = ++shared->matched[i];
        if (f.what != PASS || r->what == PASS || n < r->nth || (r->times && n >= r->nth + r->times)) continue;
        shared->fired[i]++;
        f = (fate){r->what, r->argument};
    }
    if (f.what == DELAY) syscall(SYS_nanosleep, &(struct timespec){f.argument / 1000, f.argument % 1000 * 1000000L}, NULL);
    if (f.what == KILL) syscall(SYS_kill, (int)syscall(SYS_getpid), SIGKILL);
    return f;
}

static bool is_armed(void) { return shared->armed && (!shared->pid || shared->pid == (int)syscall(SYS_getpid)); }

static fate of_path(int call, const char *path) {
    char absolute[PATH_MAX];
    if (!(calls_of_any & call) || !is_armed()) return (fate){PASS, 0};
    int saved = errno;
    if (path[0] != '/' && syscall(SYS_getcwd, absolute, sizeof absolute / 2) > 0) {
        size_t n = strlen(absolute);
        snprintf(absolute + n, sizeof absolute - n, "/%s", path);
        path = absolute;
    }
    fate f = strncmp(path, "/dev/", 5) == 0 || strncmp(path, "/proc/", 6) == 0 ? (fate){PASS, 0} : consult(call, path);
    errno = saved;
    return f;
}

static fate of_fd(int call, int fd) {
    char path[PATH_MAX];
    if (!(calls_of_any & call) || !is_armed()) return (fate){PASS, 0};
    int saved = errno;
    fate f = path_of(fd, path) ? consult(call, path) : (fate){PASS, 0};
    errno = saved;
    return f;
}

static int failed(fate f) {
    errno = f.argument;
    return -1;
}

/* How much of `size` bytes is moved. */
static size_t part(fate f, size_t size) { return (f.what == SHORT || f.what == TORN) && size > 1 ? size / 2 : size; }

static ssize_t ended(fate f, ssize_t result) {
    if (f.what == TORN) syscall(SYS_kill, (int)syscall(SYS_getpid), SIGKILL);
    return result;
}

#define NEXT(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

/* ---- the calls ---- */

ssize_t write(int fd, const void *data, size_t size) {
    fate f = of_fd(WRITE, fd);
    return f.what == FAIL ? failed(f) : ended(f, syscall(SYS_write, fd, data, part(f, size)));
}

ssize_t pwrite(int fd, const void *data, size_t size, off_t at) {
    fate f = of_fd(WRITE, fd);
    return f.what == FAIL ? failed(f) : ended(f, syscall(SYS_pwrite64, fd, data, part(f, size), at));
}

ssize_t pwrite64(int fd, const void *data, size_t size, off64_t at) { return pwrite(fd, data, size, at); }

/* Of several pieces a short call moves the first only. */
ssize_t writev(int fd, const struct iovec *pieces, int count) {
    fate f = of_fd(WRITE, fd);
    return f.what == FAIL ? failed(f) : ended(f, syscall(SYS_writev, fd, pieces, part(f, (size_t)count)));
}

ssize_t pwritev(int fd, const struct iovec *pieces, int count, off_t at) {
    fate f = of_fd(WRITE, fd);
    return f.what == FAIL ? failed(f) : ended(f, syscall(SYS_pwritev, fd, pieces, part(f, (size_t)count), at, at >> 32));
}

ssize_t pwritev64(int fd, const struct iovec *pieces, int count, off64_t at) { return pwritev(fd, pieces, count, at); }

ssize_t read(int fd, void *data, size_t size) {
    fate f = of_fd(READ, fd);
    return f.what == FAIL ? failed(f) : syscall(SYS_read, fd, data, part(f, size));
}

ssize_t pread(int fd, void *data, size_t size, off_t at) {
    fate f = of_fd(READ, fd);
    return f.what == FAIL ? failed(f) : syscall(SYS_pread64, fd, data, part(f, size), at);
}

ssize_t pread64(int fd, void *data, size_t size, off64_t at) { return pread(fd, data, size, at); }

ssize_t sendfile(int to, int from, off_t *at, size_t size) {
    fate f = of_fd(READ, from);
    return f.what == FAIL ? failed(f) : syscall(SYS_sendfile, to, from, at, part(f, size));
}

ssize_t sendfile64(int to, int from, off64_t *at, size_t size) { return sendfile(to, from, at, size); }

static int open_mode(int folder, const char *path, int flags, mode_t mode) {
    fate f = folder == AT_FDCWD || path[0] == '/' ? of_path(OPEN, path) : (fate){PASS, 0};
    return f.what == FAIL ? failed(f) : (int)syscall(SYS_openat, folder, path, flags, mode);
}

#define MODE_ARGUMENT(flags)                                                                                           \
    mode_t mode = 0;                                                                                                   \
    if (flags & (O_CREAT | (O_TMPFILE & ~O_DIRECTORY))) {                                                              \
        va_list list;                                                                                                  \
        va_start(list, flags);                                                                                         \
        mode = va_arg(list, mode_t);                                                                                   \
        va_end(list);                                                                                                  \
    }

int open(const char *path, int flags, ...) {
    MODE_ARGUMENT(flags)
    return open_mode(AT_FDCWD, path, flags, mode);
}

int open64(const char *path, int flags, ...) {
    MODE_ARGUMENT(flags)
    return open_mode(AT_FDCWD, path, flags, mode);
}

int openat(int folder, const char *path, int flags, ...) {
    MODE_ARGUMENT(flags)
    return open_mode(folder, path, flags, mode);
}

int openat64(int folder, const char *path, int flags, ...) {
    MODE_ARGUMENT(flags)
    return open_mode(folder, path, flags, mode);
}

int fsync(int fd) {
    fate f = of_fd(FSYNC, fd);
    return f.what == FAIL ? failed(f) : f.what == SKIP ? 0 : (int)syscall(SYS_fsync, fd);
}

int fdatasync(int fd) {
    fate f = of_fd(FDATASYNC, fd);
    return f.what == FAIL ? failed(f) : f.what == SKIP ? 0 : (int)syscall(SYS_fdatasync, fd);
}

int ftruncate(int fd, off_t size) {
    fate f = of_fd(FTRUNCATE, fd);
    return f.what == FAIL ? failed(f) : (int)syscall(SYS_ftruncate, fd, size);
}

int ftruncate64(int fd, off64_t size) { return ftruncate(fd, size); }

/* A rename counts under the path it goes to. */
int rename(const char *from, const char *to) {
    fate f = of_path(RENAME, to);
    return f.what == FAIL ? failed(f) : (int)syscall(SYS_rename, from, to);
}

int renameat(int of, const char *from, int folder, const char *to) {
    fate f = of_path(RENAME, to);
    return f.what == FAIL ? failed(f) : (int)syscall(SYS_renameat, of, from, folder, to);
}

int mkdir(const char *path, mode_t mode) {
    fate f = of_path(MKDIR, path);
    return f.what == FAIL ? failed(f) : (int)syscall(SYS_mkdir, path, mode);
}

int unlink(const char *path) {
    fate f = of_path(UNLINK, path);
    return f.what == FAIL ? failed(f) : (int)syscall(SYS_unlink, path);
}

/* ---- the clock ---- */

static void shift(struct timespec *t, int64_t ms) {
    int64_t ns = t->tv_nsec + ms % 1000 * 1000000;
    t->tv_sec += ms / 1000 + (ns < 0 ? -1 : ns >= 1000000000 ? 1 : 0);
    t->tv_nsec = (long)(ns < 0 ? ns + 1000000000 : ns >= 1000000000 ? ns - 1000000000 : ns);
}

int clock_gettime(clockid_t clock, struct timespec *t) {
    static __typeof__(&clock_gettime) next; /* through the vDSO, for it is called often */
    if (!next) next = NEXT(clock_gettime);
    int result = next ? next(clock, t) : (int)syscall(SYS_clock_gettime, clock, t);
    if (result != 0) return result;
    if (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE) shift(t, shared->realtime_ms);
    return 0;
}

int gettimeofday(struct timeval *restrict tv, void *restrict zone) {
    struct timespec t;
    (void)zone;
    if (clock_gettime(CLOCK_REALTIME, &t) != 0) return -1;
    *tv = (struct timeval){t.tv_sec, t.tv_nsec / 1000};
    return 0;
}

time_t time(time_t *out) {
    struct timespec t;
    if (clock_gettime(CLOCK_REALTIME, &t) != 0) return -1;
    if (out) *out = t.tv_sec;
    return t.tv_sec;
}
