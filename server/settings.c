/* The table of settings, and how their values are written. */
#include "server/config.h"

#include <arpa/inet.h>
#include <errno.h>
#include <inttypes.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "server/networks.h"

#include "server/worker/admission.h"

enum { DAY = 86400 };
static const int64_t size_most = INT64_MAX >> 2;

#define FIELD(member) offsetof(bw_config, member), sizeof(((bw_config *)0)->member)
#define PATH(member) BW_SETTING_PATH, FIELD(member), 0, 0, 0, NULL
#define NETWORKS(member) BW_SETTING_NETWORKS, FIELD(member), 0, 0, 0, NULL
#define NAMES(member) BW_SETTING_NAMES, FIELD(member), 0, 0, 0, NULL
#define ADDRESS(member) BW_SETTING_ADDRESS, FIELD(member), 0, 0, 0, NULL
#define COUNT(member, low, high) BW_SETTING_COUNT, FIELD(member), low, high, 0, NULL
#define SIZE(member) BW_SETTING_SIZE, FIELD(member), 1, size_most, 0, NULL
#define SECONDS(member, low, high) BW_SETTING_DURATION, FIELD(member), low, high, 1000, NULL
#define MILLISECONDS(member, low, high) BW_SETTING_DURATION, FIELD(member), low, high, 1, NULL
#define CHOICE(member, words) BW_SETTING_CHOICE, FIELD(member), 0, 0, 0, words

const bw_setting bw_settings[] = {
    {"config", PATH(file), NULL, false, "FILE", "file with settings, one \"name = value\" a line, # begins a comment"},
    {"data", PATH(data), NULL, false, "DIR",
     "where blobs, jobs and results are kept; made if missing. One daemon per folder. Must be given"},
    {"listen", ADDRESS(listen), "127.0.0.1:8080", false, "ADDRESS:PORT",
     "Other than loopback only with access tokens (blockwrightd token create), and with tls-cert or behind-proxy. Port 0 takes a free one; the "
     "address is written to DIR/address in any case"},
    {"tls-cert", PATH(tls_certificate), NULL, false, "FILE", "certificate, and those that it rests on, as PEM: the daemon speaks HTTPS. Read again at SIGHUP"},
    {"tls-key", PATH(tls_key), NULL, false, "FILE", "its key as PEM, which nobody else can read. Read again at SIGHUP"},
    {"behind-proxy", NETWORKS(behind_proxy), NULL, false, "ADDRESS,...",
     "addresses or networks (10.0.0.0/8) of proxies that speak TLS in the daemon's place. Their X-Forwarded-For is believed; without tls-cert nobody else "
     "may connect, but from loopback. Connections per address are not limited then"},
    {"host-names", NAMES(host_names), "", false, "NAME,...",
     "names that the daemon is reached by, say of a proxy before it. Without access tokens it answers to these and those of loopback only"},
    {"worker", PATH(worker), NULL, false, "PROGRAM", "the worker, by default the blockwright-worker beside this program"},
    {"workers", COUNT(workers, 1, 256), NULL, false, "N", "stages that run at the same time, by default one per core"},
    {"max-connections", COUNT(max_connections, 16, 100000), "4096", false, "N", "connections that are open at the same time"},
    {"max-connections-per-address", COUNT(max_connections_per_address, 1, 100000), "1024", false, "N",
     "the same from one address; a proxy is one"},
    {"header-timeout", MILLISECONDS(header_timeout_ms, 100, DAY * 1000), "15s", true, "TIME", "what a client may take for the headers of a request"},
    {"body-timeout", MILLISECONDS(body_timeout_ms, 100, DAY * 1000), "30s", true, "TIME",
     "what it may take for the body, or for taking the answer, besides a second for every 4096 bytes"},
    {"max-upload", SIZE(max_upload), "2G", true, "SIZE", "largest input"},
    {"max-uploads", COUNT(max_uploads, 0, 100000), "1000", true, "N", "resumable uploads that are under way at the same time; as many complete ones are remembered"},
    {"upload-keep", SECONDS(upload_keep_seconds, 1, 365 * DAY), "1d", true, "TIME", "how long a resumable upload waits for its next part"},
    {"stage-memory", SIZE(stage_memory), "4G", true, "SIZE", "memory one stage may take"},
    {"stage-output", SIZE(stage_output), "16G", true, "SIZE", "largest file one stage may write"},
    {"stage-scratch", SIZE(stage_scratch), "32G", true, "SIZE", "all files of one stage together"},
    {"stage-cpu-seconds", SECONDS(stage_cpu_seconds, 1, 30 * DAY), "1h", true, "TIME", "processor time one stage may take"},
    {"stage-wall-seconds", SECONDS(stage_wall_seconds, 1, 30 * DAY), "2h", true, "TIME", "time one stage may take by the clock"},
    {"job-cpu-seconds", SECONDS(job_cpu_seconds, 0, 365 * DAY), "0s", true, "TIME",
     "processor time all stages of a job may take together, with tries that failed; 0: any"},
    {"job-wall-seconds", SECONDS(job_wall_seconds, 0, 365 * DAY), "0s", true, "TIME",
     "time they may run by the clock together; waiting does not count; 0: any"},
    {"memory", SIZE(memory), NULL, true, "SIZE",
     "what the stages that run at the same time may need together, by estimate: no more are started; by default 7/8 of the machine's"},
    {"cancel-grace", MILLISECONDS(cancel_grace_ms, 0, DAY * 1000), "10s", true, "TIME",
     "how long a cancelled stage is given to end by itself before it is killed"},
    {"require-sandbox", CHOICE(require_sandbox, "no yes"), "no", false, "yes|no",
     "whether jobs are started only with seccomp, Landlock and all limits in force (/readyz tells what is)"},
    {"owner-jobs", COUNT(owner_jobs, 0, INT_MAX), "0", true, "N", "jobs of one owner that wait or run; 0: any number"},
    {"owner-running", COUNT(owner_running, 0, 256), "0", true, "N", "stages of one owner that run at the same time; 0: any number"},
    {"owner-bytes", BW_SETTING_SIZE, FIELD(owner_bytes), 0, size_most, 0, NULL, "0", true, "SIZE",
     "inputs that one owner has uploaded, in all; 0: any number"},
    {"owner-uploads", COUNT(owner_uploads, 0, 100000), "250", true, "N", "resumable uploads of one owner that are under way at the same time; 0: any number"},
    {"owner-streams", COUNT(owner_streams, 0, 100000), "1024", true, "N", "streams of events and logs of one owner at the same time; 0: any number"},
    {"owner-rate", COUNT(owner_rate, 0, 1000000), "0", true, "N",
     "requests of one owner a second, and ten times as many at once; without access tokens: of all together; 0: any number"},
    {"stream-comment", MILLISECONDS(stream_comment_ms, 50, DAY * 1000), "15s", true, "TIME",
     "how often a stream sends a comment, and looks whether its client is still there and may still be"},
    {"keep-finished", SECONDS(keep_finished_seconds, 0, 10 * 365 * DAY), "30d", true, "TIME",
     "how long a successful job and its results are kept after its end, unless it is pinned; 0: for ever"},
    {"keep-failed", SECONDS(keep_failed_seconds, 0, 10 * 365 * DAY), "30d", true, "TIME", "the same of jobs that failed or were dismissed"},
    {"keep-gone", SECONDS(keep_gone_seconds, 0, 10 * 365 * DAY), "90d", true, "TIME",
     "how long the ids of jobs that are gone are known, and answered with 410; 0: for ever"},
    {"keep-keys", SECONDS(keep_keys_seconds, 0, 10 * 365 * DAY), "7d", true, "TIME", "how long an Idempotency-Key is known; 0: for ever"},
    {"keep-uploads", SECONDS(keep_blobs_seconds, 0, 10 * 365 * DAY), "1d", true, "TIME",
     "how long an input that no job names is kept after it was uploaded or named; 0: for ever"},
    {"cache-size", BW_SETTING_SIZE, FIELD(cache_size), 0, size_most, 0, NULL, "20G", true, "SIZE",
     "stage outputs that are kept, in all: those unused for longest go first, never results of jobs that are kept, nor what a job needs next; 0: any number"},
    {"retention-interval", SECONDS(retention_interval_seconds, 1, 30 * DAY), "10m", true, "TIME", "how often what is to go is looked for"},
    {"stop-grace", MILLISECONDS(stop_grace_ms, 0, DAY * 1000), "0s", true, "TIME",
     "how long running stages may go on after SIGTERM before they are given back to the queue"},
    {"log-level", CHOICE(log_level, "debug info warn error"), "info", true, "LEVEL", "least level that is logged"},
    {"log-format", CHOICE(log_format, "logfmt json"), "logfmt", true, "FORMAT", "how a line of the log is written"},
    {"log-requests", CHOICE(log_requests, "none failed all"), "all", true, "WHICH",
     "requests that are logged; failed ones are those answered with 500 and above"},
    {"probe-interval", MILLISECONDS(probe_interval_ms, 50, DAY * 1000), "10s", true, "TIME",
     "how often a small file is synced to see how the disk is"},
    {"ready-disk-warn", SIZE(ready_disk_warn), "1G", true, "SIZE", "/readyz warns when less of the disk is free"},
    {"ready-disk-fail", SIZE(ready_disk_fail), "64M", true, "SIZE", "/readyz says 503 when less of the disk is free"},
    {"ready-fsync-warn", MILLISECONDS(ready_fsync_warn_ms, 1, DAY * 1000), "500ms", true, "TIME",
     "/readyz warns when a sync took as long in the last 5 minutes"},
    {"ready-fsync-fail", MILLISECONDS(ready_fsync_fail_ms, 1, DAY * 1000), "10s", true, "TIME",
     "/readyz says 503 when the last sync took as long, or has not returned for as long"},
    {"ready-queue-warn", SECONDS(ready_queue_warn_seconds, 0, 365 * DAY), "1h", true, "TIME",
     "/readyz warns when a job has waited as long for its first stage; 0: never"},
    {"ready-queue-fail", SECONDS(ready_queue_fail_seconds, 0, 365 * DAY), "0s", true, "TIME",
     "/readyz says 503 when a job has waited as long for its first stage; 0: never"},
};
const size_t bw_setting_count = sizeof bw_settings / sizeof *bw_settings;
_Static_assert(sizeof bw_settings / sizeof *bw_settings <= BW_SETTINGS_MOST, "raise BW_SETTINGS_MOST");

/* ---- names ---- */

int bw_setting_find(const char *name, size_t length) {
    for (size_t i = 0; i < bw_setting_count; i++)
        if (strlen(bw_settings[i].name) == length && strncmp(bw_settings[i].name, name, length) == 0) return (int)i;
    return -1;
}

/* Levenshtein's distance with a row of the table, for words of less than 64 letters. */
static size_t distance(const char *a, size_t n, const char *b, size_t m) {
    size_t row[64];
    for (size_t j = 0; j <= m; j++) row[j] = j;
    for (size_t i = 1; i <= n; i++) {
        size_t corner = row[0];
        row[0] = i;
        for (size_t j = 1; j <= m; j++) {
            size_t change = corner + (a[i - 1] != b[j - 1]), least = (row[j] < row[j - 1] ? row[j] : row[j - 1]) + 1;
            corner = row[j];
            row[j] = change < least ? change : least;
        }
    }
    return row[m];
}

const char *bw_setting_nearest(const char *name, size_t length) {
    const char *best = NULL;
    size_t least = length < 6 ? 2 : length < 12 ? 3 : 4; /* as many edits are too many */
    if (length >= 64) return NULL;
    for (size_t i = 0; i < bw_setting_count; i++) {
        size_t d = distance(name, length, bw_settings[i].name, strlen(bw_settings[i].name));
        if (d < least) least = d, best = bw_settings[i].name;
    }
    return best;
}

/* ---- defaults ---- */

const char *bw_setting_default(const bw_setting *s, char text[BW_VALUE_TEXT]) {
    text[0] = '\0';
    if (s->standard) return s->standard;
    if (s->offset == offsetof(bw_config, workers)) {
        long cores = sysconf(_SC_NPROCESSORS_ONLN);
        snprintf(text, BW_VALUE_TEXT, "%ld", cores < 1 ? 1 : cores > s->high ? (long)s->high : cores);
    } else if (s->offset == offsetof(bw_config, memory)) {
        snprintf(text, BW_VALUE_TEXT, "%" PRIu64, bw_machine_memory() / 8 * 7);
    } else if (s->offset == offsetof(bw_config, worker)) {
        static const char name[] = "blockwright-worker";
        ssize_t n = readlink("/proc/self/exe", text, BW_VALUE_TEXT - sizeof name);
        text[n > 0 ? n : 0] = '\0';
        char *slash = strrchr(text, '/');
        if (slash) memcpy(slash + 1, name, sizeof name);
    }
    return text;
}

/* ---- reading values ---- */

static bool complain(char *error, size_t size, const char *format, ...) __attribute__((format(printf, 3, 4)));
static bool complain(char *error, size_t size, const char *format, ...) {
    va_list args;
    va_start(args, format);
    vsnprintf(error, size, format, args);
    va_end(args);
    return false;
}

/* Digits and then a unit: one of `units` or nothing. *number = digits times the unit's factor; false if it is no such thing. */
typedef struct {
    const char *name;
    int64_t factor;
} unit;

static bool read_number(const char *text, const unit *units, int64_t *number) {
    char *end;
    errno = 0;
    long long n = strtoll(text, &end, 10);
    if (errno || *text < '0' || *text > '9') return false;
    for (const unit *u = units; u->name; u++)
        if (strcmp(u->name, end) == 0) return !__builtin_mul_overflow((int64_t)n, u->factor, number);
    return false;
}

static bool parse_count(const bw_setting *s, atomic_int *value, const char *text, char *error, size_t size) {
    static const unit units[] = {{"", 1}, {NULL, 0}};
    int64_t n;
    if (!read_number(text, units, &n)) return complain(error, size, "'%.80s' is not a number", text);
    if (n < s->low || n > s->high)
        return complain(error, size, "'%.80s' is not between %" PRId64 " and %" PRId64, text, s->low, s->high);
    *value = (int)n;
    return true;
}

static bool parse_size(const bw_setting *s, _Atomic uint64_t *value, const char *text, char *error, size_t size) {
    static const unit units[] = {{"", 1},      {"K", (int64_t)1 << 10}, {"M", (int64_t)1 << 20}, {"G", (int64_t)1 << 30},
                                 {"T", (int64_t)1 << 40}, {NULL, 0}};
    int64_t n;
    if (!read_number(text, units, &n) || n < s->low || n > s->high)
        return complain(error, size, "'%.80s' is not a size (examples: 1000000, 512M, 2G)", text);
    *value = (uint64_t)n;
    return true;
}

static bool parse_duration(const bw_setting *s, atomic_int *value, const char *text, char *error, size_t size) {
    static const unit units[] = {{"", 1000}, {"ms", 1}, {"s", 1000}, {"m", 60000}, {"h", 3600000}, {"d", 86400000}, {NULL, 0}};
    int64_t ms;
    if (!read_number(text, units, &ms))
        return complain(error, size, "'%.80s' is not a time (examples: 30, 500ms, 30s, 5m, 2h, 1d)", text);
    if (ms % s->unit_ms) return complain(error, size, "'%.80s' is not a whole number of seconds", text);
    if (ms / s->unit_ms < s->low || ms / s->unit_ms > s->high)
        return complain(error, size, "'%.80s' is not between %" PRId64 " and %" PRId64 " %s", text, s->low, s->high,
                        s->unit_ms == 1 ? "milliseconds" : "seconds");
    *value = (int)(ms / s->unit_ms);
    return true;
}

static bool parse_choice(const bw_setting *s, atomic_int *value, const char *text, char *error, size_t size) {
    int index = 0;
    for (const char *word = s->choices; *word; index++) {
        size_t n = strcspn(word, " ");
        if (strlen(text) == n && strncmp(word, text, n) == 0) {
            *value = index;
            return true;
        }
        word += n + (word[n] == ' ');
    }
    return complain(error, size, "'%.80s' is none of: %s", text, s->choices);
}

static bool parse_host(char *host, unsigned long port, struct sockaddr_storage *address) {
    struct sockaddr_in *in = (struct sockaddr_in *)address;
    struct sockaddr_in6 *in6 = (struct sockaddr_in6 *)address;
    size_t n = strlen(host);
    memset(address, 0, sizeof *address);
    if (host[0] == '[' && host[n - 1] == ']') {
        host[n - 1] = '\0';
        in6->sin6_family = AF_INET6;
        in6->sin6_port = htons((uint16_t)port);
        return inet_pton(AF_INET6, host + 1, &in6->sin6_addr) == 1;
    }
    in->sin_family = AF_INET;
    in->sin_port = htons((uint16_t)port);
    return inet_pton(AF_INET, strcmp(host, "localhost") ? host : "127.0.0.1", &in->sin_addr) == 1;
}

static bool parse_address(struct sockaddr_storage *address, const char *text, char *error, size_t size) {
    char host[64], *end;
    const char *colon = strrchr(text, ':');
    if (!colon || colon == text || (size_t)(colon - text) >= sizeof host)
        return complain(error, size, "'%.80s' is not ADDRESS:PORT", text);
    memcpy(host, text, (size_t)(colon - text));
    host[colon - text] = '\0';
    unsigned long port = strtoul(colon + 1, &end, 10);
    if (colon[1] < '0' || colon[1] > '9' || *end || port > 65535)
        return complain(error, size, "'%.80s' has no valid port", text);
    if (!parse_host(host, port, address))
        return complain(error, size, "'%.80s' has no valid address (IPv6 stands in brackets: [::1]:8080)", text);
    return true;
}

/* Made absolute, for the daemon reads its file again later. */
static bool parse_path(const bw_setting *s, char *value, const char *text, char *error, size_t size) {
    char here[PATH_MAX] = "";
    if (!*text) return complain(error, size, "the path is empty");
    for (const char *c = text; *c; c++)
        if ((unsigned char)*c < 0x20 || *c == 0x7f) return complain(error, size, "the path has a control character in it");
    if (*text != '/' && !getcwd(here, sizeof here)) return complain(error, size, "the current folder has no name");
    int n = snprintf(value, s->room, "%s%s%s", here, *text == '/' ? "" : "/", text);
    return (n >= 0 && (size_t)n < s->room) || complain(error, size, "'%.80s...' is too long", text);
}

static bool parse_names(const bw_setting *s, char *value, const char *text, char *error, size_t size) {
    static const char good[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789.-:,";
    size_t n = strlen(text);
    if (strspn(text, good) != n) return complain(error, size, "'%.80s' is no list of names with commas between them", text);
    if (n >= s->room) return complain(error, size, "'%.80s...' is too long", text);
    memcpy(value, text, n + 1);
    return true;
}

static bool parse_networks(const bw_setting *s, char *value, const char *text, char *error, size_t size) {
    bw_networks networks;
    size_t n = strlen(text);
    if (!bw_networks_parse(text, &networks))
        return complain(error, size, "'%.80s' is no list of at most %d addresses or networks (10.0.0.1,192.168.0.0/16,fd00::/8)", text, BW_NETWORKS_MOST);
    if (n >= s->room) return complain(error, size, "'%.80s...' is too long", text);
    memcpy(value, text, n + 1);
    return true;
}

bool bw_setting_parse(const bw_setting *s, bw_config *config, const char *text, char *error, size_t size) {
    void *field = (char *)config + s->offset;
    switch (s->type) {
    case BW_SETTING_COUNT: return parse_count(s, field, text, error, size);
    case BW_SETTING_SIZE: return parse_size(s, field, text, error, size);
    case BW_SETTING_DURATION: return parse_duration(s, field, text, error, size);
    case BW_SETTING_CHOICE: return parse_choice(s, field, text, error, size);
    case BW_SETTING_ADDRESS: return parse_address(field, text, error, size);
    case BW_SETTING_PATH: return parse_path(s, field, text, error, size);
    case BW_SETTING_NETWORKS: return parse_networks(s, field, text, error, size);
    case BW_SETTING_NAMES: return parse_names(s, field, text, error, size);
    }
    return false;
}

/* ---- writing values ---- */

static void write_size(uint64_t n, char text[BW_VALUE_TEXT]) {
    static const char *const letters[] = {"", "K", "M", "G", "T"};
    int i = 0;
    for (; n && n % 1024 == 0 && i < 4; i++) n /= 1024;
    snprintf(text, BW_VALUE_TEXT, "%" PRIu64 "%s", n, letters[i]);
}

static void write_duration(int64_t ms, char text[BW_VALUE_TEXT]) {
    static const unit units[] = {{"d", 86400000}, {"h", 3600000}, {"m", 60000}, {"s", 1000}, {"ms", 1}};
    const unit *u = units;
    while (ms % u->factor) u++;
    if (ms == 0) u = &units[3];
    snprintf(text, BW_VALUE_TEXT, "%" PRId64 "%s", ms / u->factor, u->name);
}

static void write_choice(const char *word, int index, char text[BW_VALUE_TEXT]) {
    for (; index > 0; index--) word += strcspn(word, " ") + 1;
    snprintf(text, BW_VALUE_TEXT, "%.*s", (int)strcspn(word, " "), word);
}

static void write_address(const struct sockaddr_storage *address, char text[BW_VALUE_TEXT]) {
    char host[INET6_ADDRSTRLEN] = "";
    const struct sockaddr_in *in = (const struct sockaddr_in *)address;
    const struct sockaddr_in6 *in6 = (const struct sockaddr_in6 *)address;
    if (address->ss_family == AF_INET6) {
        inet_ntop(AF_INET6, &in6->sin6_addr, host, sizeof host);
        snprintf(text, BW_VALUE_TEXT, "[%s]:%u", host, ntohs(in6->sin6_port));
    } else {
        inet_ntop(AF_INET, &in->sin_addr, host, sizeof host);
        snprintf(text, BW_VALUE_TEXT, "%s:%u", host, ntohs(in->sin_port));
    }
}

char *bw_setting_text(const bw_setting *s, const bw_config *config, char text[BW_VALUE_TEXT]) {
    const void *field = (const char *)config + s->offset;
    int number = s->type == BW_SETTING_COUNT || s->type == BW_SETTING_DURATION || s->type == BW_SETTING_CHOICE
                     ? *(const atomic_int *)field : 0;
    switch (s->type) {
    case BW_SETTING_COUNT: snprintf(text, BW_VALUE_TEXT, "%d", number); break;
    case BW_SETTING_SIZE: write_size(*(const _Atomic uint64_t *)field, text); break;
    case BW_SETTING_DURATION: write_duration((int64_t)number * s->unit_ms, text); break;
    case BW_SETTING_CHOICE: write_choice(s->choices, number, text); break;
    case BW_SETTING_ADDRESS: write_address(field, text); break;
    case BW_SETTING_NETWORKS:
    case BW_SETTING_NAMES:
    case BW_SETTING_PATH: snprintf(text, BW_VALUE_TEXT, "%s", (const char *)field); break;
    }
    return text;
}
