#include "server/http/http.h"

#include <arpa/inet.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/resource.h>

#include "server/clock.h"
#include "server/http/guard.h"
#include "server/http/rate.h"
#include "server/http/request.h"
#include "server/http/routes.h"
#include "server/http/stream.h"
#include "server/http/tls.h"
#include "server/log.h"
#include "server/networks.h"

enum { THREADS = 4, CONNECTION_MEMORY = 128 << 10, DESCRIPTORS_KEPT = 256, LAST_REPLIES_SECONDS = 2 };
enum { POOL_THREADS = 2, EXPIRY_MS = 10000 };

struct bw_http {
    struct MHD_Daemon *daemon;
    bw_services services;
    bw_traffic traffic;
    bw_guard *guard;
    bw_watcher expiry; /* of uploads; told now and then */
    bw_pool_work expire;
    bw_networks proxies;
};

static void on_library_log(void *user, const char *format, va_list args) {
    char text[300], quoted[400];
    (void)user;
    vsnprintf(text, sizeof text, format, args);
    bw_event(BW_WARN, "http.library", "message=%s", bw_quoted(text, quoted, sizeof quoted));
}

/* ---- uploads that nobody goes on with ---- */

static void expire_uploads(void *user);

static void on_time(void *user, bw_watch_reason reason) {
    bw_http *http = user;
    if (reason != BW_WATCH_STOP) bw_pool_post(http->traffic.pool, &http->expire, expire_uploads, http);
}

static void watch_uploads(bw_http *http) {
    bw_watch_add(http->services.watch, &http->expiry, "uploads", bw_mono_ms() + EXPIRY_MS, on_time, http);
}

static void expire_uploads(void *user) {
    bw_http *http = user;
    bw_partials_expire(http->traffic.partials, bw_now_ms(), http->services.config->max_uploads);
    watch_uploads(http);
}

/* ---- start and stop ---- */

static void name_address(const bw_config *config, unsigned port, char *address, size_t size) {
    char host[INET6_ADDRSTRLEN];
    bool six = config->listen.ss_family == AF_INET6;
    const void *raw = six ? (const void *)&((const struct sockaddr_in6 *)&config->listen)->sin6_addr
                          : (const void *)&((const struct sockaddr_in *)&config->listen)->sin_addr;
    inet_ntop(config->listen.ss_family, raw, host, sizeof host);
    snprintf(address, size, six ? "[%s]:%u" : "%s:%u", host, port);
}

static void traffic_init(bw_traffic *traffic, const bw_services *services) {
    pthread_condattr_t monotonic;
    traffic->services = services;
    pthread_mutex_init(&traffic->lock, NULL);
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_cond_init(&traffic->changed, &monotonic);
    pthread_condattr_destroy(&monotonic);
}

/* As many as the configuration says and descriptors can be had for; some are kept for files and the queue. The spawner, which has been
 * forked already, and the workers keep their own limit. */
static unsigned connection_limit(const bw_config *config) {
    struct rlimit limit;
    rlim_t wanted = (rlim_t)config->max_connections, most;
    if (getrlimit(RLIMIT_NOFILE, &limit) != 0) return (unsigned)wanted;
    if (limit.rlim_cur < wanted + DESCRIPTORS_KEPT) {
        limit.rlim_cur = limit.rlim_max < wanted + DESCRIPTORS_KEPT ? limit.rlim_max : wanted + DESCRIPTORS_KEPT;
        if (setrlimit(RLIMIT_NOFILE, &limit) != 0) getrlimit(RLIMIT_NOFILE, &limit);
    }
    most = limit.rlim_cur > 2 * DESCRIPTORS_KEPT ? limit.rlim_cur - DESCRIPTORS_KEPT : limit.rlim_cur / 2;
    if (wanted <= most) return (unsigned)wanted;
    bw_event(BW_WARN, "http.descriptors", "connections=%llu wanted=%llu", (unsigned long long)most, (unsigned long long)wanted);
    return (unsigned)most;
}

/* Who may connect at all: without TLS, and not on loopback, only the proxies that have it. */
static enum MHD_Result on_connect(void *user, const struct sockaddr *from, socklen_t size) {
    bw_http *http = user;
    uint8_t address[16];
    (void)size;
    if (bw_config_is_loopback(http->services.config) || *http->services.config->tls_certificate) return MHD_YES;
    return bw_address_of(from, address) && (bw_address_is_loopback(address) || bw_networks_have(&http->proxies, address)) ? MHD_YES : MHD_NO;
}

static bw_status start_tls(const bw_config *config, unsigned *flags) {
    char error[BW_TLS_ERROR], quoted[BW_TLS_ERROR + 100];
    if (!*config->tls_certificate) return BW_OK;
    *flags |= MHD_USE_TLS;
    bw_status status = MHD_is_feature_supported(MHD_FEATURE_TLS) == MHD_YES ? bw_tls_open(config->tls_certificate, config->tls_key, error) : BW_E_USAGE;
    if (MHD_is_feature_supported(MHD_FEATURE_TLS) != MHD_YES) snprintf(error, sizeof error, "this libmicrohttpd has no TLS");
    if (status != BW_OK) bw_event(BW_ERROR, "tls.refused", "error=%s", bw_quoted(error, quoted, sizeof quoted));
    return status;
}

bw_status bw_http_start(const bw_services *services, bw_http **out, char *address, size_t size) {
    for (int i = 0; i < BW_OP_COUNT; i++)
        if (!bw_routes[i].handle) return BW_E_INTERNAL; /* an operation of the document that nobody has written */
    bw_http *http = calloc(1, sizeof *http);
    if (!http) return BW_E_MEMORY;
    http->services = *services;
    traffic_init(&http->traffic, &http->services);
    bw_status status = bw_guard_open(services->config, &http->guard);
    if (status == BW_OK) status = bw_pool_open(POOL_THREADS, &http->traffic.pool);
    if (status == BW_OK) status = bw_streams_open(&http->traffic.streams);
    if (status == BW_OK && !(http->traffic.rates = bw_rates_open())) status = BW_E_MEMORY;
    if (status == BW_OK) status = bw_partials_open(services->config->data, services->store, &http->traffic.partials);
    unsigned flags = MHD_USE_EPOLL_INTERNAL_THREAD | MHD_USE_ERROR_LOG | MHD_ALLOW_SUSPEND_RESUME;
    if (services->config->listen.ss_family == AF_INET6) flags |= MHD_USE_IPv6;
    if (status == BW_OK) status = start_tls(services->config, &flags);
    if (status != BW_OK) {
        bw_http_stop(http);
        return status;
    }
    bool tls = flags & MHD_USE_TLS;
    struct MHD_OptionItem more[] = {{tls ? MHD_OPTION_HTTPS_PRIORITIES : MHD_OPTION_END, 0, (void *)BW_TLS_PRIORITIES},
                                    {MHD_OPTION_HTTPS_CERT_CALLBACK, 0, (void *)bw_tls_choose},
                                    {MHD_OPTION_END, 0, NULL}};
    bw_networks_parse(services->config->behind_proxy, &http->proxies);
    unsigned per_address = http->proxies.count ? 0 : (unsigned)services->config->max_connections_per_address;
    http->daemon = MHD_start_daemon(
        flags, 0, on_connect, http, bw_request_on_call, &http->traffic, MHD_OPTION_EXTERNAL_LOGGER, on_library_log, NULL,
        MHD_OPTION_SOCK_ADDR, &services->config->listen, MHD_OPTION_THREAD_POOL_SIZE, (unsigned)THREADS,
        MHD_OPTION_CONNECTION_LIMIT, connection_limit(services->config),
        MHD_OPTION_PER_IP_CONNECTION_LIMIT, per_address, MHD_OPTION_CONNECTION_MEMORY_LIMIT,
        (size_t)CONNECTION_MEMORY, MHD_OPTION_CONNECTION_TIMEOUT, (unsigned)BW_IDLE_SECONDS, MHD_OPTION_NOTIFY_COMPLETED,
        bw_request_on_end, &http->traffic, MHD_OPTION_NOTIFY_CONNECTION, bw_guard_on_connection, http->guard, MHD_OPTION_ARRAY, more, MHD_OPTION_END);
    const union MHD_DaemonInfo *info = http->daemon ? MHD_get_daemon_info(http->daemon, MHD_DAEMON_INFO_BIND_PORT) : NULL;
    if (!info) {
        bw_http_stop(http);
        return BW_E_IO;
    }
    on_time(http, BW_WATCH_TIME);
    name_address(services->config, info->port, address, size);
    *out = http;
    return BW_OK;
}

/* libmicrohttpd must not be stopped while a request is suspended; it cuts those off that are still being answered. Nor may it be told to accept no
 * more: MHD_quiesce_daemon and an epoll thread both take the listening socket out of the set, and the second one aborts the process. So
 * connections come to the end, and their requests are refused. */
static void wait_for_traffic(bw_traffic *traffic) {
    int64_t end = bw_mono_ms() + LAST_REPLIES_SECONDS * 1000;
    struct timespec until = {end / 1000, end % 1000 * 1000000};
    pthread_mutex_lock(&traffic->lock);
    while (traffic->suspended) pthread_cond_wait(&traffic->changed, &traffic->lock);
    while (traffic->active && pthread_cond_timedwait(&traffic->changed, &traffic->lock, &until) == 0) continue;
    while (traffic->suspended) pthread_cond_wait(&traffic->changed, &traffic->lock);
    traffic->closed = true; /* a connection that is kept may bring another request yet */
    pthread_mutex_unlock(&traffic->lock);
}

void bw_http_stop(bw_http *http) {
    if (!http) return;
    if (http->daemon) {
        atomic_store(&http->traffic.ending, true);
        bw_watch_stop(http->services.watch);
        wait_for_traffic(&http->traffic);
        MHD_stop_daemon(http->daemon);
    }
    bw_pool_close(http->traffic.pool);
    bw_partials_close(http->traffic.partials);
    bw_streams_close(http->traffic.streams);
    bw_rates_close(http->traffic.rates);
    bw_guard_close(http->guard);
    bw_tls_close();
    pthread_cond_destroy(&http->traffic.changed);
    pthread_mutex_destroy(&http->traffic.lock);
    free(http);
}

void bw_http_reload(bw_http *http) {
    char error[BW_TLS_ERROR], quoted[BW_TLS_ERROR + 100];
    if (!*http->services.config->tls_certificate) return;
    if (bw_tls_reload(error) == BW_OK) bw_event(BW_INFO, "tls.reloaded", "%s", "");
    else bw_event(BW_ERROR, "tls.rejected", "error=%s", bw_quoted(error, quoted, sizeof quoted));
}
