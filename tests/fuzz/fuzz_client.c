/* The command line client on arbitrary answers of a daemon. The first byte is the command (ls, cancel, log, fetch); what follows are the answers on
 * the wire, one per request, parted by the byte 0xff; after the last one the daemon hangs up. Whatever comes: an exit code of
 * the table, no control characters on the terminal, and no file outside of the folder for results. */
#include "fuzz.h"

#include <arpa/inet.h>
#include <dirent.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include "clients/cli/command.h"
#include "clients/cli/failure.h"
#include "clients/cli/summary.h"

static int listener;
static char url[64], above[64], folder[80];
static const uint8_t *next, *end; /* the answers to come */
static pthread_mutex_t serving = PTHREAD_MUTEX_INITIALIZER; /* held while a request is answered */

/* Reads one request as far as its headers go and answers it. */
static void serve(int fd) {
    char request[4096];
    size_t n = 0;
    struct pollfd wait = {fd, POLLIN, 0};
    while (n + 1 < sizeof request && poll(&wait, 1, 1000) > 0) {
        ssize_t got = recv(fd, request + n, sizeof request - 1 - n, 0);
        if (got <= 0) break;
        request[n += (size_t)got] = 0;
        if (strstr(request, "\r\n\r\n")) break;
    }
    const uint8_t *stop = next < end ? memchr(next, 0xff, (size_t)(end - next)) : NULL;
    if (!stop) stop = end;
    while (next < stop) {
        ssize_t sent = send(fd, next, (size_t)(stop - next), MSG_NOSIGNAL);
        if (sent <= 0) break;
        next += sent;
    }
    next = stop < end ? stop + 1 : end;
    shutdown(fd, SHUT_WR);
    close(fd);
}

static void *server(void *user) {
    (void)user;
    for (;;) {
        int fd = accept(listener, NULL, NULL);
        if (fd < 0) continue;
        pthread_mutex_lock(&serving);
        serve(fd);
        pthread_mutex_unlock(&serving);
    }
    return NULL;
}

static void start(void) {
    struct sockaddr_in at = {.sin_family = AF_INET};
    socklen_t size = sizeof at;
    pthread_t thread;
    signal(SIGPIPE, SIG_IGN);
    at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    FUZZ_EXPECT(bind(listener, (struct sockaddr *)&at, sizeof at) == 0 && listen(listener, 16) == 0);
    FUZZ_EXPECT(getsockname(listener, (struct sockaddr *)&at, &size) == 0);
    snprintf(url, sizeof url, "http://127.0.0.1:%d", ntohs(at.sin_port));
    snprintf(above, sizeof above, "/dev/shm/bw-fuzz-client-%ld", (long)getpid());
    snprintf(folder, sizeof folder, "%s/out", above);
    FUZZ_EXPECT(pthread_create(&thread, NULL, server, NULL) == 0);
    setenv("TERM", "dumb", 1);
    unsetenv("http_proxy");
}

static void expect_harmless(const char *text, size_t size) {
    for (size_t i = 0; i < size; i++) {
        unsigned char c = (unsigned char)text[i];
        FUZZ_EXPECT(c == '\n' || c == '\t' || (c >= 32 && c != 127));
        FUZZ_EXPECT(c != 0xc2 || i + 1 == size || ((unsigned char)text[i + 1] & 0xe0) != 0x80);
    }
}

/* How many entries a folder has besides . and ..; they are deleted if they are files. */
static int clear_folder(const char *path) {
    char name[600];
    int n = 0;
    DIR *d = opendir(path);
    for (struct dirent *e; d && (e = readdir(d));) {
        if (!strcmp(e->d_name, ".") || !strcmp(e->d_name, "..")) continue;
        snprintf(name, sizeof name, "%s/%s", path, e->d_name);
        unlink(name);
        n++;
    }
    if (d) closedir(d);
    return n;
}

/* The same JSON where a report and a problem are expected. */
static void tell(const uint8_t *data, size_t size) {
    json_t *json = json_loadb((const char *)data, size, 0, NULL);
    if (!json) return;
    int code = cli_failure_problem("job", json, 500);
    FUZZ_EXPECT(code >= CLI_USAGE && code <= CLI_INTERNAL);
    cli_summary_print(json);
    json_decref(json);
}

static int run(uint8_t which) {
    static const cli_command *const commands[] = {&cli_command_ls, &cli_command_cancel, &cli_command_log, &cli_command_fetch};
    const cli_command *c = commands[which % 4];
    char *argv[8];
    int argc = 0;
    argv[argc++] = "--server", argv[argc++] = url;
    if (c == &cli_command_ls) argv[argc++] = "-n", argv[argc++] = "500";
    else argv[argc++] = "0123456789abcdef01234567";
    if (c == &cli_command_fetch) argv[argc++] = "--out", argv[argc++] = folder;
    argv[argc] = NULL;
    return c->run(c, argc, argv);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (!listener) start();
    if (size < 2) return 0;
    char *text[2];
    size_t length[2];
    FILE *out = stdout, *err = stderr;
    mkdir(above, 0700);
    stdout = open_memstream(&text[0], &length[0]);
    stderr = open_memstream(&text[1], &length[1]);
    next = data + 1, end = data + size;
    int code = CLI_DONE;
    if (*data % 5 == 4) tell(data + 1, size - 1);
    else code = run(*data % 5);
    pthread_mutex_lock(&serving); /* the client may have heard enough before everything was said */
    next = end;
    pthread_mutex_unlock(&serving);
    fclose(stdout), fclose(stderr);
    stdout = out, stderr = err;
    FUZZ_EXPECT(code == CLI_DONE || (code >= CLI_USAGE && code <= CLI_INTERNAL));
    for (int i = 0; i < 2; i++) expect_harmless(text[i], length[i]), free(text[i]);
    clear_folder(folder);
    rmdir(folder);
    FUZZ_EXPECT(clear_folder(above) == 0); /* nothing left the folder */
    rmdir(above);
    return 0;
}
