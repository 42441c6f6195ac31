/* Configuration: one table of settings, each of which can be given in three ways.
 *
 *     --name VALUE, --name=VALUE      on the command line; the last one counts
 *     BLOCKWRIGHT_NAME                in the environment, in capitals, '-' written as '_'
 *     name = value                    in the file that --config or BLOCKWRIGHT_CONFIG names
 *
 * Invariants
 *  1. The command line wins over the environment, the environment over the file, the file over the default. What is overridden is
 *     checked all the same.
 *  2. A bad value, an unknown flag or an unknown name in the file is a mistake that names its place and, if there is one, the known
 *     name that is nearest. Variables of the environment that belong to nothing are only warned about: others may have set them.
 *  3. What bw_config_print writes is a file that gives the same values again.
 *  4. Numbers and choices are atomic: bw_config_reload changes those of the reloadable settings while other threads read them.
 *     Whoever needs one twice in a decision reads it once. Everything else is constant after bw_config_load.
 *
 * How to add a setting: a field below, a row in bw_settings[] (settings.c), a line in CHANGELOG.md. Flag, variable, file, --help and
 * --check-config follow from the row.
 */
#ifndef BW_SERVER_CONFIG_H
#define BW_SERVER_CONFIG_H

#include <limits.h>
#include <netinet/in.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <sys/socket.h>

enum { BW_SETTINGS_MOST = 96, BW_CONFIG_ERROR = 700, BW_VALUE_TEXT = PATH_MAX };

typedef enum { BW_FROM_DEFAULT, BW_FROM_FILE, BW_FROM_ENVIRONMENT, BW_FROM_FLAG } bw_source;

typedef struct {
    bw_source source;
    int line; /* of the file */
} bw_origin;

typedef struct {
    char file[PATH_MAX];            /* --config, as given; "": none */
    char data[PATH_MAX - 256];      /* absolute; made by bw_config_make_data */
    char worker[PATH_MAX];          /* the worker program, absolute */
    struct sockaddr_storage listen; /* not loopback: only with a certificate, or behind a proxy */
    socklen_t listen_size;
    char tls_certificate[PATH_MAX], tls_key[PATH_MAX]; /* both or none; PEM */
    char behind_proxy[1024]; /* networks.h; whom X-Forwarded-For is believed, and without a certificate who may connect */
    char host_names[1024]; /* names in Host that are taken as this daemon's, besides those of loopback; commas between them */
    atomic_int workers;                /* stages that run at the same time */
    atomic_int max_connections, max_connections_per_address;
    atomic_int header_timeout_ms, body_timeout_ms; /* http/guard.h */
    atomic_int max_uploads, upload_keep_seconds; /* partial.h */
    _Atomic uint64_t max_upload;       /* bytes of one blob */
    _Atomic uint64_t stage_memory;     /* bytes a stage may take */
    _Atomic uint64_t stage_output;     /* bytes of one file a stage may write */
    _Atomic uint64_t stage_scratch;    /* bytes of all files of a stage together */
    _Atomic uint64_t memory;           /* bytes that the stages that run may need together */
    atomic_int stage_cpu_seconds, stage_wall_seconds;
    atomic_int job_cpu_seconds, job_wall_seconds; /* of all stages of a job together. 0: no limit */
    atomic_int cancel_grace_ms; /* from SIGTERM to SIGKILL for a cancelled stage */
    atomic_int require_sandbox; /* 1: no job is started in less than the whole sandbox */
    /* Of one owner: jobs that have not ended; stages, uploads, streams at the same time. 0: any number */
    atomic_int owner_jobs, owner_running, owner_uploads, owner_streams;
    atomic_int owner_rate; /* requests a second; http/rate.h. 0: any number */
    _Atomic uint64_t owner_bytes;         /* of the blobs that an owner has. 0: any number */
    atomic_int stream_comment_ms; /* http/stream.h */
    atomic_int keep_finished_seconds, keep_failed_seconds, keep_gone_seconds, keep_keys_seconds, keep_blobs_seconds; /* 0: for ever */
    atomic_int retention_interval_seconds;
    _Atomic uint64_t cache_size; /* bytes of stage outputs; 0: any number */
    atomic_int stop_grace_ms; /* how long running stages may go on after SIGTERM */
    atomic_int log_level, log_format, log_requests; /* log.h, http/account.c */
    atomic_int probe_interval_ms;                   /* from here on: health.h */
    _Atomic uint64_t ready_disk_warn, ready_disk_fail; /* bytes */
    atomic_int ready_fsync_warn_ms, ready_fsync_fail_ms;
    atomic_int ready_queue_warn_seconds, ready_queue_fail_seconds; /* 0: never */
    bw_origin origins[BW_SETTINGS_MOST]; /* by index in bw_settings; read and written by the main thread only */
} bw_config;

typedef enum {
    BW_SETTING_COUNT,    /* atomic_int: a whole number */
    BW_SETTING_SIZE,     /* uint64: bytes, or with K, M, G, T in powers of 1024 */
    BW_SETTING_DURATION, /* atomic_int in units of unit_ms: seconds, or with ms, s, m, h, d */
    BW_SETTING_CHOICE,   /* atomic_int: index among the words of `choices` */
    BW_SETTING_ADDRESS,  /* sockaddr_storage: ADDRESS:PORT, numeric or localhost, IPv6 in brackets */
    BW_SETTING_PATH,     /* char[room] */
    BW_SETTING_NAMES,    /* char[room]: names of hosts, commas between them */
    BW_SETTING_NETWORKS  /* char[room]: as bw_networks_parse wants it */
} bw_setting_type;

typedef struct {
    const char *name;
    bw_setting_type type;
    size_t offset, room;
    int64_t low, high;    /* of COUNT, SIZE in bytes, DURATION in units */
    int unit_ms;          /* of DURATION */
    const char *choices;  /* of CHOICE: words with one blank between them */
    const char *standard; /* the default, written as in the file; NULL: there is none, or bw_setting_default finds it */
    bool reloadable;
    const char *value, *help; /* for --help */
} bw_setting;

extern const bw_setting bw_settings[];
extern const size_t bw_setting_count;

/* The setting's index, or -1. `name` need not end at `length`. */
int bw_setting_find(const char *name, size_t length);
/* The nearest known name by edits, if it is near enough to be meant; else NULL. */
const char *bw_setting_nearest(const char *name, size_t length);
/* The default as text; "" if there is none. */
const char *bw_setting_default(const bw_setting *setting, char text[BW_VALUE_TEXT]);
/* Sets the field. False: `error` tells why, without the place. */
bool bw_setting_parse(const bw_setting *setting, bw_config *config, const char *text, char *error, size_t size);
/* The value as it would be written, in its shortest form. Returns text. */
char *bw_setting_text(const bw_setting *setting, const bw_config *config, char text[BW_VALUE_TEXT]);

typedef enum { BW_ASK_RUN, BW_ASK_CHECK, BW_ASK_HELP, BW_ASK_VERSION } bw_ask;

/* Reads all sources. The settings are taken out of argv (argv[0] stays); with `others` the words that are no settings are left
 * there for the caller (a subcommand), else they are mistakes. BW_ASK_HELP and BW_ASK_VERSION read nothing else. False after a
 * mistake, which `error` names. Touches nothing on the disk. */
bool bw_config_load(bw_config *config, int *argc, char **argv, bool others, bw_ask *ask, char error[BW_CONFIG_ERROR]);
bool bw_config_is_loopback(const bw_config *config); /* of `listen` */
/* Makes the data folder and resolves its name. False: `error` tells why. */
bool bw_config_make_data(bw_config *config, char error[BW_CONFIG_ERROR]);
/* Takes over the reloadable values in which `fresh` differs and calls `tell` for every difference, with what has become of it. */
void bw_config_reload(bw_config *live, const bw_config *fresh,
                      void (*tell)(const bw_setting *setting, const char *value, bool applied));
/* All effective values as a configuration file, each with its source as a comment. */
void bw_config_print(const bw_config *config, FILE *to);
void bw_config_print_help(FILE *to);
/* The i-th variable of the environment that looks like a setting and is none, NULL after the last. */
const char *bw_config_stray_variable(size_t i);

#endif
