/* Steps that several of the commands which talk to a daemon share. */
#ifndef BW_CLI_REMOTE_H
#define BW_CLI_REMOTE_H

#include <jansson.h>
#include <stdbool.h>

#include "command.h"
#include "http.h"

/* Options of every remote command, whose settings have a member `remote`. */
#define CLI_REMOTE_OPTIONS(settings)                                                                         \
    {"server", 's', CLI_TEXT, offsetof(settings, remote.server), "URL",                                      \
     "the daemon (default $BLOCKWRIGHT_SERVER or http://127.0.0.1:8080)", 0, 0},                             \
    {"token-file", 0, CLI_TEXT, offsetof(settings, remote.token_file), "FILE",                               \
     "file with the access token, if the daemon wants one (default $BLOCKWRIGHT_TOKEN, the token)", 0, 0},   \
    {"ca-file", 0, CLI_TEXT, offsetof(settings, remote.ca_file), "FILE",                                     \
     "certificates to trust for https, as PEM (default $BLOCKWRIGHT_CA_FILE or the system's)", 0, 0}

/* Follows a job until it has ended, showing its progress. A daemon that is restarted meanwhile is waited for
 * (half a minute). Returns the exit code of the job's end; the reason of a failure is on standard error. */
int cli_watch(cli_http *http, const char *id, bool quiet);
/* Downloads every result of a successful job into the folder `out` (made if missing), each verified against
 * the manifest's SHA-256 before it takes its place. Returns an exit code; errors are on standard error. */
int cli_fetch(cli_http *http, const char *id, const char *out, bool quiet);

/* Is the operand a job id? If not, complains. */
bool cli_check_id(const cli_command *self, const char *id);
/* A member that is a string; "" if it is none. */
const char *cli_text_of(const json_t *object, const char *key);

/* A command whose only operand is a job's id and whose only option is the daemon: its settings, and all of it but what it does. */
typedef struct {
    cli_remote remote;
} cli_job_settings;
int cli_run_on_job(const cli_command *self, int argc, char **argv, int (*act)(cli_http *http, const char *id));
/* The same of a command without operands, whose settings begin with a cli_remote. */
int cli_run_on_daemon(const cli_command *self, int argc, char **argv, void *settings, int (*act)(cli_http *http, const void *settings));

/* Asks for something of a job (POST /v1/jobs/ID/VERB), and prints its id and state, or `pending` in the state's place if that member of the
 * answer is true (NULL: there is no such member). Returns the exit code. */
int cli_ask_of_job(cli_http *http, const char *id, const char *verb, const char *pending);

#endif
