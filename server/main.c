/* blockwrightd. Order of things: read the configuration, fork the spawner, take the data folder, open the store and the
 * queue, put right what an earlier daemon left, start the dispatcher, then HTTP. It stops in the opposite order.
 *
 * Signals, all of them read in watch():
 *     SIGTERM, SIGINT   drain: no stage is begun any more, running ones have stop-grace to end and are then given back to the queue;
 *                       meanwhile requests are answered and /readyz says no. A second one ends the grace.
 *     SIGHUP            the configuration is read again and what is reloadable is taken over
 * Exit codes: 0 after an orderly stop, 2 after a mistake in the configuration, 5 when the daemon could not start or go on.
 */
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/signalfd.h>
#include <sys/stat.h>
#include <unistd.h>

#include "server/access.h"
#include "server/admin.h"
#include "server/clock.h"
#include "server/commands.h"
#include "server/config.h"
#include "server/dispatch/dispatch.h"
#include "server/files.h"
#include "server/health.h"
#include "server/http/http.h"
#include "server/log.h"
#include "server/notify.h"
#include "server/queue/queue.h"
#include "server/retention.h"
#include "server/store.h"
#include "server/watch.h"
#include "server/worker/spawner.h"

enum { SPAWNER_WAIT_SECONDS = 20, DRAIN_LOOK_MS = 20 };

static bw_config config;
static char **command_line; /* of serve, whole; to read it again */
static int command_words;
static bw_http *http; /* NULL until it listens */

/* One daemon per data folder; the lock goes with the process, however it ends. */
static bw_status take_folder(void) {
    char path[PATH_MAX];
    snprintf(path, sizeof path, "%s/lock", config.data);
    if (bw_lock_file(path) >= 0) return BW_OK;
    bw_event(BW_ERROR, "data.busy", "path=%s", path);
    fprintf(stderr, "blockwrightd: another daemon uses %s\n", config.data);
    return BW_E_IO;
}

/* One that was there keeps the rights that the operator has given it. What is in it has its own (main), but not what others put there. */
static void warn_about_folder(void) {
    struct stat info;
    if (stat(config.data, &info) != 0 || !(info.st_mode & 077)) return;
    char quoted[PATH_MAX];
    bw_event(BW_WARN, "data.open", "mode=%04o advice=\"others may enter, list or change it; chmod 0700 keeps them out\" path=%s",
             (unsigned)info.st_mode & 07777, bw_quoted(config.data, quoted, sizeof quoted));
}

/* An address that others reach is for daemons with tokens. */
static bw_status check_open(bw_access *access) {
    if (bw_config_is_loopback(&config) || !bw_access_is_open(access)) return BW_OK;
    bw_event(BW_ERROR, "access.open", "data=%s", config.data);
    fprintf(stderr, "blockwrightd: refusing to listen on other than loopback: without access tokens everybody who reaches that address could use the "
                    "daemon. Make one first: blockwrightd token create --data %s --owner NAME\n", config.data);
    return BW_E_USAGE;
}

/* 2: the configuration is at fault, as the log says. */
static int exit_code(bw_status status) { return status == BW_OK ? 0 : status == BW_E_USAGE ? 2 : 5; }

static bw_status announce(const char *address) {
    char path[PATH_MAX], line[128];
    snprintf(path, sizeof path, "%s/address", config.data);
    int n = snprintf(line, sizeof line, "%s\n", address);
    bw_event(BW_INFO, "daemon.listening", "address=%s workers=%d pid=%d", address, (int)config.workers, (int)getpid());
    return bw_write_file(path, line, (size_t)n);
}

/* ---- configuration ---- */

static void configure_log(const bw_config *c) { bw_log_configure((bw_level)c->log_level, (bw_log_format)c->log_format); }

static void warn_about_environment(void) {
    char quoted[120];
    const char *variable;
    for (size_t i = 0; (variable = bw_config_stray_variable(i)); i++) {
        char name[96];
        snprintf(name, sizeof name, "%.*s", (int)strcspn(variable, "="), variable);
        bw_event(BW_WARN, "config.unknown_variable", "name=%s", bw_quoted(name, quoted, sizeof quoted));
    }
}

static void tell_change(const bw_setting *setting, const char *value, bool applied) {
    char quoted[300];
    bw_event(applied ? BW_INFO : BW_WARN, applied ? "config.changed" : "config.needs_restart", "name=%s value=%s", setting->name,
             bw_quoted(value, quoted, sizeof quoted));
}

/* A copy of the command line, for reading it takes it apart. NULL if out of memory. */
static char **copy_words(void) {
    char **words = malloc(((size_t)command_words + 1) * sizeof *words);
    if (words) memcpy(words, command_line, ((size_t)command_words + 1) * sizeof *words);
    return words;
}

static bool read_configuration(bw_config *to, bw_ask *ask, char error[BW_CONFIG_ERROR]) {
    int words = command_words;
    char **copy = copy_words();
    bool good = copy && bw_config_load(to, &words, copy, false, ask, error);
    if (!copy) snprintf(error, BW_CONFIG_ERROR, "out of memory");
    free(copy);
    return good;
}

static void reload(void) {
    static bw_config fresh;
    char error[BW_CONFIG_ERROR], quoted[BW_CONFIG_ERROR + 100];
    bw_ask ask;
    bw_notify_reloading();
    if (read_configuration(&fresh, &ask, error)) {
        bw_config_reload(&config, &fresh, tell_change);
        configure_log(&config);
        if (http) bw_http_reload(http);
        bw_event(BW_INFO, "config.reloaded", "file=%s", bw_quoted(config.file, quoted, sizeof quoted));
    } else {
        bw_event(BW_ERROR, "config.rejected", "error=%s", bw_quoted(error, quoted, sizeof quoted));
    }
    bw_notify("READY=1");
}

/* ---- until the end ---- */

typedef enum { NOTHING, STOP, RELOAD, FATAL } occasion;

/* Waits for a signal or for the dispatcher's end, for `timeout` ms at most (-1: for ever). */
static occasion watch(int signals, int fatal, int64_t timeout) {
    struct pollfd fds[2] = {{signals, POLLIN, 0}, {fatal, POLLIN, 0}};
    struct signalfd_siginfo info;
    if (poll(fds, 2, (int)timeout) < 0 && errno != EINTR) return FATAL;
    if (fds[1].revents) return FATAL;
    if (!fds[0].revents || read(signals, &info, sizeof info) != sizeof info) return NOTHING;
    return info.ssi_signo == SIGHUP ? RELOAD : STOP;
}

/* Tells systemd that the daemon lives, if the dispatcher has gone round its loop since it was last asked to. */
static void pat_watchdog(bw_dispatch *dispatch) {
    static uint64_t turns = UINT64_MAX;
    uint64_t now = bw_dispatch_turns(dispatch);
    if (now != turns) bw_notify("WATCHDOG=1");
    turns = now;
    bw_dispatch_wake(dispatch);
}

/* Serves until it is to stop (BW_OK) or cannot go on (BW_E_INTERNAL). */
static bw_status run(int signals, int fatal, bw_dispatch *dispatch) {
    int64_t watchdog = bw_notify_watchdog_ms(), pat = bw_mono_ms();
    bw_notify("READY=1");
    for (;;) {
        int64_t now = bw_mono_ms();
        if (watchdog && now >= pat) pat_watchdog(dispatch), pat = now + watchdog;
        switch (watch(signals, fatal, watchdog ? pat - now : -1)) {
        case NOTHING: break;
        case STOP: return BW_OK;
        case RELOAD: reload(); break;
        case FATAL: return BW_E_INTERNAL;
        }
    }
}

/* Lets running stages end, as long as the grace lasts. */
static bw_status drain(int signals, int fatal, bw_dispatch *dispatch) {
    int64_t watchdog = bw_notify_watchdog_ms(), start = bw_mono_ms(), pat = start;
    int grace = config.stop_grace_ms;
    bw_notify("STOPPING=1");
    bw_event(BW_INFO, "daemon.draining", "grace_ms=%d", grace);
    bw_dispatch_drain(dispatch);
    for (int64_t now = start; now < start + grace && bw_dispatch_running(dispatch); now = bw_mono_ms()) {
        if (watchdog && now >= pat) pat_watchdog(dispatch), pat = now + watchdog;
        switch (watch(signals, fatal, DRAIN_LOOK_MS)) {
        case NOTHING: break;
        case STOP: return BW_OK;
        case RELOAD: reload(); break;
        case FATAL: return BW_E_INTERNAL;
        }
    }
    return BW_OK;
}

static bw_status serve_until_stopped(int signals, int fatal, bw_dispatch *dispatch) {
    bw_status status = run(signals, fatal, dispatch);
    if (status == BW_OK) status = drain(signals, fatal, dispatch);
    bw_event(BW_INFO, "daemon.stopping", "reason=%s", status == BW_OK ? "signal" : "fatal");
    return status;
}

static int block_signals(void) {
    sigset_t set;
    sigemptyset(&set);
    sigaddset(&set, SIGTERM);
    sigaddset(&set, SIGINT);
    sigaddset(&set, SIGHUP);
    sigprocmask(SIG_BLOCK, &set, NULL);
    signal(SIGPIPE, SIG_IGN);
    return signalfd(-1, &set, SFD_CLOEXEC);
}

/* Else SQLite's journals of statements and its sorts go where TMPDIR says. It asks once, so this is before its first connection. */
static bw_status keep_temporaries_inside(void) {
    char folder[sizeof config.data + 8];
    snprintf(folder, sizeof folder, "%s/tmp", config.data);
    return setenv("SQLITE_TMPDIR", folder, 1) == 0 ? BW_OK : BW_E_MEMORY;
}

static bw_status serve(int spawner) {
    char database[PATH_MAX], address[96];
    bw_services services = {.config = &config};
    bw_admin *admin = NULL;
    bw_retention *retention = NULL;
    int signals = block_signals(), fatal = eventfd(0, EFD_CLOEXEC);
    const char *what = "data folder";
    bw_status status = signals < 0 || fatal < 0 ? BW_E_IO : take_folder();
    snprintf(database, sizeof database, "%s/jobs.db", config.data);
    if (status == BW_OK) what = "spawner", status = bw_spawner_wait_ready(spawner, SPAWNER_WAIT_SECONDS);
    if (status == BW_OK) what = "store", status = bw_store_open(config.data, &services.store);
    if (status == BW_OK) status = keep_temporaries_inside();
    if (status == BW_OK) what = "queue", status = bw_queue_open(database, &services.queue);
    if (status == BW_OK) what = "recovery", status = bw_reconcile(services.store, services.queue, bw_now_ms());
    if (status == BW_OK) what = "access tokens", status = bw_access_open(services.queue, &services.access);
    if (status == BW_OK) status = check_open(services.access);
    if (status == BW_OK) what = "retention", status = bw_retention_open(&config, services.store, services.queue, &retention);
    if (status == BW_OK) what = "watch", status = bw_watch_open(&services.watch);
    if (status == BW_OK)
        what = "dispatcher", status = bw_dispatch_start(&config, services.store, services.queue, services.watch, spawner,
                                                        fatal, &services.dispatch);
    if (status == BW_OK)
        what = "health", status = bw_health_start(&config, services.store, services.queue, services.dispatch, &services.health);
    if (status == BW_OK) {
        const bw_admin_services offered = {.config = &config, .store = services.store, .queue = services.queue, .access = services.access,
                                           .retention = retention, .dispatch = services.dispatch};
        what = "DATA/control", status = bw_admin_start(config.data, &offered, &admin);
    }
    if (status == BW_OK) what = "retention", status = bw_retention_begin(retention);
    if (status == BW_OK) what = "listening", status = bw_http_start(&services, &http, address, sizeof address);
    if (status == BW_OK) what = "address file", status = announce(address);
    if (status == BW_OK) what = "serving", status = serve_until_stopped(signals, fatal, services.dispatch);
    if (status != BW_OK) bw_event(BW_ERROR, "daemon.failed", "what=\"%s\" status=%d", what, (int)status);
    bw_http_stop(http);
    bw_health_stop(services.health);
    bw_retention_stop(retention); /* a backup waits for the end of a pass */
    bw_admin_stop(admin);
    bw_dispatch_stop(services.dispatch);
    bw_watch_close(services.watch);
    bw_retention_close(retention);
    bw_access_close(services.access);
    bw_queue_close(services.queue);
    bw_store_close(services.store);
    bw_event(BW_INFO, "daemon.stopped", "code=%d", exit_code(status));
    return status;
}

/* ---- commands ---- */

typedef struct {
    const char *name, *help;
    int (*run)(int argc, char **argv); /* argv[0] is the command's name; the exit code */
} command;

static int help(void);

static int complain(const char *error) {
    fprintf(stderr, "blockwrightd: %s\nblockwrightd: try --help\n", error);
    return 2;
}

static int check(void) {
    const char *variable;
    for (size_t i = 0; (variable = bw_config_stray_variable(i)); i++)
        fprintf(stderr, "blockwrightd: the variable %.*s belongs to no setting\n", (int)strcspn(variable, "="), variable);
    bw_config_print(&config, stdout);
    return 0;
}

static int serve_command(int argc, char **argv) {
    char error[BW_CONFIG_ERROR];
    bw_ask ask;
    int spawner;
    command_words = argc;
    command_line = argv;
    if (!read_configuration(&config, &ask, error)) return complain(error);
    if (ask == BW_ASK_HELP) return help();
    if (ask == BW_ASK_VERSION) return printf("blockwrightd %s\n", BW_VERSION) < 0;
    if (ask == BW_ASK_CHECK) return check();
    if (!bw_config_make_data(&config, error)) return complain(error);
    configure_log(&config);
    warn_about_environment();
    warn_about_folder();
    if (bw_spawner_start(config.data, config.worker, &spawner) != BW_OK) {
        bw_event(BW_ERROR, "daemon.failed", "what=spawner errno=%d", errno);
        return 5;
    }
    return exit_code(serve(spawner));
}

/* How to add a command: a function and a row here. What it has in common with the daemon (--data and all else) bw_config_load with
 * `others` takes out of its words. */
static const command commands[] = {
    {"serve", "the daemon; also what runs without a command", serve_command},
    {"backup", "copies everything while the daemon runs; see backup --help", bw_command_backup},
    {"restore", "makes a data folder of a backup; see restore --help", bw_command_restore},
    {"gc", "removes what is old or too much, now, or tells what would go; see gc --help", bw_command_gc},
    {"token", "access tokens: token create, token list, token revoke; see token --help", bw_command_token},
    {"owner", "limits of owners: owner set, owner list; see owner --help", bw_command_owner},
};
enum { COMMANDS = sizeof commands / sizeof *commands };

static int help(void) {
    printf("blockwrightd - decomposes parametrized tet meshes and hexahedral meshes into blocks, over HTTP\n\n"
           "  blockwrightd [COMMAND] --data DIR [--NAME VALUE]...\n\nCommands:\n");
    for (int i = 0; i < COMMANDS; i++) printf("  %-10s %s\n", commands[i].name, commands[i].help);
    printf("\nSettings (* is taken over by SIGHUP):\n");
    bw_config_print_help(stdout);
    printf("    --check-config           prints the values in effect and where they come from; 0 if they make sense, else 2\n"
           "    --version, --help\n"
           "\n"
           "Each can also be given as BLOCKWRIGHT_NAME in the environment (BLOCKWRIGHT_STAGE_MEMORY=8G) or as \"name = value\" in the\n"
           "file of --config. The command line wins over the environment, and that over the file. SIZE is in bytes, or with K, M, G, T in\n"
           "powers of 1024; TIME in seconds, or with ms, s, m, h, d.\n"
           "\n"
           "SIGTERM: no stage is begun any more, running ones have --stop-grace, then they are given back to the queue; a second one ends\n"
           "the grace. SIGHUP reads file and environment again. Nothing accepted is lost whichever way the daemon ends. Exit codes: 0\n"
           "stopped in order, 2 a mistake in the configuration, 5 it could not start or go on. Log: one line per event on stderr.\n"
           "\n"
           "Try it:\n"
           "  blockwrightd --data /tmp/bw &\n"
           "  h=$(sha256sum part.hexex | cut -d' ' -f1)\n"
           "  curl -T part.hexex http://127.0.0.1:8080/v1/blobs/$h\n"
           "  curl -H 'Content-Type: application/json' -d '{\"input\":\"'$h'\"}' http://127.0.0.1:8080/v1/jobs\n"
           "  curl http://127.0.0.1:8080/v1/jobs\n"
           "Hex meshes of jobs, in a browser: http://127.0.0.1:8080/\n"
           "The whole interface: curl http://127.0.0.1:8080/openapi.json\n");
    return 0;
}

static int unknown_command(const char *word) {
    fprintf(stderr, "blockwrightd: there is no command '%.60s'\nblockwrightd: try --help\n", word);
    return 2;
}

int main(int argc, char **argv) {
    umask(077); /* a data folder that was there may be open to others: what is in it is not */
    if (argc < 2 || *argv[1] == '-') return serve_command(argc, argv);
    for (int i = 0; i < COMMANDS; i++)
        if (strcmp(argv[1], commands[i].name) == 0) return commands[i].run(argc - 1, argv + 1);
    return unknown_command(argv[1]);
}
