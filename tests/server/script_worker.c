/* blockwright-test-worker: speaks the worker protocol like blockwright-worker, but does what its input says, so that tests of
 * the daemon are fast and can have every kind of end. The input is a script of lines
 *
 *     STAGE VERB [ARGUMENT]      STAGE may be * for every stage
 *
 *     sleep MS        in steps of 5 ms, with progress; SIGTERM ends it as "cancelled"
 *     search MS       likewise, with notes; SIGUSR1 ends it, and the output says "# cut" and is announced as cut
 *     deaf            ignore SIGTERM from here on
 *     log TEXT        a log line
 *     bytes N         size of data.bin, which encode writes (default 1000)
 *     fail CODE       end with this status code, naming tet 7 and tet 9
 *     raise SIGNAL    send this signal to itself
 *     exit CODE       end without a result
 *     spin            use processor time for ever
 *     burn MS         use that much of it
 *     allocate BYTES  take that much memory, "memory-limit" if refused
 *     fill BYTES      write a file of this size
 *     garbage         send bytes that are no frame
 *     nothing         say ok without writing the output
 *     folder          write the output as an empty folder
 *     link            write the output as a symbolic link
 *     flaky N         raise SIGKILL unless this is attempt N or later (of the job)
 *     unconfined      enter no sandbox, and say so
 *     need BYTES      tell this as the need of the next stage
 *     kind WORD       tell this as the kind of the input
 *     touch BYTES     take that much memory bit by bit and use a part of it, "memory-limit" if refused
 *     many BYTES      write files of 1 MB until they add up to this
 *     chatter BYTES   write that much to standard error
 *     frames BYTES    say that much in log lines
 *     thread          start a thread and wait for it
 *     fork, exec, socket, ptrace, mount   try it, and log that it was not stopped
 *     read PATH, write PATH, remove PATH, handles, signal, owner
 *                     try it (handles: open files without end; signal: to the parent; owner: make the parent the one whom the kernel signals
 *                     of news on the channel); if the system refuses, log how and end with
 *                     "sandbox-violation", else end with "check-failed"
 *
 * A file of parameters goes before the script, as if it were its beginning. sanitize copies the script to its output; every later stage copies its input to its output, with the stage's name added as a
 * comment line; encode writes script.txt (its input), data.bin (bytes that depend on the input alone) and report.json. */
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/mount.h>
#include <sys/ptrace.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "bw_api.h"
#include "server/worker/sandbox.h"
#include "server/worker/worker_proto.h"

static volatile sig_atomic_t cancelled, asked;
static bool cut;
static const bw_api_stage *stage;
static int attempt;
static char *script; /* the whole input, NUL-terminated */
static size_t script_size;
static long data_bytes = 1000;
static uint64_t need;
static const char *kind = ""; /* a member of the result */
static bool open_air; /* started by the name blockwright-test-worker-open: it never enters a sandbox */

static void on_term(int signal) {
    (void)signal;
    cancelled = 1;
}

static void on_finish(int signal) {
    (void)signal;
    asked = 1;
}

static void finish(const char *code) {
    char text[700];
    int n = snprintf(text, sizeof text,
                     "{\"status\":\"%s\",\"message\":\"the script says %s\",\"element_count\":40,\"elements\":["
                     "{\"kind\":\"tet\",\"id\":7,\"position\":[0.5,1,2]},{\"kind\":\"tet\",\"id\":9}],\"region_count\":5,\"regions\":["
                     "{\"tets\":3,\"ids\":[7,\"x\",9],\"position\":[0.5,1,2],\"box\":[[0,1,2],[1,1,2]],\"more\":1},"
                     "{\"tets\":3,\"ids\":[7],\"position\":[0.5,1],\"box\":[[0,1,2],[1,1,2]]}]}", code, code);
    if (strcmp(code, "ok") == 0) n = snprintf(text, sizeof text, "{\"status\":\"ok\",\"need\":%" PRIu64 "%s%s}", need, cut ? ",\"cut\":true" : "", kind);
    exit(bw_send_frame(BW_WORKER_CHANNEL, BW_FRAME_RESULT, text, (size_t)n) ? 0 : 5);
}

static void nap(long ms) {
    for (long done = 0; done < ms; done += 5) {
        if (cancelled) finish("cancelled");
        bw_send_progress(BW_WORKER_CHANNEL, (double)done / (double)ms);
        nanosleep(&(struct timespec){0, 5000000}, NULL);
    }
}

static void search(long ms) {
    for (long done = 0; done < ms && !cut; done += 5) {
        char note[40];
        int n = snprintf(note, sizeof note, "best %ld\001\377", 1000 - done / 100);
        bw_send_frame(BW_WORKER_CHANNEL, BW_FRAME_NOTE, note, (size_t)n);
        nap(5);
        cut = asked;
    }
}

static void write_bytes(const char *path, const char *data, size_t size) {
    int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC, 0600);
    if (fd < 0 || write(fd, data, size) != (ssize_t)size || close(fd) != 0) finish("io");
}

static void fill(long bytes) {
    static char zeros[65536];
    int fd = open("filler", O_WRONLY | O_CREAT | O_TRUNC, 0600);
    for (long done = 0; done < bytes; done += (long)sizeof zeros)
        if (write(fd, zeros, sizeof zeros) < 0) finish("io");
    close(fd);
}

static void burn(long ms) {
    struct timespec now;
    do clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    while (now.tv_sec * 1000 + now.tv_nsec / 1000000 < ms);
}

static void allocate(size_t bytes) {
    void *block = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (block == MAP_FAILED) finish("memory-limit");
}

static void say(const char *format, ...) __attribute__((format(printf, 1, 2)));
static void say(const char *format, ...) {
    char line[300];
    va_list args;
    va_start(args, format);
    int n = vsnprintf(line, sizeof line, format, args);
    va_end(args);
    bw_send_frame(BW_WORKER_CHANNEL, BW_FRAME_LOG, line, (size_t)n);
}

static void touch(size_t bytes) {
    enum { STEP = 4 << 20 };
    for (size_t done = 0; done < bytes; done += STEP) {
        void *block = mmap(NULL, STEP, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
        if (block == MAP_FAILED) finish("memory-limit");
        memset(block, 1, STEP / 16);
    }
}

static void many(long bytes) {
    static char zeros[1000000];
    char name[32];
    for (long i = 0; i < bytes / (long)sizeof zeros; i++) {
        snprintf(name, sizeof name, "file%ld", i);
        write_bytes(name, zeros, sizeof zeros);
        nanosleep(&(struct timespec){0, 10000000}, NULL);
    }
}

static void chatter(long bytes) {
    char line[1000];
    memset(line, 'x', sizeof line);
    line[sizeof line - 1] = '\n';
    for (long done = 0; done < bytes; done += (long)sizeof line)
        if (write(2, line, sizeof line) < 0) exit(6);
}

static void frames(long bytes) {
    char line[1000];
    memset(line, 'y', sizeof line);
    for (long done = 0; done < bytes; done += (long)sizeof line)
        if (!bw_send_frame(BW_WORKER_CHANNEL, BW_FRAME_LOG, line, sizeof line)) exit(6);
}

static void *work(void *user) { return user; }

static void run_thread(void) {
    pthread_t thread;
    void *back = NULL;
    if (pthread_create(&thread, NULL, work, &need) != 0 || pthread_join(thread, &back) != 0 || back != &need) finish("internal");
    say("a thread ran");
}

/* What seccomp ends the worker for. */
static bool forbidden(const char *verb) {
    char *none[] = {NULL};
    if (!strcmp(verb, "fork")) {
        pid_t pid = fork();
        if (pid == 0) _exit(0);
        if (pid > 0) waitpid(pid, NULL, 0);
    } else if (!strcmp(verb, "exec")) execve("/bin/true", none, none);
    else if (!strcmp(verb, "socket")) (void)!socket(AF_INET, SOCK_STREAM, 0);
    else if (!strcmp(verb, "ptrace")) ptrace(PTRACE_TRACEME, 0, NULL, NULL);
    else if (!strcmp(verb, "mount")) (void)!mount("none", "/mnt", "tmpfs", 0, NULL);
    else return false;
    say("%s was not stopped", verb);
    return true;
}

/* What the system refuses. */
static bool refused(const char *verb, const char *path) {
    int done = -1, count = 0;
    errno = 0;
    if (!strcmp(verb, "read")) done = open(path, O_RDONLY);
    else if (!strcmp(verb, "write")) done = open(path, O_WRONLY | O_CREAT, 0600);
    else if (!strcmp(verb, "remove")) done = unlink(path);
    else if (!strcmp(verb, "signal")) done = kill(getppid(), SIGCONT);
    else if (!strcmp(verb, "owner")) done = fcntl(BW_WORKER_CHANNEL, F_SETOWN, getppid());
    else if (!strcmp(verb, "handles")) while ((done = open("/dev/urandom", O_RDONLY)) >= 0) count++;
    else return false;
    say("%s %s: %s after %d", verb, path, done >= 0 ? "done" : strerrorname_np(errno), count);
    finish(done >= 0 ? "check-failed" : "sandbox-violation");
    return true;
}

static void tell_kind(const char *word) {
    static char member[80];
    snprintf(member, sizeof member, ",\"kind\":\"%.60s\"", word);
    kind = member;
}

static void obey(const char *verb, const char *argument) {
    long number = strtol(argument, NULL, 10);
    if (!strcmp(verb, "sleep")) nap(number);
    else if (!strcmp(verb, "search")) search(number);
    else if (!strcmp(verb, "deaf")) signal(SIGTERM, SIG_IGN);
    else if (!strcmp(verb, "log")) bw_send_frame(BW_WORKER_CHANNEL, BW_FRAME_LOG, argument, strlen(argument));
    else if (!strcmp(verb, "bytes")) data_bytes = number;
    else if (!strcmp(verb, "fail")) finish(argument);
    else if (!strcmp(verb, "raise")) raise((int)number);
    else if (!strcmp(verb, "exit")) exit((int)number);
    else if (!strcmp(verb, "spin")) for (volatile unsigned i = 0;; i++) continue;
    else if (!strcmp(verb, "burn")) burn(number);
    else if (!strcmp(verb, "allocate")) allocate((size_t)number);
    else if (!strcmp(verb, "fill")) fill(number);
    else if (!strcmp(verb, "garbage")) write(BW_WORKER_CHANNEL, "no frame at all", 15) < 0 ? exit(5) : pause();
    else if (!strcmp(verb, "nothing")) finish("ok");
    else if (!strcmp(verb, "folder")) mkdir("out", 0700) < 0 ? exit(5) : finish("ok");
    else if (!strcmp(verb, "link")) symlink("/etc/passwd", "out") < 0 ? exit(5) : finish("ok");
    else if (!strcmp(verb, "need")) need = (uint64_t)number;
    else if (!strcmp(verb, "kind")) tell_kind(argument);
    else if (!strcmp(verb, "touch")) touch((size_t)number);
    else if (!strcmp(verb, "many")) many(number);
    else if (!strcmp(verb, "chatter")) chatter(number);
    else if (!strcmp(verb, "frames")) frames(number);
    else if (!strcmp(verb, "thread")) run_thread();
    else if (forbidden(verb) || refused(verb, argument)) return;
    else if (!strcmp(verb, "flaky") && attempt < number) raise(SIGKILL);
}

static void obey_script(void) {
    char *copy = strdup(script), *rest = copy;
    for (char *line; (line = strsep(&rest, "\n"));) {
        char *of = strsep(&line, " "), *verb = line ? strsep(&line, " ") : NULL;
        if (verb && (!strcmp(of, "*") || !strcmp(of, stage->name))) obey(verb, line ? line : "");
    }
    free(copy);
}

static void write_results(void) {
    char report[200], *data = malloc((size_t)data_bytes + 1);
    uint64_t x = 88172645463325252u;
    if (!data) finish("memory-limit");
    for (size_t i = 0; i < script_size; i++) x = (x ^ (unsigned char)script[i]) * 1099511628211u;
    for (long i = 0; i < data_bytes; i++) {
        x ^= x << 13, x ^= x >> 7, x ^= x << 17;
        data[i] = (char)x;
    }
    int n = snprintf(report, sizeof report, "{\"script_bytes\": %zu, \"data_bytes\": %ld}\n", script_size, data_bytes);
    if (mkdir("out", 0700) != 0) finish("io");
    write_bytes("out/script.txt", script, script_size);
    write_bytes("out/data.bin", data, (size_t)data_bytes);
    write_bytes("out/report.json", report, (size_t)n);
    free(data);
}

static void write_state(void) {
    size_t size = script_size + strlen(stage->name) + 9;
    char *state = malloc(size + 1);
    if (!state) finish("memory-limit");
    snprintf(state, size + 1, "%s# %s\n%s", script, stage->name, cut ? "# cut\n" : "");
    write_bytes("out", state, strlen(state));
    free(state);
}

static void read_script(void) {
    struct stat input, parameters = {.st_size = 0};
    if (fstat(BW_WORKER_INPUT, &input) != 0) exit(5);
    size_t before = fstat(BW_WORKER_PARAMETERS, &parameters) == 0 ? (size_t)parameters.st_size : 0;
    script_size = before + (size_t)input.st_size;
    script = calloc(script_size + 1, 1);
    if (!script || (before && pread(BW_WORKER_PARAMETERS, script, before, 0) != (ssize_t)before) ||
        pread(BW_WORKER_INPUT, script + before, script_size - before, 0) != (ssize_t)(script_size - before))
        exit(5);
}

/* Unless the script says otherwise. */
static void enter_sandbox(char level[BW_SANDBOX_TEXT]) {
    static const int readable[] = {BW_WORKER_INPUT, BW_WORKER_PARAMETERS};
    bw_sandbox sandbox = {.missing = "everything: the script says so"};
    if (!open_air && !(script && strstr(script, "* unconfined\n"))) bw_sandbox_enter(readable, 2, &sandbox);
    bw_sandbox_json(&sandbox, level);
}

static void say_hello(const char *name, int version) {
    char level[BW_SANDBOX_TEXT], hello[BW_SANDBOX_TEXT + 96];
    enter_sandbox(level);
    int n = snprintf(hello, sizeof hello, "{\"stage\":\"%s\",\"version\":%d,\"sandbox\":%s}", name, version, level);
    if (!bw_send_frame(BW_WORKER_CHANNEL, BW_FRAME_HELLO, hello, (size_t)n)) exit(5);
}

int main(int argc, char **argv) {
    bool trial = false;
    open_air = argc > 0 && strstr(argv[0], "-open");
    for (int i = 1; i + 1 < argc; i += 2) {
        for (int s = 0; s < BW_API_STAGE_COUNT && !strcmp(argv[i], "--stage"); s++)
            if (!strcmp(argv[i + 1], bw_api_stages[s].name)) stage = &bw_api_stages[s];
        if (!strcmp(argv[i], "--stage")) trial = !strcmp(argv[i + 1], BW_WORKER_TRIAL);
        if (!strcmp(argv[i], "--attempt")) attempt = atoi(argv[i + 1]);
    }
    if (!stage && !trial) return 2;
    signal(SIGTERM, on_term);
    signal(SIGUSR1, on_finish);
    if (!trial) read_script();
    say_hello(trial ? BW_WORKER_TRIAL : stage->name, trial ? 0 : stage->version);
    if (trial) finish("ok");
    obey_script();
    if (stage == &bw_api_stages[BW_API_STAGE_COUNT - 1]) write_results();
    else write_state();
    finish("ok");
}
