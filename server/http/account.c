#include "server/http/account.h"

#include <inttypes.h>

#include "server/clock.h"
#include "server/log.h"
#include "server/metrics.h"

enum { LOG_NONE, LOG_FAILED, LOG_ALL }; /* the words of log-requests */

static void log_request(const bw_request *r, int64_t us, bool cut) {
    const bw_endpoint *e = r->op < BW_OP_COUNT ? &bw_endpoints[r->op] : NULL;
    int which = r->services->config->log_requests;
    char owner[2 * BW_OWNER_TEXT + 3];
    if (which == LOG_NONE || (which == LOG_FAILED && r->reply_status < 500)) return;
    bw_event(r->reply_status >= 500 ? BW_WARN : BW_INFO, "http.request",
             "method=%s path=%s status=%u owner=%s received=%" PRIu64 " sent=%" PRIu64 " ms=%" PRId64 " cut=%d", e ? r->head ? "HEAD" : e->method : "-",
             e ? e->path : "-", r->reply_status,
             bw_quoted(r->caller.owner, owner, sizeof owner), r->received, r->sent, us / 1000, cut);
}

void bw_request_account(const bw_request *r, bool cut) {
    int64_t us = bw_mono_us() - r->started_us;
    unsigned class = r->reply_status / 100;
    if (class >= 1 && class <= 5) bw_count(BW_METRIC_REQUESTS, (int)r->op, (int)class - 1, 1);
    bw_gauge_add(BW_METRIC_REQUESTS_ACTIVE, 0, -1);
    bw_count(BW_METRIC_REPLY_BYTES, 0, 0, r->sent);
    bw_observe(BW_METRIC_REQUEST_SECONDS, (int)r->op, us);
    log_request(r, us, cut);
}
