/* What the command line of blockwrightd says. */
#ifndef BW_SERVER_CONFIG_H
#define BW_SERVER_CONFIG_H

#include <limits.h>
#include <netinet/in.h>
#include <stdint.h>
#include <sys/socket.h>

typedef struct {
    char data[PATH_MAX - 256];   /* absolute, made if missing */
    char worker[PATH_MAX];       /* the worker program, absolute */
    struct sockaddr_storage listen; /* loopback */
    socklen_t listen_size;
    int workers;                 /* stages that run at the same time */
    uint64_t max_upload;         /* bytes of one blob */
    uint64_t stage_memory;       /* bytes a stage may take */
    uint64_t stage_output;       /* bytes of one file a stage may write */
    int stage_cpu_seconds, stage_wall_seconds;
} bw_config;

/* Reads the command line. Returns -1 to go on, else the exit code to end with (0 after --help and --version, 2 after a
 * mistake that was explained on stderr). */
int bw_config_parse(bw_config *config, int argc, char **argv);

#endif
