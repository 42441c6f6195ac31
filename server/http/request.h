/* A request on its way through the daemon.
 *
 *     begin   headers are there, no byte of the body: routing, framing rules, size; uploads are opened
 *     body    unpacked if it is coded, then collected (JSON, at most BW_BODY_MOST) or given to r->take
 *     handle  body complete: the operation's function makes the reply, or suspends the request
 *     resume  after bw_request_resume(): r->resume, or else handle again
 * A reply made in an earlier step ends the request: at once if the client waits for "100 Continue" or the body is large, else
 * after the body has been read and thrown away, for clients that only listen when they have spoken.
 *
 * An HTTP thread serves many connections and must not wait. An operation that has to (for a commit, for the end of a job) calls
 * bw_request_suspend() before it hands the request on, and returns without a reply; whoever it handed it to calls bw_request_resume(),
 * from any thread, exactly once. Suspended requests do not time out, and nobody notices when their client goes away; the reply is lost then.
 */
#ifndef BW_SERVER_HTTP_REQUEST_H
#define BW_SERVER_HTTP_REQUEST_H

#include <jansson.h>
#include <microhttpd.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>

#include "bw_api.h"
#include "server/access.h"
#include "server/http/coding.h"
#include "server/http/guard.h"
#include "server/http/http.h"
#include "server/partial.h"
#include "server/pool.h"

enum {
    BW_BODY_MOST = 65536,
    BW_PARAMETER_MOST = 128,
    BW_WAIT_MOST = 60,       /* seconds */
    BW_ROOM_KEPT = 64 << 20, /* bytes of the disk that uploads leave to the queue */
};

/* All requests under way. */
typedef struct {
    const bw_services *services;
    pthread_mutex_t lock;
    pthread_cond_t changed; /* a count has become 0 */
    unsigned active, suspended; /* the latter also while an operation's function runs, which may suspend */
    atomic_bool ending;         /* the daemon is stopping: no request is begun any more */
    bool closed;                /* and the library: no such function is called any more */
    bw_pool *pool;         /* for what would hold up an HTTP thread */
    bw_partials *partials; /* uploads that can be resumed */
    struct bw_streams *streams; /* stream.h */
    struct bw_rates *rates;     /* rate.h */
} bw_traffic;

typedef struct bw_request {
    bw_traffic *traffic;
    const bw_services *services;
    struct MHD_Connection *connection;
    bw_guarded *guarded; /* the same */
    bw_op op;
    bw_caller caller; /* who asks; set before anything of the operation */
    char parameters[2][BW_PARAMETER_MOST]; /* the variable segments of the path, in order */
    bool head, reads;                      /* HEAD: the same as GET, without the content; one of the two */
    bool has_length, unclear;              /* unclear: where the body ends */
    uint64_t length;                       /* Content-Length */
    uint64_t received;                     /* of the body, as it came */
    bw_unpacker *unpacker;                 /* NULL: the body is not coded */
    uint64_t sent;                         /* of the answer's content, as it was made ready to go */
    int64_t started, started_us;           /* bw_mono_ms, bw_mono_us */
    char *body; /* NUL-terminated; NULL until the first byte */
    size_t body_size, body_room;
    size_t body_most; /* bytes; begin may change it */
    bool (*take)(struct bw_request *, const char *data, size_t size); /* gets the content of the body; false after a reply. NULL: collected */
    bw_upload *upload;
    struct bw_header_list *lists; /* made by bw_request_list */
    struct MHD_Response *reply; /* NULL until made */
    unsigned reply_status;
    bool sized;                          /* the reply has so many bytes, at most: */
    uint64_t reply_bytes;
    bw_pool_work work;
    void (*offloaded)(struct bw_request *);
    bool held;                           /* suspended in the call under way; of the HTTP thread only */
    void (*resume)(struct bw_request *); /* NULL: handle */
    bw_write_fn write;                   /* of bw_request_write */
    bw_status written;                   /* what has become of it */
    void *state;                         /* of the operation, between its calls */
    void (*state_free)(void *state);     /* may be NULL */
} bw_request;

/* From handle or resume only (or from a reader of a streamed reply), on the HTTP thread. */
void bw_request_suspend(bw_request *request);
/* The request may be gone when this returns. */
void bw_request_resume(bw_request *request);

/* Has the queue's thread run fn(writer, r->state) in a transaction, and calls `then` when that is durable (r->written is BW_OK) or has
 * failed. Suspends the request. */
void bw_request_write(bw_request *request, bw_write_fn fn, void (*then)(bw_request *));
/* Suspends the request, has `work` called on a thread that may wait for the disk, and resumes it with `then`. `work` touches the request's
 * state, store and files, and makes no reply. */
void bw_request_offload(bw_request *request, void (*work)(bw_request *), void (*then)(bw_request *));
/* For who has just written `size` bytes, `written` in all: does the disk have room for more? Asked only now and then. */
bool bw_request_room_left(const bw_request *request, uint64_t written, size_t size);

const char *bw_request_header(const bw_request *request, const char *name); /* the first of the name; NULL if absent */
/* The value of a header that is a list: of all its lines, in their order, with commas between them (RFC 9110, 5.3). NULL if absent, or out of
 * memory, which is answered then. Borrowed, until the request ends. */
const char *bw_request_list(bw_request *request, const char *name);
const char *bw_request_query(const bw_request *request, const char *name);
/* A whole number in [low, high] from the query; `otherwise` if it is not given. False after a reply. */
bool bw_request_number(bw_request *request, const char *name, int64_t low, int64_t high, int64_t otherwise, int64_t *value);
/* RFC 7240: seconds of `Prefer: wait=SECONDS`, at most BW_WAIT_MOST; 0 if there is none, or none that is understood. */
int bw_request_wait_preferred(bw_request *request);

/* For http.c: what libmicrohttpd calls; `user` is the bw_traffic. */
enum MHD_Result bw_request_on_call(void *user, struct MHD_Connection *connection, const char *url, const char *method,
                                   const char *version, const char *data, size_t *size, void **state);
void bw_request_on_end(void *user, struct MHD_Connection *connection, void **state, enum MHD_RequestTerminationCode code);

#endif
