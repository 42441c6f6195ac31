#include "kit/kit.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <ftw.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

enum { PATHS_KEPT = 4096 };

static char temp_dir[256];
static pid_t temp_owner;
static char *kept_path[PATHS_KEPT]; /* a ring: a path outlives the next 4095 */
static size_t kept_count;

static const char *keep(char *path) {
    if (!path) fail_msg("out of memory");
    char **place = &kept_path[kept_count++ % PATHS_KEPT];
    free(*place);
    return *place = path;
}

static int remove_entry(const char *path, const struct stat *info, int type, struct FTW *where) {
    (void)info, (void)type, (void)where;
    return remove(path);
}

static void clean_up(void) {
    if (getpid() != temp_owner) return; /* a forked child leaves its parent's files alone */
    if (*temp_dir && !getenv("BW_KEEP")) nftw(temp_dir, remove_entry, 16, FTW_DEPTH | FTW_PHYS);
    for (size_t i = 0; i < PATHS_KEPT; i++) free(kept_path[i]);
}

const char *kit_temp_dir(void) {
    if (*temp_dir) return temp_dir;
    const char *base = getenv("TMPDIR");
    snprintf(temp_dir, sizeof temp_dir, "%s/bw-test-XXXXXX", base && *base ? base : "/tmp");
    if (!mkdtemp(temp_dir)) fail_msg("cannot make %s: %s", temp_dir, strerror(errno));
    temp_owner = getpid();
    atexit(clean_up);
    return temp_dir;
}

const char *kit_temp_path(const char *format, ...) {
    char name[512];
    va_list args;
    va_start(args, format);
    vsnprintf(name, sizeof name, format, args);
    va_end(args);
    char *path;
    return keep(asprintf(&path, "%s/%s", kit_temp_dir(), name) < 0 ? NULL : path);
}

void kit_write_file(const char *path, const void *data, size_t size) {
    FILE *file = fopen(path, "wb");
    if (!file) fail_msg("cannot write %s: %s", path, strerror(errno));
    bool whole = fwrite(data, 1, size, file) == size;
    if (fclose(file) || !whole) fail_msg("cannot write %s: %s", path, strerror(errno));
}

void kit_write_text(const char *path, const char *text) { kit_write_file(path, text, strlen(text)); }

static char *read_all(int fd, size_t *size) {
    size_t used = 0, room = 1 << 16;
    char *data = malloc(room + 1);
    for (;;) {
        if (!data) fail_msg("out of memory");
        ssize_t got = read(fd, data + used, room - used);
        if (got < 0 && errno == EINTR) continue;
        if (got < 0) fail_msg("read failed: %s", strerror(errno));
        if (got == 0) break;
        used += (size_t)got;
        if (used == room) data = realloc(data, (room *= 2) + 1);
    }
    data[used] = 0;
    if (size) *size = used;
    return data;
}

char *kit_read_file(const char *path, size_t *size) {
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0) fail_msg("cannot read %s: %s", path, strerror(errno));
    char *data = read_all(fd, size);
    close(fd);
    return data;
}

bool kit_exists(const char *path) { return access(path, F_OK) == 0; }

static int by_name(const void *a, const void *b) { return strcmp(*(char *const *)a, *(char *const *)b); }

char **kit_names(const char *folder, const char *suffix, size_t *count) {
    DIR *dir = opendir(folder);
    if (!dir) fail_msg("cannot list %s: %s", folder, strerror(errno));
    char **names = NULL;
    *count = 0;
    for (struct dirent *entry; (entry = readdir(dir));) {
        size_t length = strlen(entry->d_name), tail = strlen(suffix);
        if (entry->d_name[0] == '.' || length < tail || strcmp(entry->d_name + length - tail, suffix)) continue;
        names = realloc(names, (*count + 1) * sizeof *names);
        if (!names || !(names[*count] = strdup(entry->d_name))) fail_msg("out of memory");
        ++*count;
    }
    closedir(dir);
    if (*count) qsort(names, *count, sizeof *names, by_name);
    return names;
}

void kit_names_free(char **names, size_t count) {
    for (size_t i = 0; i < count; i++) free(names[i]);
    free(names);
}

/* The program's outputs go to files, not pipes, so neither can fill up while the other is read. */
static int output_file(void) {
    char name[300];
    snprintf(name, sizeof name, "%s/output-XXXXXX", kit_temp_dir());
    int fd = mkostemp(name, O_CLOEXEC);
    if (fd < 0) fail_msg("cannot make %s: %s", name, strerror(errno));
    unlink(name);
    return fd;
}

static char *collect(int fd, size_t *size) {
    lseek(fd, 0, SEEK_SET);
    char *text = read_all(fd, size);
    close(fd);
    return text;
}

kit_result kit_run(const char *const argv[]) {
    int out = output_file(), err = output_file(), status;
    fflush(NULL);
    pid_t child = fork();
    if (child < 0) fail_msg("fork failed: %s", strerror(errno));
    if (child == 0) {
        int in = open("/dev/null", O_RDONLY);
        if (in < 0 || dup2(in, 0) < 0 || dup2(out, 1) < 0 || dup2(err, 2) < 0) _exit(126);
        execvp(argv[0], (char *const *)(uintptr_t)argv);
        fprintf(stderr, "cannot run %s: %s\n", argv[0], strerror(errno));
        _exit(127);
    }
    while (waitpid(child, &status, 0) < 0)
        if (errno != EINTR) fail_msg("waitpid failed: %s", strerror(errno));
    kit_result result = {.exit = WIFEXITED(status) ? WEXITSTATUS(status) : -1,
                         .signal = WIFSIGNALED(status) ? WTERMSIG(status) : 0};
    result.out = collect(out, &result.out_size);
    result.err = collect(err, &result.err_size);
    return result;
}

void kit_result_clear(kit_result *result) {
    free(result->out);
    free(result->err);
    memset(result, 0, sizeof *result);
}

const char *kit_program(const char *name) {
    char *path;
    return keep(asprintf(&path, "%s/%s", BW_BIN_DIR, name) < 0 ? NULL : path);
}

/* ---- shared data and skipping ------------------------------------------------------------------------------- */

static size_t skipped;

void kit_skip(const char *format, ...) {
    va_list args;
    va_start(args, format);
    fputs("SKIP: ", stdout);
    vprintf(format, args);
    putchar('\n');
    fflush(stdout);
    va_end(args);
    skipped++;
    skip();
    abort(); /* skip() does not come back */
}

const char *kit_shared(const char *name) {
    char *path;
    if (asprintf(&path, "%s/%s", BW_SHARED_DIR, name) < 0) path = NULL;
    keep(path);
    if (!kit_exists(path)) kit_skip("%s is not here", path);
    return path;
}

int kit_exit(int failed, size_t tests) { return failed ? failed : tests && skipped >= tests ? 77 : 0; }
