/* A job described by a query (job_create, with the input as its body), as the object that a JSON body would have been. */
#include <string.h>

#include "server/http/job_read.h"
#include "server/http/reply.h"
#include "server/joboptions.h"

typedef struct {
    bw_request *request;
    json_t *body;
} query;

static json_t *member(json_t *body, const char *name, json_t *(*make)(void)) {
    if (!json_object_get(body, name)) json_object_set_new(body, name, make());
    return json_object_get(body, name);
}

static bool is_one_of(const char *name, const char *const *names) {
    while (*names && strcmp(*names, name) != 0) names++;
    return *names;
}

/* What is neither a member of the job nor an option is a limit: routes.c has refused all other names. */
static enum MHD_Result take(void *user, enum MHD_ValueKind kind, const char *name, const char *value) {
    static const char *const texts[] = {"name", "parameters", NULL}, *const scalars[] = {"priority", "pinned", NULL};
    query *q = user;
    const char *text = value ? value : "";
    json_t *into = q->body;
    int failed = -1;
    (void)kind;
    if (strcmp(name, "tag") == 0) {
        failed = json_array_append_new(member(q->body, "tags", json_array), json_string(text));
    } else {
        bool whole = is_one_of(name, texts), scalar = is_one_of(name, scalars), option = bw_joboptions_has(name);
        if (!whole && !scalar) into = member(q->body, option ? "options" : "limits", json_object);
        if (!json_object_get(into, name))
            failed = json_object_set_new(into, name, whole ? json_string(text) : option ? bw_joboptions_value(name, text) : bw_joboptions_scalar(text));
    }
    if (failed) bw_reply_problem(q->request, BW_PROBLEM_INVALID_PARAMETER, "%s stands there twice, or is not UTF-8", name);
    return failed ? MHD_NO : MHD_YES;
}

json_t *bw_http_query_job(bw_request *r) {
    query q = {r, json_object()};
    MHD_get_connection_values(r->connection, MHD_GET_ARGUMENT_KIND, take, &q);
    if (!r->reply) return q.body;
    json_decref(q.body);
    return NULL;
}
