/* What can be asked over DATA/control. Requests come from the operator, but from another version of the program perhaps: all is checked. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "server/admin.h"
#include "server/backup.h"
#include "server/clock.h"
#include "server/log.h"

static const char *text_of(const json_t *object, const char *name) {
    const char *text = json_string_value(json_object_get(object, name));
    return text ? text : "";
}

static json_t *failed(char error[BW_ADMIN_ERROR], const char *why) {
    snprintf(error, BW_ADMIN_ERROR, "%s", why);
    return NULL;
}

/* ---- tokens ---- */

static void set_time(json_t *object, const char *name, int64_t ms) {
    char text[BW_TIME_TEXT];
    if (ms) json_object_set_new(object, name, json_string(bw_time_text(ms, text)));
}

static json_t *scopes_json(int scopes) {
    json_t *list = json_array();
    for (int i = 0; i < BW_SCOPE_COUNT; i++)
        if (scopes & 1 << i) json_array_append_new(list, json_string(bw_scope_names[i]));
    return list;
}

static json_t *token_json(const bw_token *t, int64_t now) {
    const char *state = t->revoked ? "revoked" : t->expires && t->expires <= now ? "expired" : "valid";
    json_t *o = json_pack("{s:s, s:s, s:s, s:s, s:o}", "id", t->id, "owner", t->owner, "note", t->note ? t->note : "", "state", state,
                          "scopes", scopes_json(t->scopes));
    set_time(o, "created", t->created);
    set_time(o, "expires", t->expires);
    set_time(o, "revoked", t->revoked);
    return o;
}

static json_t *token_create(const bw_admin_services *s, const json_t *request, char error[BW_ADMIN_ERROR]) {
    const char *owner = text_of(request, "owner"), *note = text_of(request, "note");
    char secret[BW_TOKEN_TEXT];
    bw_token token = {.scopes = bw_scopes_parse(text_of(request, "scopes"))};
    const json_t *expires = json_object_get(request, "expires_ms");
    json_int_t life = json_integer_value(expires);
    if (!bw_is_owner_name(owner))
        return failed(error, "an owner's name has 1 to 64 of A-Z a-z 0-9 . _ @ + - and begins with a letter or digit");
    if (!token.scopes) return failed(error, "scopes are a list, without blanks, of: submit, read, read-all, admin");
    if (strlen(note) > BW_TOKEN_NOTE_MOST) return failed(error, "the note has more than 200 bytes");
    if (expires && !json_is_integer(expires)) return failed(error, "the token's life is a whole number of milliseconds");
    if (life < 0) return failed(error, "the token would have expired already");
    if (life > BW_TOKEN_LIFE_MOST) return failed(error, "a token lives 100000 weeks at most, or without an end");
    if (bw_token_make(&token, bw_now_ms(), secret) != BW_OK) return failed(error, "there are no random bits to be had");
    snprintf(token.owner, sizeof token.owner, "%s", owner);
    token.note = (char *)note;
    token.expires = life ? token.created + life : 0;
    if (bw_queue_write(s->queue, bw_write_token, &token) != BW_OK || bw_access_refresh(s->access) != BW_OK)
        return failed(error, "the database does not take it");
    bw_event(BW_INFO, "token.created", "token=%s owner=%s", token.id, token.owner);
    json_t *answer = token_json(&token, token.created);
    json_object_set_new(answer, "token", json_string(secret));
    explicit_bzero(secret, sizeof secret);
    return answer;
}

static json_t *token_list(const bw_admin_services *s, const json_t *request, char error[BW_ADMIN_ERROR]) {
    bw_token *tokens;
    size_t count;
    json_t *list = json_array();
    (void)request;
    if (bw_queue_tokens(s->queue, &tokens, &count) != BW_OK) {
        json_decref(list);
        return failed(error, "the database does not read");
    }
    for (size_t i = 0; i < count; i++) json_array_append_new(list, token_json(&tokens[i], bw_now_ms()));
    bw_tokens_free(tokens, count);
    return json_pack("{s:o}", "tokens", list);
}

static json_t *token_revoke(const bw_admin_services *s, const json_t *request, char error[BW_ADMIN_ERROR]) {
    bw_revocation r = {.id = text_of(request, "id"), .now = bw_now_ms()};
    if (bw_queue_write(s->queue, bw_write_revocation, &r) != BW_OK || bw_access_refresh(s->access) != BW_OK)
        return failed(error, "the database does not take it");
    if (!r.found) return failed(error, "there is no token of this id; blockwrightd token list shows them");
    bw_event(BW_INFO, "token.revoked", "token=%s", r.id);
    return json_pack("{s:s}", "id", r.id);
}

/* ---- owners ---- */

/* The limit of this name: a number, INT64_MAX for "none", -1 for "standard"; what it was if it is not given. False: it is none of these. */
static bool read_limit(const json_t *request, const char *name, int64_t *limit) {
    const json_t *value = json_object_get(request, name);
    const char *word = json_string_value(value);
    if (!value) return true;
    if (word) *limit = strcmp(word, "none") == 0 ? INT64_MAX : -1;
    else *limit = json_integer_value(value);
    return word ? strcmp(word, "none") == 0 || strcmp(word, "standard") == 0 : json_is_integer(value) && *limit >= 1;
}

static bool find_quota(const bw_quota *quotas, size_t count, const char *owner, bw_quota *quota) {
    for (size_t i = 0; i < count; i++)
        if (strcmp(quotas[i].owner, owner) == 0) {
            *quota = quotas[i];
            return true;
        }
    memset(quota, 0, sizeof *quota);
    snprintf(quota->owner, sizeof quota->owner, "%s", owner);
    quota->limits = (bw_limits){-1, -1, -1};
    return false;
}

static json_t *limit_json(int64_t limit) { return limit < 0 ? json_string("standard") : limit == INT64_MAX ? json_string("none") : json_integer(limit); }

static json_t *quota_json(const bw_quota *q) {
    return json_pack("{s:s, s:o, s:o, s:o}", "owner", q->owner, "queued", limit_json(q->limits.queued), "running", limit_json(q->limits.running),
                     "bytes", limit_json(q->limits.bytes));
}

static json_t *owner_set(const bw_admin_services *s, const json_t *request, char error[BW_ADMIN_ERROR]) {
    const char *owner = text_of(request, "owner");
    bw_quota *quotas, quota;
    size_t count;
    if (!bw_is_owner_name(owner)) return failed(error, "this is no name of an owner");
    if (bw_queue_quotas(s->queue, &quotas, &count) != BW_OK) return failed(error, "the database does not read");
    find_quota(quotas, count, owner, &quota);
    free(quotas);
    if (!read_limit(request, "queued", &quota.limits.queued) || !read_limit(request, "running", &quota.limits.running) ||
        !read_limit(request, "bytes", &quota.limits.bytes))
        return failed(error, "a limit is a whole number from 1, none, or standard");
    if (bw_queue_write(s->queue, bw_write_quota, &quota) != BW_OK) return failed(error, "the database does not take it");
    if (s->dispatch) bw_dispatch_wake(s->dispatch); /* more of his may run now */
    bw_event(BW_INFO, "owner.limits", "owner=%s queued=%" PRId64 " running=%" PRId64 " bytes=%" PRId64, owner, quota.limits.queued, quota.limits.running,
             quota.limits.bytes);
    return quota_json(&quota);
}

static json_t *owner_json(const bw_admin_services *s, const bw_quota *quota) {
    bw_owner has;
    if (bw_queue_owner(s->queue, quota->owner, &has) != BW_OK) return NULL;
    json_t *o = quota_json(quota);
    json_object_set_new(o, "has", json_pack("{s:I, s:I, s:I, s:I}", "waiting", (json_int_t)has.waiting, "running", (json_int_t)has.running, "finished",
                                            (json_int_t)has.finished, "bytes", (json_int_t)has.bytes));
    return o;
}

static json_t *owner_list(const bw_admin_services *s, const json_t *request, char error[BW_ADMIN_ERROR]) {
    char(*owners)[BW_OWNER_TEXT] = NULL;
    bw_quota *quotas = NULL, quota;
    size_t owner_count = 0, quota_count = 0;
    bw_status status = bw_queue_owners(s->queue, &owners, &owner_count);
    (void)request;
    if (status == BW_OK) status = bw_queue_quotas(s->queue, &quotas, &quota_count);
    json_t *list = json_array();
    for (size_t i = 0; status == BW_OK && i < owner_count; i++) {
        find_quota(quotas, quota_count, owners[i], &quota);
        if (json_array_append_new(list, owner_json(s, &quota)) != 0) status = BW_E_IO;
    }
    free(owners);
    free(quotas);
    if (status == BW_OK) return json_pack("{s:o}", "owners", list);
    json_decref(list);
    return failed(error, "the database does not read");
}

/* ---- retention ---- */

static json_t *gc(const bw_admin_services *s, const json_t *request, char error[BW_ADMIN_ERROR]) {
    bool dry = json_is_true(json_object_get(request, "dry_run"));
    bw_policy policy = bw_retention_policy(s->config, bw_now_ms());
    bw_retention_report report;
    if (bw_retention_pass(s->retention, &policy, dry, &report) != BW_OK) return failed(error, "the database does not take it");
    if (bw_stopped(s->stopping)) return failed(error, "the daemon is stopping; what is due goes when it runs again");
    json_t *kinds = json_object();
    for (int i = 0; i < BW_KEEP_COUNT; i++)
        json_object_set_new(kinds, bw_keep_names[i], json_pack("{s:I, s:I}", "count", (json_int_t)report.kinds[i].count, "bytes",
                                                               (json_int_t)report.kinds[i].bytes));
    return json_pack("{s:b, s:o, s:I, s:I, s:I, s:I}", "dry_run", dry, "collected", kinds, "cache_bytes", (json_int_t)report.cache_bytes,
                     "cache_most", (json_int_t)policy.cache_most, "held", (json_int_t)report.held, "held_bytes", (json_int_t)report.held_bytes);
}

static json_t *backup(const bw_admin_services *s, const json_t *request, char error[BW_ADMIN_ERROR]) {
    bw_backup_report report;
    bool files = json_is_true(json_object_get(request, "with_files"));
    if (bw_backup_make(s->config->data, s->queue, s->retention, text_of(request, "file"), files, s->stopping, &report, error) != BW_OK)
        return NULL;
    bw_event(BW_INFO, "backup.made", "jobs=%" PRId64 " files=%" PRId64 " bytes=%" PRId64 " missing=%" PRId64 " with_files=%d", report.jobs, report.files,
             report.bytes, report.missing, files);
    return json_pack("{s:I, s:I, s:I, s:I}", "jobs", (json_int_t)report.jobs, "files", (json_int_t)report.files, "bytes", (json_int_t)report.bytes,
                     "missing", (json_int_t)report.missing);
}

const bw_admin_command bw_admin_commands[] = {
    {"backup", backup},
    {"gc", gc},
    {"token create", token_create},
    {"token list", token_list},
    {"token revoke", token_revoke},
    {"owner set", owner_set},
    {"owner list", owner_list},
    {NULL, NULL},
};
