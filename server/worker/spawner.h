/* The spawner: a small process that starts, kills and reaps the workers.
 *
 * It is forked before the daemon has any thread or database connection, for forking with SQLite open breaks its locks
 * and forking with threads leaves their mutexes locked. It stays single-threaded, and it lives exactly as long as the daemon:
 * when its socket reaches the end, it kills its workers, reaps them and exits. Until then it holds DATA/spawner.lock, so the
 * next daemon's spawner is ready only when no worker of the last one is left. It logs nothing: what it has to say are its reports, and the daemon
 * logs what comes of them, in the format and from the level that hold then. (Its copy of the log's settings is that of its fork.)
 *
 * What a worker gets: descriptor 0 /dev/null, 1 and 2 a pipe to the daemon, 3 the channel (worker_proto.h), 4 the input for reading,
 * 5 its file of parameters for reading, if the job has one and the stage is the first; nothing else is open. Its working directory is the attempt's own folder. It leads its own session, cannot gain
 * privileges, gets SIGKILL when the spawner dies, and has limits on address space, processor time, file size, open
 * files and core dumps. Arguments: --stage NAME --options JSON --memory BYTES --require-sandbox yes|no
 * --job ID --attempt N (the last two are for ps).
 */
#ifndef BW_SERVER_SPAWNER_H
#define BW_SERVER_SPAWNER_H

#include <stdbool.h>
#include <stdint.h>
#include <sys/types.h>

#include "base/status.h"

enum { BW_OPTIONS_TEXT = 1024 };

typedef struct {
    uint64_t token; /* names the worker in kills and reports; unique while the daemon lives */
    char job[32];
    int attempt;
    char stage[16];
    char options[BW_OPTIONS_TEXT]; /* canonical JSON */
    uint64_t memory, file_size;    /* bytes */
    int cpu_seconds;
    bool require_sandbox;
} bw_spawn;

/* Descriptors for the worker; `parameters` is -1 if it gets none. */
typedef struct {
    int channel, input, errors, folder, parameters;
} bw_spawn_files;

typedef struct {
    enum { BW_SPAWNER_READY, BW_WORKER_STARTED, BW_WORKER_EXITED } kind;
    uint64_t token;
    pid_t pid;       /* STARTED; -1 if it could not be started (EXITED follows all the same) */
    int wait_status; /* EXITED, as waitpid tells it */
    int64_t cpu_ms, peak_bytes;
} bw_spawn_report;

/* Forks the spawner; *socket is the daemon's end. Nothing may run in this process yet but main(). */
bw_status bw_spawner_start(const char *data, const char *worker, int *socket);
/* Waits until the workers of an earlier daemon are gone and the spawner is ready. BW_E_TIME after `seconds`. */
bw_status bw_spawner_wait_ready(int socket, int seconds);
/* Asks for a worker. The descriptors are copied, not taken. BW_E_IO if the spawner is gone. */
bw_status bw_spawner_spawn(int socket, const bw_spawn *spawn, const bw_spawn_files *files);
bw_status bw_spawner_kill(int socket, uint64_t token, int signal); /* to the worker's whole process group */
/* Reads one report without blocking. False: none there; *gone tells whether the spawner has died. */
bool bw_spawner_report(int socket, bw_spawn_report *report, bool *gone);

#endif
