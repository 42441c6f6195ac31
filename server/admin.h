/* What the operator of a daemon asks of it on its own machine: `blockwrightd token ...`, `blockwrightd owner ...`.
 *
 * A daemon that runs has the only writing connection to its database, so it is asked over DATA/control, a UNIX socket that only the
 * daemon's user can open (mode 0600 in a folder of mode 0700; the peer's user is checked as well). If no daemon runs, whoever asks takes
 * DATA/lock, opens the database and does itself what the daemon would do. Both ways run the same functions (admin_commands.c).
 *
 * On the socket: one request as a line of JSON, {"command": "token create", ...}, one answer as a line of JSON: {"error": "..."}
 * or what the command has to say.
 *
 * How to add a command: a row in bw_admin_commands[] (admin_commands.c) and whoever asks it, a row in commands[] (main.c).
 */
#ifndef BW_SERVER_ADMIN_H
#define BW_SERVER_ADMIN_H

#include <jansson.h>

#include <stdatomic.h>

#include "server/access.h"
#include "server/config.h"
#include "server/dispatch/dispatch.h"
#include "server/queue/queue.h"
#include "server/retention.h"

enum { BW_ADMIN_ERROR = 300 };

typedef struct {
    const bw_config *config;
    bw_store *store;
    bw_queue *queue;
    bw_access *access;
    bw_retention *retention;
    bw_dispatch *dispatch;       /* NULL: no daemon runs */
    const atomic_bool *stopping; /* set when the daemon stops: what takes long ends then (queue/backup.h). Of bw_admin_start */
} bw_admin_services;             /* borrowed */

typedef struct {
    const char *name;
    /* A new object, or NULL and why not. */
    json_t *(*run)(const bw_admin_services *services, const json_t *request, char error[BW_ADMIN_ERROR]);
} bw_admin_command;
extern const bw_admin_command bw_admin_commands[]; /* ends with a name NULL */

typedef struct bw_admin bw_admin;

/* Listens on DATA/control in a thread of its own. */
bw_status bw_admin_start(const char *data, const bw_admin_services *services, bw_admin **admin);
void bw_admin_stop(bw_admin *admin); /* what is being done is ended soon, and who asked for it told; NULL allowed */

/* Asks the daemon of config->data, or does it in its stead, with these settings. Takes `request`. NULL: `error` tells why. */
json_t *bw_admin_ask(const bw_config *config, json_t *request, char error[BW_ADMIN_ERROR]);

#endif
