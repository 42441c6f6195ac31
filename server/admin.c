#include "server/admin.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <poll.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#include "server/clock.h"
#include "server/files.h"
#include "server/log.h"

enum { LINE_MOST = 1 << 20, PATIENCE_SECONDS = 5, ASK_WAIT_MS = 20000, ASK_AGAIN_MS = 50, ANSWER_SECONDS = 3600, PAUSE_MS = 100 };

struct bw_admin {
    bw_admin_services services;
    pthread_t thread;
    atomic_bool stopping;
    int folder, listening, stop; /* the data folder; the socket; an eventfd */
};

static json_t *refuse(char error[BW_ADMIN_ERROR], const char *format, ...) __attribute__((format(printf, 2, 3)));
static json_t *refuse(char error[BW_ADMIN_ERROR], const char *format, ...) {
    va_list args;
    va_start(args, format);
    vsnprintf(error, BW_ADMIN_ERROR, format, args);
    va_end(args);
    return NULL;
}

static json_t *run(const bw_admin_services *services, const json_t *request, char error[BW_ADMIN_ERROR]) {
    const char *name = json_string_value(json_object_get(request, "command"));
    for (const bw_admin_command *c = bw_admin_commands; name && c->name; c++)
        if (strcmp(c->name, name) == 0) return c->run(services, request, error);
    return refuse(error, "the daemon does not know this command; is it of another version?");
}

/* ---- the socket ---- */

/* The name of DATA/control by way of the folder's descriptor: those of sockets are short, those of folders may be long. */
static struct sockaddr_un address_of(int folder) {
    struct sockaddr_un to = {.sun_family = AF_UNIX};
    snprintf(to.sun_path, sizeof to.sun_path, "/proc/self/fd/%d/control", folder);
    return to;
}

static void limit_waiting(int fd) {
    struct timeval patience = {PATIENCE_SECONDS, 0};
    setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    setsockopt(fd, SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
}

/* Reads up to a line's end; NULL if none comes. */
static json_t *receive(int fd) {
    size_t n = 0, room = 0;
    char *line = NULL;
    ssize_t got = 1;
    while (got > 0 && n < LINE_MOST && (!n || line[n - 1] != '\n')) {
        if (n == room) {
            char *more = realloc(line, room = room ? 2 * room : 4096);
            if (!more) break;
            line = more;
        }
        do got = recv(fd, line + n, room - n, 0);
        while (got < 0 && errno == EINTR);
        if (got > 0) n += (size_t)got;
    }
    json_t *value = n && line[n - 1] == '\n' ? json_loadb(line, n, 0, NULL) : NULL;
    if (line) explicit_bzero(line, n); /* it may have a token in it */
    free(line);
    return value;
}

static bool transmit(int fd, const json_t *value) {
    char *line = json_dumps(value, JSON_COMPACT);
    size_t n = line ? strlen(line) : 0, sent = 0;
    if (!line) return false;
    line[n++] = '\n'; /* in the place of the NUL */
    while (sent < n) {
        ssize_t w = send(fd, line + sent, n - sent, MSG_NOSIGNAL);
        if (w < 0 && errno == EINTR) continue;
        if (w <= 0) break;
        sent += (size_t)w;
    }
    explicit_bzero(line, n);
    free(line);
    return sent == n;
}

/* ---- the daemon's side ---- */

static bool is_operator(int fd) {
    struct ucred peer;
    socklen_t size = sizeof peer;
    return getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &peer, &size) == 0 && (peer.uid == geteuid() || peer.uid == 0);
}

static void serve_one(bw_admin *admin, int fd) {
    char error[BW_ADMIN_ERROR] = "the request is no line of JSON";
    limit_waiting(fd);
    if (!is_operator(fd)) return;
    json_t *request = receive(fd), *answer = request ? run(&admin->services, request, error) : NULL;
    if (!answer) answer = json_pack("{s:s}", "error", error);
    transmit(fd, answer);
    json_decref(answer);
    json_decref(request);
}

/* The connection stays, so poll would return at once: for lack of descriptors, say. */
static void pause_after(const bw_admin *admin, int error) {
    struct pollfd stop = {admin->stop, POLLIN, 0};
    if (error != EAGAIN && error != EINTR && error != ECONNABORTED) poll(&stop, 1, PAUSE_MS);
}

static void *admin_main(void *user) {
    bw_admin *admin = user;
    struct pollfd fds[2] = {{admin->listening, POLLIN, 0}, {admin->stop, POLLIN, 0}};
    for (;;) {
        if (poll(fds, 2, -1) < 0 && errno != EINTR) break;
        if (fds[1].revents) break;
        if (!fds[0].revents) continue;
        int fd = accept4(admin->listening, NULL, NULL, SOCK_CLOEXEC);
        if (fd < 0) pause_after(admin, errno);
        else serve_one(admin, fd), close(fd);
    }
    return NULL;
}

static bw_status listen_on(bw_admin *admin) {
    struct sockaddr_un at = address_of(admin->folder);
    unlinkat(admin->folder, "control", 0);
    admin->listening = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (admin->listening < 0 || fchmod(admin->listening, 0600) != 0 || /* before bind: there is no moment with more */
        bind(admin->listening, (struct sockaddr *)&at, sizeof at) != 0 || listen(admin->listening, 8) != 0)
        return BW_E_IO;
    return fchmodat(admin->folder, "control", 0600, 0) == 0 ? BW_OK : BW_E_IO;
}

bw_status bw_admin_start(const char *data, const bw_admin_services *services, bw_admin **out) {
    bw_admin *admin = calloc(1, sizeof *admin);
    if (!admin) return BW_E_MEMORY;
    *admin = (bw_admin){.services = *services, .listening = -1, .stop = eventfd(0, EFD_CLOEXEC)};
    admin->services.stopping = &admin->stopping;
    admin->folder = open(data, O_PATH | O_DIRECTORY | O_CLOEXEC);
    bw_status status = admin->folder >= 0 && admin->stop >= 0 ? listen_on(admin) : BW_E_IO;
    if (status == BW_OK && pthread_create(&admin->thread, NULL, admin_main, admin) == 0) {
        *out = admin;
        return BW_OK;
    }
    if (admin->listening >= 0) close(admin->listening);
    if (admin->folder >= 0) close(admin->folder);
    if (admin->stop >= 0) close(admin->stop);
    free(admin);
    return BW_E_IO;
}

void bw_admin_stop(bw_admin *admin) {
    if (!admin) return;
    atomic_store(&admin->stopping, true);
    if (write(admin->stop, &(uint64_t){1}, 8) == 8) pthread_join(admin->thread, NULL);
    unlinkat(admin->folder, "control", 0);
    close(admin->listening);
    close(admin->folder);
    close(admin->stop);
    free(admin);
}

/* ---- the other side ---- */

/* A connection to the daemon, or -1. */
static int connect_to(int folder) {
    struct sockaddr_un to = address_of(folder);
    int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (fd >= 0 && connect(fd, (struct sockaddr *)&to, sizeof to) == 0) return fd;
    if (fd >= 0) close(fd);
    return -1;
}

static json_t *ask_daemon(int fd, const json_t *request, char error[BW_ADMIN_ERROR]) {
    struct timeval patience = {ANSWER_SECONDS, 0}; /* a copy of everything takes its time */
    setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    json_t *answer = transmit(fd, request) ? receive(fd) : NULL;
    const char *why = json_string_value(json_object_get(answer, "error"));
    if (answer && !why) return answer;
    refuse(error, "%s", why ? why : "the daemon does not answer on DATA/control");
    json_decref(answer);
    return NULL;
}

/* In the place of the daemon, with its lock held. */
static json_t *do_it(const bw_config *config, const json_t *request, char error[BW_ADMIN_ERROR]) {
    char path[PATH_MAX];
    bw_admin_services services = {.config = config};
    json_t *answer = NULL;
    snprintf(path, sizeof path, "%s/jobs.db", config->data);
    bw_log_configure(BW_WARN, BW_LOGFMT);
    bw_status status = bw_queue_open(path, &services.queue);
    if (status == BW_OK) status = bw_store_open(config->data, &services.store);
    if (status == BW_OK) status = bw_retention_open(config, services.store, services.queue, &services.retention);
    if (status == BW_OK) status = bw_access_open(services.queue, &services.access);
    if (status == BW_OK) answer = run(&services, request, error);
    else refuse(error, "%.200s cannot be opened", path);
    bw_access_close(services.access);
    bw_retention_close(services.retention);
    bw_queue_close(services.queue);
    bw_store_close(services.store);
    return answer;
}

json_t *bw_admin_ask(const bw_config *config, json_t *request, char error[BW_ADMIN_ERROR]) {
    const char *data = config->data;
    char path[PATH_MAX];
    json_t *answer = NULL;
    bool settled = false;
    int folder = open(data, O_PATH | O_DIRECTORY | O_CLOEXEC), fd, lock;
    snprintf(path, sizeof path, "%s/lock", data);
    refuse(error, "%.200s is held by another process that does not answer", path);
    /* A daemon that starts or stops has the lock but not the socket. */
    for (int64_t end = bw_mono_ms() + ASK_WAIT_MS; folder >= 0 && !settled && bw_mono_ms() < end;) {
        if ((fd = connect_to(folder)) >= 0) {
            answer = ask_daemon(fd, request, error);
            settled = true;
            close(fd);
        } else if ((lock = bw_lock_file(path)) >= 0) {
            answer = do_it(config, request, error);
            settled = true;
            close(lock);
        } else {
            nanosleep(&(struct timespec){0, ASK_AGAIN_MS * 1000000L}, NULL);
        }
    }
    if (folder >= 0) close(folder);
    else refuse(error, "cannot open the folder '%.200s': %s", data, strerror(errno));
    json_decref(request);
    return answer;
}
