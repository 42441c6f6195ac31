#include "server/http/access.h"

#include <arpa/inet.h>
#include <errno.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "server/clock.h"
#include "server/failure.h"
#include "server/http/operations.h"
#include "server/http/rate.h"
#include "server/http/reply.h"
#include "server/log.h"
#include "server/networks.h"

/* ---- a daemon without tokens ---- */

/* The name in "NAME:PORT", without the brackets of IPv6. False if it is too long to be meant. */
static bool host_name(const char *host, char name[256]) {
    bool six = *host == '[';
    size_t n = six ? strcspn(++host, "]") : strcspn(host, ":");
    if (n >= 256) return false;
    memcpy(name, host, n);
    name[n] = '\0';
    return true;
}

static bool is_loopback_name(const char *name) {
    struct in_addr four;
    struct in6_addr six;
    size_t n = strlen(name), end = sizeof ".localhost" - 1;
    if (strcasecmp(name, "localhost") == 0 || (n > end && strcasecmp(name + n - end, ".localhost") == 0)) return true;
    if (inet_pton(AF_INET, name, &four) == 1) return ntohl(four.s_addr) >> 24 == 127;
    return inet_pton(AF_INET6, name, &six) == 1 && IN6_IS_ADDR_LOOPBACK(&six);
}

static bool is_listed(const char *list, const char *name) {
    for (size_t n; *list; list += n + (list[n] == ',')) {
        n = strcspn(list, ",");
        if (strlen(name) == n && strncasecmp(list, name, n) == 0) return true;
    }
    return false;
}

/* A page whose site's name was made to point at 127.0.0.1 after it was loaded would be let through by the browser; but its requests
 * say the name. */
static bool is_for_us(const bw_request *r) {
    char name[256];
    const char *host = bw_request_header(r, "Host");
    if (!host) return true;
    return host_name(host, name) && (is_loopback_name(name) || is_listed(r->services->config->host_names, name));
}

/* A browser says which site's page asks. Reading is stopped by the browser, for nothing allows others to; simple POSTs are not. */
static bool is_of_our_page(const bw_request *r) {
    const char *origin = bw_request_header(r, "Origin"), *host = bw_request_header(r, "Host");
    const char *method = bw_endpoints[r->op].method;
    if (!origin || strcmp(method, "GET") == 0 || strcmp(method, "HEAD") == 0) return true;
    const char *authority = strstr(origin, "://");
    return authority && host && strcasecmp(authority + 3, host) == 0;
}

static bool check_place(bw_request *r) {
    if (!is_for_us(r))
        bw_reply_problem(r, BW_PROBLEM_WRONG_HOST, "a daemon without access tokens answers to names of this machine only, such as localhost; "
                         "others can be set as host-names");
    else if (!is_of_our_page(r))
        bw_reply_problem(r, BW_PROBLEM_CROSS_ORIGIN, "pages of other sites may change nothing here");
    return !r->reply;
}

/* ---- tokens ---- */

/* The last address in the first *size bytes of a list; it is cut off them. False if it is none. */
static bool take_last(const char *list, size_t *size, uint8_t address[16]) {
    char word[64];
    size_t end = *size, begin = end;
    while (begin && list[begin - 1] != ',') begin--;
    *size = begin ? begin - 1 : 0;
    begin += strspn(list + begin, " \t");
    while (end > begin && (list[end - 1] == ' ' || list[end - 1] == '\t')) end--;
    if (end < begin || end - begin >= sizeof word) return false;
    memcpy(word, list + begin, end - begin);
    word[end - begin] = '\0';
    return bw_address_parse(word, address);
}

const char *bw_http_client(bw_request *r, char text[BW_CLIENT_TEXT]) {
    const union MHD_ConnectionInfo *info = MHD_get_connection_info(r->connection, MHD_CONNECTION_INFO_CLIENT_ADDRESS);
    uint8_t address[16], before[16];
    bw_networks proxies;
    if (!info || !bw_address_of(info->client_addr, address)) return "-";
    const char *list = bw_request_list(r, "X-Forwarded-For"); /* a proxy may add a line of its own behind the client's */
    size_t size = list ? strlen(list) : 0;
    if (bw_networks_parse(r->services->config->behind_proxy, &proxies))
        while (size && bw_networks_have(&proxies, address) && take_last(list, &size, before)) memcpy(address, before, 16);
    static const uint8_t four[12] = {[10] = 0xff, [11] = 0xff};
    bool is_four = memcmp(address, four, 12) == 0;
    return inet_ntop(is_four ? AF_INET : AF_INET6, is_four ? address + 12 : address, text, BW_CLIENT_TEXT) ? text : "-";
}

static void tell(bw_request *r, const char *why) {
    static _Atomic int64_t last;
    static atomic_uint kept_back;
    int64_t now = bw_mono_ms(), before = atomic_load(&last);
    char address[BW_CLIENT_TEXT];
    if (now - before < 1000 || !atomic_compare_exchange_strong(&last, &before, now)) { /* a flood of them does not flood the log */
        atomic_fetch_add(&kept_back, 1);
        return;
    }
    bw_event(BW_WARN, "access.denied", "operation=%s why=%s token=%s client=%s kept_back=%u", bw_endpoints[r->op].id, why,
             *r->caller.token ? r->caller.token : "-", bw_http_client(r, address), atomic_exchange(&kept_back, 0));
}

static void reply_unauthorized(bw_request *r, const char *why, const char *detail) {
    char challenge[120];
    tell(r, why);
    bw_reply_problem(r, BW_PROBLEM_UNAUTHORIZED, "%s", detail);
    snprintf(challenge, sizeof challenge, "Bearer realm=\"blockwright\"%s", strcmp(why, "none") == 0 ? "" : ", error=\"invalid_token\"");
    bw_reply_header(r, "WWW-Authenticate", challenge);
}

static void reply_scope(bw_request *r, int scope, const char *detail) {
    char challenge[160];
    int i = 0;
    while (!(scope & 1 << i)) i++;
    tell(r, "scope");
    json_t *problem = bw_problem_document(BW_PROBLEM_INSUFFICIENT_SCOPE, detail);
    if (problem) json_object_set_new(problem, "scope", json_string(bw_scope_names[i]));
    bw_reply_problem_json(r, BW_PROBLEM_INSUFFICIENT_SCOPE, problem);
    snprintf(challenge, sizeof challenge, "Bearer realm=\"blockwright\", error=\"insufficient_scope\", scope=\"%s\"", bw_scope_names[i]);
    bw_reply_header(r, "WWW-Authenticate", challenge);
}

/* The token of the Authorization header; NULL if there is none of the kind. */
static const char *bearer(const bw_request *r) {
    const char *value = bw_request_header(r, "Authorization");
    if (!value || strncasecmp(value, "Bearer ", 7) != 0) return NULL;
    return value + 7 + strspn(value + 7, " ");
}

static bool check_token(bw_request *r) {
    int wanted = bw_endpoints[r->op].scope;
    const char *secret = bearer(r);
    bw_recognized is = secret ? bw_access_recognize(r->services->access, secret, bw_now_ms(), &r->caller) : BW_UNKNOWN;
    if (!wanted) return true;
    if (!secret) reply_unauthorized(r, "none", "this wants an access token, as \"Authorization: Bearer TOKEN\"");
    else if (is == BW_EXPIRED) reply_unauthorized(r, "expired", "the access token has expired");
    else if (is != BW_KNOWN) reply_unauthorized(r, is == BW_REVOKED ? "revoked" : "unknown", "the access token is not valid");
    else if (!bw_scopes_allow(r->caller.scopes, wanted)) reply_scope(r, wanted, "the access token has not the scope that this wants");
    return !r->reply;
}

/* ---- whose it is ---- */

static bool sees_all(const bw_request *r) { return r->caller.scopes & (BW_SCOPE_READ_ALL | BW_SCOPE_ADMIN); }

/* Of a job that the caller may not see nothing is said, not even that it is there. */
static bool check_job(bw_request *r) {
    char owner[BW_OWNER_TEXT];
    bool found;
    if (bw_queue_job_owner(r->services->queue, r->parameters[0], owner, &found) != BW_OK) {
        bw_reply_storage(r);
        return false;
    }
    bool own = found && strcmp(owner, r->caller.owner) == 0;
    if (own || (found && r->caller.scopes & BW_SCOPE_ADMIN)) return true;
    if (!found || !sees_all(r)) bw_reply_problem(r, BW_PROBLEM_NO_SUCH_JOB, "there is no job '%.60s'", r->parameters[0]);
    else if (bw_endpoints[r->op].scope != BW_SCOPE_READ) reply_scope(r, BW_SCOPE_ADMIN, "only its owner may change the job, or an admin");
    return !r->reply;
}

/* What is for everybody does not count. */
static bool check_rate(bw_request *r) {
    int most = r->services->config->owner_rate;
    char seconds[24];
    int64_t wait = most && bw_endpoints[r->op].scope ? bw_rates_ask(r->traffic->rates, r->caller.owner, most, bw_mono_us()) : 0;
    if (!wait) return true;
    bw_reply_problem(r, BW_PROBLEM_TOO_MANY_REQUESTS, "you may make %d requests a second, and %d at once", most, BW_RATE_BURST_SECONDS * most);
    snprintf(seconds, sizeof seconds, "%lld", (long long)(wait + 999999) / 1000000);
    bw_reply_header(r, "Retry-After", seconds);
    return false;
}

bool bw_http_check_access(bw_request *r) {
    if (bw_access_is_open(r->services->access)) {
        r->caller = (bw_caller){.open = true, .scopes = (1 << BW_SCOPE_COUNT) - 1};
        return check_place(r) && check_rate(r);
    }
    return check_token(r) && check_rate(r) && (!bw_endpoints[r->op].of_job || check_job(r));
}

bool bw_http_check_again(bw_request *r) {
    if (bw_access_holds(r->services->access, &r->caller, bw_now_ms())) return true;
    reply_unauthorized(r, "revoked", "the access token is not valid any more");
    return false;
}

bool bw_http_owner_wanted(bw_request *r, const char **owner) {
    *owner = bw_request_query(r, "owner");
    if (sees_all(r)) return true;
    if (*owner && strcmp(*owner, r->caller.owner) != 0) {
        reply_scope(r, BW_SCOPE_READ_ALL, "the access token shows its own owner's jobs only");
        return false;
    }
    *owner = r->caller.owner;
    return true;
}

/* ---- blobs ---- */

bool bw_http_has_blob(void *store, const char *sha256) { return bw_store_has_blob(store, sha256); }

int bw_http_open_blob(const bw_request *r, const char *sha256, uint64_t *bytes, bool *fresh) {
    bool open = r->caller.open, owns; /* open: then also what was uploaded before blobs had owners */
    int64_t used, keep = (int64_t)r->services->config->keep_blobs_seconds * 1000;
    bw_status status = bw_queue_owns_blob(r->services->queue, r->caller.owner, sha256, &owns, &used);
    if (status != BW_OK) owns = false;
    *fresh = owns && (!keep || used >= bw_now_ms() - keep / 2);
    if (owns || open) return bw_store_open_blob(r->services->store, sha256, bytes);
    errno = status == BW_OK ? ENOENT : EIO;
    return -1;
}

typedef struct {
    char owner[BW_OWNER_TEXT], sha256[BW_SHA256_TEXT];
    bw_new_blob row;
    void (*then)(bw_request *r);
    bw_store *store;
    int refused; /* the file of one that did not fit and is nobody's; -1: none */
} keeping;

static void keeping_free(void *state) {
    keeping *k = state;
    if (k->refused >= 0) close(k->refused);
    free(k);
}

static bool is_present(void *user, const char *sha256) { return bw_http_has_blob(((keeping *)user)->store, sha256); }

static void take_refused(void *user, const char *sha256) {
    keeping *k = user;
    k->refused = bw_store_unlink_blob(k->store, sha256);
}

static void drop_refused(bw_request *r) {
    keeping *k = r->state;
    if (k->refused >= 0) close(k->refused);
    k->refused = -1;
}

static void reply_refused(bw_request *r) { bw_http_reply_too_large(r, ((keeping *)r->state)->row.in_force.bytes); }

static bw_status write_kept(bw_writer *w, void *user) { return bw_write_blob(w, &((keeping *)user)->row); }

static void kept(bw_request *r) {
    keeping *k = r->state;
    if (r->written != BW_OK) bw_reply_storage(r);
    else if (k->row.lacking) bw_reply_problem(r, BW_PROBLEM_NO_SUCH_BLOB, "the blob %s is gone; upload it again", k->sha256);
    else if (!k->row.fits) bw_request_offload(r, drop_refused, reply_refused); /* else what nobody may have would fill the disk */
    else k->then(r);
}

/* What the caller may have, and has. False after a reply. */
static bool ask_owner(bw_request *r, bw_limits *limits, bw_owner *has) {
    const bw_config *config = r->services->config;
    bw_queue *queue = r->services->queue;
    *limits = (bw_limits){.queued = config->owner_jobs, .bytes = (int64_t)config->owner_bytes};
    if (bw_queue_limits(queue, r->caller.owner, limits) != BW_OK || bw_queue_owner(queue, r->caller.owner, has) != BW_OK) bw_reply_storage(r);
    return !r->reply;
}

bool bw_http_blob_fits(bw_request *r, uint64_t bytes) {
    bw_limits limits;
    bw_owner has;
    if (ask_owner(r, &limits, &has) && limits.bytes && (bytes > (uint64_t)limits.bytes || has.bytes > limits.bytes - (int64_t)bytes))
        bw_http_reply_too_large(r, limits.bytes);
    return !r->reply;
}

bool bw_http_job_fits(bw_request *r) {
    bw_limits limits;
    bw_owner has;
    if (ask_owner(r, &limits, &has) && limits.queued && has.waiting + has.running >= limits.queued) bw_http_reply_too_many(r, limits.queued);
    return !r->reply;
}

void bw_http_keep_blob(bw_request *r, const char *sha256, uint64_t bytes, void (*then)(bw_request *r)) {
    keeping *k = calloc(1, sizeof *k);
    if (!k) {
        bw_reply_json(r, 500, NULL);
        return;
    }
    memcpy(k->owner, r->caller.owner, sizeof k->owner);
    snprintf(k->sha256, sizeof k->sha256, "%s", sha256);
    k->row = (bw_new_blob){.owner = k->owner, .sha256 = k->sha256, .bytes = (int64_t)bytes, .now = bw_now_ms(),
                           .limits.bytes = (int64_t)r->services->config->owner_bytes, .present = is_present, .refused = take_refused, .user = k};
    k->then = then;
    k->store = r->services->store;
    k->refused = -1;
    r->state = k;
    r->state_free = keeping_free;
    bw_request_write(r, write_kept, kept);
}

const char *bw_http_kept_blob(const bw_request *r, uint64_t *bytes) {
    const keeping *k = r->state;
    *bytes = (uint64_t)k->row.bytes;
    return k->sha256;
}
