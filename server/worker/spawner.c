#include "server/worker/spawner.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <limits.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/signalfd.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "server/worker/worker_proto.h"

enum { FD_CHANNEL, FD_INPUT, FD_ERRORS, FD_FOLDER, FD_PARAMETERS, FD_MOST };
enum { FD_LEAST = FD_PARAMETERS }; /* the last may be missing */
enum { WORKERS_MOST = 1024, EXTRA_ADDRESS_SPACE = 512 << 20, CPU_GRACE_SECONDS = 5, FILES_MOST = 64 };

typedef struct {
    int signal; /* 0: spawn */
    bw_spawn spawn;
} request;

typedef struct {
    uint64_t token;
    pid_t pid; /* 0: free entry */
} child;

typedef struct {
    int socket, signals;
    const char *worker;
    child children[WORKERS_MOST];
} spawner;

/* ---- in the child, between fork and exec ---- */

static void limit(int what, uint64_t soft, uint64_t hard) {
    struct rlimit now, wanted = {soft, hard};
    if (getrlimit(what, &now) == 0 && now.rlim_max != RLIM_INFINITY) { /* never above what we may have */
        if (wanted.rlim_max > now.rlim_max) wanted.rlim_max = now.rlim_max;
        if (wanted.rlim_cur > wanted.rlim_max) wanted.rlim_cur = wanted.rlim_max;
    }
    if (setrlimit(what, &wanted) != 0) {
        dprintf(2, "cannot set resource limit %d: errno %d\n", what, errno);
        _exit(127);
    }
}

/* Not in builds with sanitizers, which map terabytes. */
static bool limits_memory(void) {
#ifdef BW_NO_ADDRESS_LIMIT
    return false;
#else
    return true;
#endif
}

static void confine(const bw_spawn *s, pid_t parent) {
    sigset_t none;
    sigemptyset(&none);
    sigprocmask(SIG_SETMASK, &none, NULL);
    signal(SIGINT, SIG_DFL);
    signal(SIGTERM, SIG_DFL);
    signal(SIGHUP, SIG_DFL);
    signal(SIGPIPE, SIG_DFL);
    if (setsid() < 0 || prctl(PR_SET_PDEATHSIG, SIGKILL) != 0 || prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) {
        dprintf(2, "cannot confine the worker: errno %d\n", errno);
        _exit(127);
    }
    if (getppid() != parent) _exit(127); /* the spawner died before the death signal was armed */
    if (limits_memory()) limit(RLIMIT_AS, s->memory + EXTRA_ADDRESS_SPACE, s->memory + EXTRA_ADDRESS_SPACE);
    limit(RLIMIT_CPU, (uint64_t)s->cpu_seconds, (uint64_t)s->cpu_seconds + CPU_GRACE_SECONDS);
    limit(RLIMIT_FSIZE, s->file_size, s->file_size);
    limit(RLIMIT_NOFILE, FILES_MOST, FILES_MOST);
    limit(RLIMIT_CORE, 0, 0);
}

/* Moves the descriptors to their places; all others are closed. */
static void arrange(const int *fds, int count) {
    int high[FD_MOST], last = count > FD_PARAMETERS ? BW_WORKER_PARAMETERS : BW_WORKER_INPUT;
    for (int i = 0; i < count; i++)
        if ((high[i] = fcntl(fds[i], F_DUPFD, 64)) < 0) _exit(127);
    int null = open("/dev/null", O_RDONLY);
    if (null < 0 || dup2(null, 0) < 0 || dup2(high[FD_ERRORS], 1) < 0 || dup2(high[FD_ERRORS], 2) < 0 ||
        dup2(high[FD_CHANNEL], BW_WORKER_CHANNEL) < 0 || dup2(high[FD_INPUT], BW_WORKER_INPUT) < 0 ||
        (count > FD_PARAMETERS && dup2(high[FD_PARAMETERS], BW_WORKER_PARAMETERS) < 0) || fchdir(high[FD_FOLDER]) != 0 ||
        close_range((unsigned)last + 1, ~0u, 0) != 0)
        _exit(127);
}

static void become_worker(const spawner *s, const bw_spawn *spawn, const int *fds, int count, pid_t parent) {
    char memory[24], attempt[16];
    snprintf(memory, sizeof memory, "%" PRIu64, spawn->memory);
    snprintf(attempt, sizeof attempt, "%d", spawn->attempt);
    char *argv[] = {(char *)s->worker, "--stage", (char *)spawn->stage, "--options", (char *)spawn->options, "--memory",
                    memory, "--require-sandbox", spawn->require_sandbox ? "yes" : "no", "--job", (char *)spawn->job, "--attempt", attempt, NULL};
    char *env[] = {"LC_ALL=C", "PATH=/usr/bin:/bin", NULL};
    arrange(fds, count);
    confine(spawn, parent);
    execve(s->worker, argv, env);
    dprintf(2, "cannot run %s: errno %d\n", s->worker, errno);
    _exit(127);
}

/* ---- the spawner's loop ---- */

static void report(const spawner *s, const bw_spawn_report *r) {
    while (send(s->socket, r, sizeof *r, MSG_NOSIGNAL) < 0 && errno == EINTR) continue;
}

static void start_worker(spawner *s, const bw_spawn *spawn, const int *fds, int count) {
    bw_spawn_report r = {.kind = BW_WORKER_STARTED, .token = spawn->token, .pid = -1};
    child *c = s->children;
    while (c < s->children + WORKERS_MOST && c->pid) c++;
    pid_t self = getpid();
    if (c < s->children + WORKERS_MOST) r.pid = fork();
    if (r.pid == 0) become_worker(s, spawn, fds, count, self);
    if (r.pid > 0) {
        c->token = spawn->token;
        c->pid = r.pid;
    }
    report(s, &r);
    if (r.pid > 0) return;
    r.kind = BW_WORKER_EXITED;
    r.wait_status = 127 << 8;
    report(s, &r);
}

static void signal_workers(const spawner *s, uint64_t token, int signal) {
    for (const child *c = s->children; c < s->children + WORKERS_MOST; c++) {
        if (!c->pid || (token && c->token != token)) continue;
        if (kill(-c->pid, signal) != 0) kill(c->pid, signal); /* it may not lead its group yet */
    }
}

/* Reaps what has ended. Returns how many children are left. */
static int reap(spawner *s, bool wait) {
    int left = 0;
    for (child *c = s->children; c < s->children + WORKERS_MOST; c++) {
        int status = 0;
        struct rusage use;
        siginfo_t info = {.si_pid = 0};
        if (!c->pid) continue;
        if (waitid(P_PID, (id_t)c->pid, &info, WEXITED | WNOWAIT | (wait ? 0 : WNOHANG)) != 0 || info.si_pid != c->pid) {
            left++;
            continue;
        }
        kill(-c->pid, SIGKILL); /* nothing that the worker may have started stays behind; the number is still ours */
        pid_t pid = wait4(c->pid, &status, 0, &use);
        bw_spawn_report r = {.kind = BW_WORKER_EXITED, .token = c->token, .pid = pid, .wait_status = status};
        r.cpu_ms = (use.ru_utime.tv_sec + use.ru_stime.tv_sec) * 1000 + (use.ru_utime.tv_usec + use.ru_stime.tv_usec) / 1000;
        r.peak_bytes = (int64_t)use.ru_maxrss * 1024;
        c->pid = 0;
        report(s, &r);
    }
    return left;
}

/* False: the daemon is gone. */
static bool serve(spawner *s) {
    request req;
    int fds[FD_MOST], count = 0;
    union {
        struct cmsghdr align;
        char space[CMSG_SPACE(sizeof fds)];
    } control;
    struct iovec part = {&req, sizeof req};
    struct msghdr message = {.msg_iov = &part, .msg_iovlen = 1, .msg_control = &control,
                             .msg_controllen = sizeof control};
    ssize_t n = recvmsg(s->socket, &message, MSG_CMSG_CLOEXEC);
    if (n < 0) return errno == EINTR || errno == EAGAIN;
    if (n != sizeof req) return false;
    struct cmsghdr *c = CMSG_FIRSTHDR(&message);
    if (req.signal) {
        signal_workers(s, req.spawn.token, req.signal);
    } else if (c && c->cmsg_type == SCM_RIGHTS) {
        count = (int)((c->cmsg_len - CMSG_LEN(0)) / sizeof *fds); /* no more than there is space for */
        memcpy(fds, CMSG_DATA(c), (size_t)count * sizeof *fds);
        if (count >= FD_LEAST) start_worker(s, &req.spawn, fds, count);
        for (int i = 0; i < count; i++) close(fds[i]);
    }
    return true;
}

/* Takes DATA/spawner.lock; gives up when the daemon is gone. */
static bool take_lock(const spawner *s, const char *data) {
    char path[PATH_MAX];
    snprintf(path, sizeof path, "%s/spawner.lock", data);
    int fd = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    if (fd < 0) return false;
    while (flock(fd, LOCK_EX | LOCK_NB) != 0) {
        struct pollfd daemon = {s->socket, POLLIN, 0};
        if (poll(&daemon, 1, 20) > 0) return false; /* nothing is asked before READY, so this is the end */
    }
    return true;
}

static void spawner_main(const char *data, const char *worker, int socket) {
    static spawner s;
    sigset_t set;
    s.socket = socket;
    s.worker = worker;
    prctl(PR_SET_NAME, "bw-spawner");
    signal(SIGINT, SIG_IGN); /* the daemon decides when to stop */
    signal(SIGTERM, SIG_IGN);
    signal(SIGHUP, SIG_IGN);
    sigemptyset(&set);
    sigaddset(&set, SIGCHLD);
    sigprocmask(SIG_BLOCK, &set, NULL);
    s.signals = signalfd(-1, &set, SFD_CLOEXEC | SFD_NONBLOCK);
    if (s.signals < 0 || !take_lock(&s, data)) _exit(1);
    report(&s, &(bw_spawn_report){.kind = BW_SPAWNER_READY});
    for (bool alive = true; alive;) {
        struct pollfd fds[2] = {{s.socket, POLLIN, 0}, {s.signals, POLLIN, 0}};
        struct signalfd_siginfo info;
        if (poll(fds, 2, -1) < 0 && errno != EINTR) break;
        while (read(s.signals, &info, sizeof info) > 0) continue;
        reap(&s, false);
        if (fds[0].revents) alive = serve(&s);
    }
    signal_workers(&s, 0, SIGKILL);
    reap(&s, true);
    _exit(0);
}

/* ---- the daemon's side ---- */

bw_status bw_spawner_start(const char *data, const char *worker, int *out) {
    int pair[2];
    if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair) != 0) return BW_E_IO;
    pid_t pid = fork();
    if (pid < 0) {
        close(pair[0]);
        close(pair[1]);
        return BW_E_IO;
    }
    if (pid == 0) {
        close(pair[0]);
        spawner_main(data, worker, pair[1]);
    }
    close(pair[1]);
    *out = pair[0];
    return BW_OK;
}

bw_status bw_spawner_wait_ready(int socket, int seconds) {
    struct pollfd fd = {socket, POLLIN, 0};
    bw_spawn_report r;
    bool gone;
    if (poll(&fd, 1, seconds * 1000) <= 0) return BW_E_TIME;
    return bw_spawner_report(socket, &r, &gone) && r.kind == BW_SPAWNER_READY ? BW_OK : BW_E_IO;
}

static bw_status ask(int socket, const request *req, const int *fds, size_t count) {
    union {
        struct cmsghdr align;
        char space[CMSG_SPACE(FD_MOST * sizeof(int))];
    } control;
    struct iovec part = {(void *)req, sizeof *req};
    struct msghdr message = {.msg_iov = &part, .msg_iovlen = 1};
    if (count) {
        memset(&control, 0, sizeof control);
        message.msg_control = &control;
        message.msg_controllen = CMSG_SPACE(count * sizeof(int));
        struct cmsghdr *c = CMSG_FIRSTHDR(&message);
        c->cmsg_level = SOL_SOCKET;
        c->cmsg_type = SCM_RIGHTS;
        c->cmsg_len = CMSG_LEN(count * sizeof(int));
        memcpy(CMSG_DATA(c), fds, count * sizeof(int));
    }
    ssize_t n;
    while ((n = sendmsg(socket, &message, MSG_NOSIGNAL)) < 0 && errno == EINTR) continue;
    return n == sizeof *req ? BW_OK : BW_E_IO;
}

bw_status bw_spawner_spawn(int socket, const bw_spawn *spawn, const bw_spawn_files *files) {
    request req;
    const int fds[FD_MOST] = {files->channel, files->input, files->errors, files->folder, files->parameters};
    memset(&req, 0, sizeof req);
    req.spawn = *spawn;
    return ask(socket, &req, fds, files->parameters >= 0 ? FD_MOST : FD_LEAST);
}

bw_status bw_spawner_kill(int socket, uint64_t token, int signal) {
    request req;
    memset(&req, 0, sizeof req);
    req.signal = signal;
    req.spawn.token = token;
    return ask(socket, &req, NULL, 0);
}

bool bw_spawner_report(int socket, bw_spawn_report *report_, bool *gone) {
    ssize_t n;
    while ((n = recv(socket, report_, sizeof *report_, MSG_DONTWAIT)) < 0 && errno == EINTR) continue;
    *gone = n == 0 || (n < 0 && errno != EAGAIN && errno != EWOULDBLOCK);
    return n == (ssize_t)sizeof *report_;
}
