/* blockwrightd. Order of things: read the command line, fork the spawner, take the data folder, open the store and the
 * queue, put right what an earlier daemon left, start the dispatcher, then HTTP. It stops in the opposite order. */
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/file.h>
#include <sys/signalfd.h>
#include <unistd.h>

#include "server/clock.h"
#include "server/config.h"
#include "server/dispatch.h"
#include "server/files.h"
#include "server/http/http.h"
#include "server/log.h"
#include "server/queue.h"
#include "server/store.h"
#include "server/watch.h"
#include "server/worker/spawner.h"

enum { SPAWNER_WAIT_SECONDS = 20 };

/* One daemon per data folder; the lock goes with the process, however it ends. */
static bw_status take_folder(const bw_config *config) {
    char path[PATH_MAX];
    snprintf(path, sizeof path, "%s/lock", config->data);
    int fd = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    if (fd >= 0 && flock(fd, LOCK_EX | LOCK_NB) == 0) return BW_OK;
    bw_event(BW_ERROR, "data.busy", "path=%s", path);
    fprintf(stderr, "blockwrightd: another daemon uses %s\n", config->data);
    return BW_E_IO;
}

static bool has_row(void *user, const char *key) {
    bool found = true;
    return bw_queue_output(user, key, &found, NULL) != BW_OK || found; /* in doubt it stays */
}

static bool has_file(void *user, const char *key) { return bw_store_has_cached(user, key); }

/* Cache entries and rows must come in pairs; attempts left open have no worker any more. */
static bw_status put_right(bw_store *store, bw_queue *queue) {
    int dropped = 0, forgotten = 0, recovered = 0;
    bw_status status = bw_store_sweep_cache(store, has_row, queue, &dropped);
    if (status == BW_OK) status = bw_queue_sweep_outputs(queue, has_file, store, &forgotten);
    if (status == BW_OK) status = bw_queue_recover(queue, bw_now_ms(), &recovered);
    bw_event(BW_INFO, "daemon.recovered", "interrupted=%d cache_dropped=%d cache_forgotten=%d", recovered, dropped,
             forgotten);
    return status;
}

static bw_status announce(const bw_config *config, const char *address) {
    char path[PATH_MAX], line[128];
    snprintf(path, sizeof path, "%s/address", config->data);
    int n = snprintf(line, sizeof line, "%s\n", address);
    bw_event(BW_INFO, "daemon.listening", "address=%s workers=%d pid=%d", address, config->workers, (int)getpid());
    return bw_write_file(path, line, (size_t)n);
}

/* Waits for SIGTERM, SIGINT (BW_OK) or for the dispatcher's end (BW_E_INTERNAL). */
static bw_status wait_for_end(int signals, int fatal) {
    struct pollfd fds[2] = {{signals, POLLIN, 0}, {fatal, POLLIN, 0}};
    while (poll(fds, 2, -1) < 0 && errno == EINTR) continue;
    bw_event(BW_INFO, "daemon.stopping", "reason=%s", fds[1].revents ? "fatal" : "signal");
    return fds[1].revents ? BW_E_INTERNAL : BW_OK;
}

static int block_signals(void) {
    sigset_t set;
    sigemptyset(&set);
    sigaddset(&set, SIGTERM);
    sigaddset(&set, SIGINT);
    sigprocmask(SIG_BLOCK, &set, NULL);
    signal(SIGPIPE, SIG_IGN);
    return signalfd(-1, &set, SFD_CLOEXEC);
}

static bw_status serve(const bw_config *config, int spawner) {
    char database[PATH_MAX], address[96];
    bw_services services = {.config = config};
    bw_http *http = NULL;
    int signals = block_signals(), fatal = eventfd(0, EFD_CLOEXEC);
    const char *what = "data folder";
    bw_status status = signals < 0 || fatal < 0 ? BW_E_IO : take_folder(config);
    snprintf(database, sizeof database, "%s/jobs.db", config->data);
    if (status == BW_OK) what = "spawner", status = bw_spawner_wait_ready(spawner, SPAWNER_WAIT_SECONDS);
    if (status == BW_OK) what = "store", status = bw_store_open(config->data, &services.store);
    if (status == BW_OK) what = "queue", status = bw_queue_open(database, &services.queue);
    if (status == BW_OK) what = "recovery", status = put_right(services.store, services.queue);
    if (status == BW_OK) what = "watch", status = bw_watch_open(&services.watch);
    if (status == BW_OK)
        what = "dispatcher", status = bw_dispatch_start(config, services.store, services.queue, services.watch, spawner,
                                                        fatal, &services.dispatch);
    if (status == BW_OK) what = "listening", status = bw_http_start(&services, &http, address, sizeof address);
    if (status == BW_OK) what = "address file", status = announce(config, address);
    if (status == BW_OK) what = "serving", status = wait_for_end(signals, fatal);
    if (status != BW_OK) bw_event(BW_ERROR, "daemon.failed", "what=\"%s\" status=%d", what, (int)status);
    bw_http_stop(http);
    bw_dispatch_stop(services.dispatch);
    bw_watch_close(services.watch);
    bw_queue_close(services.queue);
    bw_store_close(services.store);
    bw_event(BW_INFO, "daemon.stopped", "code=%d", status == BW_OK ? 0 : 5);
    return status;
}

int main(int argc, char **argv) {
    static bw_config config;
    int spawner, code = bw_config_parse(&config, argc, argv);
    if (code >= 0) return code;
    if (bw_spawner_start(config.data, config.worker, &spawner) != BW_OK) {
        bw_event(BW_ERROR, "daemon.failed", "what=spawner errno=%d", errno);
        return 5;
    }
    return serve(&config, spawner) == BW_OK ? 0 : 5;
}
