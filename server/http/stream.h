/* Answers that go on while things happen: text/event-stream, the Server-Sent Events of the HTML standard.
 *
 * An operation starts one with a source. Whenever the client has taken all there was, the source is asked for more on an HTTP thread; while
 * it has nothing the request is suspended, and asked again at news of the topic (watch.h). So a stream that is idle has no thread, no
 * buffer and no descriptor but its connection's; and one whose client is slow has at most what one call of the source has made, for the
 * source reads again from the queue or a file what it needs later, and of progress only the last.
 *
 * What goes over the line: first `retry:`, then events. An event with a number has it as `id:`; a client that connects again with the
 * last number as Last-Event-ID gets what follows: so an event with a number is made from what is kept, and one call of bw_stream_event is
 * all of it. Every `stream-comment` (configuration) a comment goes out; then also it is seen whether the client is still there.
 * Whoever has lost his token hears nothing more, and is told so then at the latest.
 *
 * A stream ends when its source says so, when the client goes, does not read for BW_IDLE_SECONDS, or loses its token, and when the daemon
 * stops.
 */
#ifndef BW_SERVER_HTTP_STREAM_H
#define BW_SERVER_HTTP_STREAM_H

#include "server/http/request.h"

enum { BW_STREAM_RETRY_MS = 2000 };

typedef struct bw_stream bw_stream;
typedef struct bw_streams bw_streams; /* how many each owner has */

typedef enum { BW_STREAM_ON, BW_STREAM_END, BW_STREAM_BROKEN } bw_stream_state;

typedef struct {
    /* Adds what there is to tell, some KiB at most, with the functions below; nothing if there is nothing new. After END what was added is
     * still sent; BROKEN hangs up, so that the client comes again. */
    bw_stream_state (*more)(bw_stream *stream, void *state);
    void (*release)(void *state); /* may be called after the request is gone */
    void *state;
    const char *topic; /* id of a job, "": any; copied */
} bw_stream_source;

bw_status bw_streams_open(bw_streams **streams);
void bw_streams_close(bw_streams *streams); /* all streams are gone */

/* What the client has seen: Last-Event-ID, or the query's `after`, which is for clients that cannot set headers; `otherwise` if neither is
 * given. False after a reply. */
bool bw_stream_position(bw_request *request, int64_t otherwise, int64_t *position);
/* Replies with a stream, or with 429 if the owner has as many as it may have. Takes source->state in any case. */
void bw_stream_start(bw_request *request, const bw_stream_source *source);

/* For sources. `data` may have several lines; id < 0: none. */
void bw_stream_event(bw_stream *stream, const char *event, int64_t id, const char *data, size_t size);
void bw_stream_json(bw_stream *stream, const char *event, int64_t id, json_t *data); /* takes data; NULL: out of memory */
void bw_stream_comment(bw_stream *stream);
bool bw_stream_is_empty(const bw_stream *stream); /* nothing has been added that is not sent */

#endif
