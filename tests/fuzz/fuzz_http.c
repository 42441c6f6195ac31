/* The daemon's HTTP side on arbitrary requests: a real listener on loopback with a real store and queue in memory, no workers. The input is
 * what a client sends on one connection. An answer of ours must be whole: a status the document knows, and JSON where it says JSON. */
#include "fuzz.h"

#include <arpa/inet.h>
#include <jansson.h>
#include <poll.h>
#include <signal.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include "server/files.h"
#include "server/http/http.h"

enum { ANSWER_MOST = 1 << 20, PATIENCE_MS = 20 };

static bw_config config = {.host_names = "x", .max_connections = 64, .max_connections_per_address = 64, .header_timeout_ms = 5000, .body_timeout_ms = 5000, .max_upload = 1 << 16, .stage_memory = 1 << 20, .stage_output = 1 << 20, .worker = "/bin/true", .probe_interval_ms = 10000};
static struct sockaddr_in address = {.sin_family = AF_INET};
static char folder[64];

static void remove_folder(void) { bw_remove_tree(folder); }

static void start(void) {
    static bw_services services = {.config = &config};
    static bw_http *http;
    char text[96], path[96];
    int pair[2];
    signal(SIGPIPE, SIG_IGN);
    snprintf(folder, sizeof folder, "/dev/shm/bw-fuzz-http-%ld", (long)getpid());
    snprintf(config.data, sizeof config.data, "%s", folder);
    snprintf(path, sizeof path, "%s/jobs.db", folder);
    mkdir(folder, 0700);
    struct sockaddr_in any = {.sin_family = AF_INET};
    any.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    memcpy(&config.listen, &any, sizeof any);
    config.listen_size = sizeof any;
    FUZZ_EXPECT(socketpair(AF_UNIX, SOCK_SEQPACKET, 0, pair) == 0); /* a spawner that is never asked: there are no workers */
    FUZZ_EXPECT(bw_store_open(folder, &services.store) == BW_OK && bw_queue_open(path, &services.queue) == BW_OK);
    FUZZ_EXPECT(bw_watch_open(&services.watch) == BW_OK && bw_access_open(services.queue, &services.access) == BW_OK);
    FUZZ_EXPECT(bw_dispatch_start(&config, services.store, services.queue, services.watch, pair[0], eventfd(0, 0), &services.dispatch) == BW_OK);
    FUZZ_EXPECT(bw_health_start(&config, services.store, services.queue, services.dispatch, &services.health) == BW_OK);
    FUZZ_EXPECT(bw_http_start(&services, &http, text, sizeof text) == BW_OK);
    address.sin_addr = any.sin_addr;
    address.sin_port = htons((uint16_t)atoi(strrchr(text, ':') + 1));
    atexit(remove_folder);
}

/* Sends everything, says that no more comes, and reads until the daemon hangs up or has nothing to say for a while. */
static size_t talk(const uint8_t *data, size_t size, char *answer) {
    size_t n = 0;
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    FUZZ_EXPECT(fd >= 0 && connect(fd, (struct sockaddr *)&address, sizeof address) == 0);
    struct linger hard = {1, 0}; /* no TIME_WAIT, or the ports run out */
    setsockopt(fd, SOL_SOCKET, SO_LINGER, &hard, sizeof hard);
    while (size) {
        ssize_t sent = send(fd, data, size, MSG_NOSIGNAL);
        if (sent <= 0) break;
        data += sent, size -= (size_t)sent;
    }
    shutdown(fd, SHUT_WR);
    struct pollfd wait = {fd, POLLIN, 0};
    while (n < ANSWER_MOST && poll(&wait, 1, PATIENCE_MS) > 0) {
        ssize_t got = recv(fd, answer + n, ANSWER_MOST - n, 0);
        if (got <= 0) break;
        n += (size_t)got;
    }
    close(fd);
    answer[n] = 0;
    return n;
}

static bool known_status(long status) {
    if (status == 100 || status == 200 || status == 201 || status == 304) return true;
    for (int i = 0; i < BW_PROBLEM_COUNT; i++)
        if (bw_problem_types[i].http == status) return true;
    return false;
}

/* The first of the answers, if it is whole. What the library says by itself (no JSON) is its own affair. */
static void expect_sane(const char *answer, size_t size) {
    long status = 0;
    const char *body = strstr(answer, "\r\n\r\n"), *length = strcasestr(answer, "\r\nContent-Length: ");
    FUZZ_EXPECT(sscanf(answer, "HTTP/1.%*d %ld", &status) == 1);
    bool json = body && memmem(answer, (size_t)(body - answer), "json", 4);
    if (!json || !length || length > body) return;
    FUZZ_EXPECT(known_status(status));
    size_t bytes = strtoull(length + 18, NULL, 10);
    body += 4;
    if (bytes == 0 || bytes > size - (size_t)(body - answer)) return; /* HEAD, or cut */
    json_t *value = json_loadb(body, bytes, JSON_REJECT_DUPLICATES, NULL);
    if (!value) return; /* the body of a HEAD is that of the next answer */
    if (status >= 400) FUZZ_EXPECT(json_is_string(json_object_get(value, "type")) && json_integer_value(json_object_get(value, "status")) == status);
    json_decref(value);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static char answer[ANSWER_MOST + 1];
    if (!folder[0]) start();
    if (!size || size > 70000) return 0;
    size_t n = talk(data, size, answer);
    if (n) expect_sane(answer, n);
    return 0;
}
