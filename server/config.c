#include "server/config.h"

#include <arpa/inet.h>
#include <errno.h>
#include <getopt.h>
#include <inttypes.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static const char help[] =
    "blockwrightd - decomposes parametrized tet meshes and hexahedral meshes into blocks, over HTTP\n"
    "\n"
    "  blockwrightd --data DIR [options]\n"
    "\n"
    "  --data DIR              where blobs, jobs and results are kept; made if missing. One daemon per folder.\n"
    "  --listen ADDRESS:PORT   default 127.0.0.1:8080. Loopback only, for there are no access tokens yet.\n"
    "                          Port 0 takes a free one; the address is written to DIR/address in any case.\n"
    "  --workers N             stages that run at the same time; default: one per core\n"
    "  --max-upload SIZE       largest input; default 2G\n"
    "  --stage-memory SIZE     memory one stage may take; default 4G\n"
    "  --stage-output SIZE     largest file one stage may write; default 16G\n"
    "  --stage-cpu-seconds N   processor time one stage may take; default 3600\n"
    "  --stage-wall-seconds N  time one stage may take by the clock; default 7200\n"
    "  --worker PROGRAM        the worker; default: blockwright-worker beside this program\n"
    "  --version, --help\n"
    "\n"
    "SIZE is in bytes, or with K, M, G, T in powers of 1024. SIGTERM stops the daemon in order; nothing accepted is lost\n"
    "whichever way it ends. Log: one line per event on stderr.\n"
    "\n"
    "Try it:\n"
    "  blockwrightd --data /tmp/bw &\n"
    "  h=$(sha256sum part.hexex | cut -d' ' -f1)\n"
    "  curl -T part.hexex http://127.0.0.1:8080/v1/blobs/$h\n"
    "  curl -H 'Content-Type: application/json' -d '{\"input\":\"'$h'\"}' http://127.0.0.1:8080/v1/jobs\n"
    "  curl http://127.0.0.1:8080/v1/jobs\n"
    "Hex meshes of jobs, in a browser: http://127.0.0.1:8080/\n"
    "The whole interface: curl http://127.0.0.1:8080/openapi.json\n";

static bool mistake(const char *format, const char *value) {
    fprintf(stderr, "blockwrightd: ");
    fprintf(stderr, format, value);
    fprintf(stderr, "\nblockwrightd: try --help\n");
    return false;
}

static bool parse_size(const char *text, uint64_t *size) {
    char *end;
    errno = 0;
    unsigned long long n = strtoull(text, &end, 10);
    const char *units = "KMGT", *unit = *end ? strchr(units, *end) : NULL;
    int shift = unit ? 10 * (int)(unit - units + 1) : 0;
    if (unit) end++;
    if (errno || *text < '0' || *text > '9' || *end || n == 0 || n > (UINT64_MAX >> 2) >> shift)
        return mistake("'%s' is not a size (examples: 1000000, 512M, 2G)", text);
    *size = (uint64_t)n << shift;
    return true;
}

static bool parse_int(const char *text, int most, int *value) {
    char *end;
    errno = 0;
    long n = strtol(text, &end, 10);
    if (errno || *text < '0' || *text > '9' || *end || n < 1 || n > most)
        return mistake("'%s' is not a number in the range that makes sense here", text);
    *value = (int)n;
    return true;
}

static bool is_loopback(const struct sockaddr_storage *address) {
    if (address->ss_family == AF_INET) {
        const struct sockaddr_in *in = (const struct sockaddr_in *)address;
        return ntohl(in->sin_addr.s_addr) >> 24 == 127;
    }
    return IN6_IS_ADDR_LOOPBACK(&((const struct sockaddr_in6 *)address)->sin6_addr);
}

/* ADDRESS:PORT with a numeric address or "localhost"; an IPv6 address stands in brackets. */
static bool parse_listen(bw_config *config, const char *text) {
    char host[64];
    const char *colon = strrchr(text, ':');
    char *end;
    if (!colon || colon == text || (size_t)(colon - text) >= sizeof host)
        return mistake("'%s' is not ADDRESS:PORT", text);
    size_t n = (size_t)(colon - text);
    memcpy(host, text, n);
    host[n] = '\0';
    unsigned long port = strtoul(colon + 1, &end, 10);
    if (colon[1] < '0' || colon[1] > '9' || *end || port > 65535) return mistake("'%s' has no valid port", text);
    memset(&config->listen, 0, sizeof config->listen);
    struct sockaddr_in *in = (struct sockaddr_in *)&config->listen;
    struct sockaddr_in6 *in6 = (struct sockaddr_in6 *)&config->listen;
    if (host[0] == '[' && host[n - 1] == ']') {
        host[n - 1] = '\0';
        if (inet_pton(AF_INET6, host + 1, &in6->sin6_addr) != 1) return mistake("'%s' has no valid IPv6 address", text);
        in6->sin6_family = AF_INET6;
        in6->sin6_port = htons((uint16_t)port);
        config->listen_size = sizeof *in6;
    } else {
        if (inet_pton(AF_INET, strcmp(host, "localhost") ? host : "127.0.0.1", &in->sin_addr) != 1)
            return mistake("'%s' has no valid IPv4 address (IPv6 stands in brackets: [::1]:8080)", text);
        in->sin_family = AF_INET;
        in->sin_port = htons((uint16_t)port);
        config->listen_size = sizeof *in;
    }
    if (!is_loopback(&config->listen))
        return mistake("refusing to listen on '%s': without access tokens everybody who reaches that address could use "
                       "the daemon. Listen on 127.0.0.1 or [::1], and put a proxy that authenticates before it.", text);
    return true;
}

static bool defaults(bw_config *config) {
    memset(config, 0, sizeof *config);
    long cores = sysconf(_SC_NPROCESSORS_ONLN);
    config->workers = cores > 0 ? (int)cores : 1;
    config->max_upload = (uint64_t)2 << 30;
    config->stage_memory = (uint64_t)4 << 30;
    config->stage_output = (uint64_t)16 << 30;
    config->stage_cpu_seconds = 3600;
    config->stage_wall_seconds = 7200;
    ssize_t n = readlink("/proc/self/exe", config->worker, sizeof config->worker - 32);
    if (n <= 0) return mistake("cannot read %s to find the worker beside this program", "/proc/self/exe");
    config->worker[n] = '\0';
    strcpy(strrchr(config->worker, '/') + 1, "blockwright-worker");
    return parse_listen(config, "127.0.0.1:8080");
}

static bool finish(bw_config *config, const char *data, const char *worker) {
    char *real;
    if (!data) return mistake("say with %s where jobs and results are to be kept", "--data DIR");
    if (mkdir(data, 0700) != 0 && errno != EEXIST) return mistake("cannot make the folder '%s'", data);
    if (!(real = realpath(data, NULL)) || strlen(real) >= sizeof config->data) {
        free(real);
        return mistake("cannot use the folder '%s'", data);
    }
    strcpy(config->data, real);
    free(real);
    if (worker) {
        if (!(real = realpath(worker, NULL)) || strlen(real) >= sizeof config->worker) {
            free(real);
            return mistake("there is no worker '%s'", worker);
        }
        strcpy(config->worker, real);
        free(real);
    }
    if (access(config->worker, X_OK) != 0) return mistake("the worker '%s' cannot be run", config->worker);
    return true;
}

enum { DATA = 1, LISTEN, WORKERS, UPLOAD, MEMORY, OUTPUT, CPU, WALL, WORKER, VERSION, HELP };

static const struct option names[] = {
    {"data", 1, 0, DATA},           {"listen", 1, 0, LISTEN},          {"workers", 1, 0, WORKERS},
    {"max-upload", 1, 0, UPLOAD},   {"stage-memory", 1, 0, MEMORY},    {"stage-output", 1, 0, OUTPUT},
    {"stage-cpu-seconds", 1, 0, CPU}, {"stage-wall-seconds", 1, 0, WALL}, {"worker", 1, 0, WORKER},
    {"version", 0, 0, VERSION},     {"help", 0, 0, HELP},              {0, 0, 0, 0}};

int bw_config_parse(bw_config *config, int argc, char **argv) {
    enum { DAY = 86400 };
    const char *data = NULL, *worker = NULL;
    if (!defaults(config)) return 2;
    for (int c; (c = getopt_long(argc, argv, "", names, NULL)) != -1;) {
        bool good = true;
        switch (c) {
        case DATA: data = optarg; break;
        case LISTEN: good = parse_listen(config, optarg); break;
        case WORKERS: good = parse_int(optarg, 256, &config->workers); break;
        case UPLOAD: good = parse_size(optarg, &config->max_upload); break;
        case MEMORY: good = parse_size(optarg, &config->stage_memory); break;
        case OUTPUT: good = parse_size(optarg, &config->stage_output); break;
        case CPU: good = parse_int(optarg, 30 * DAY, &config->stage_cpu_seconds); break;
        case WALL: good = parse_int(optarg, 30 * DAY, &config->stage_wall_seconds); break;
        case WORKER: worker = optarg; break;
        case VERSION: printf("blockwrightd %s\n", BW_VERSION); return 0;
        case HELP: fputs(help, stdout); return 0;
        default: fprintf(stderr, "blockwrightd: try --help\n"); return 2;
        }
        if (!good) return 2;
    }
    if (optind < argc) {
        mistake("'%s' is not an option", argv[optind]);
        return 2;
    }
    return finish(config, data, worker) ? -1 : 2;
}
