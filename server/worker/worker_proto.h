/* What a worker and the daemon say to each other over the worker's socket (descriptor BW_WORKER_CHANNEL).
 *
 * A frame is 8 bytes of header and a payload:
 *
 *     0   'B' 'W'
 *     2   version, BW_WORKER_PROTOCOL
 *     3   type
 *     4   size of the payload, 32 bits, little endian
 *
 *     type       payload                                              from the worker
 *     HELLO      JSON {"stage": name, "version": n,                   first, once; before it the worker has looked at nothing
 *                "sandbox": {...}} (sandbox.h)
 *     PROGRESS   IEEE double, little endian, 0..1                     any number
 *     LOG        one line of text without its newline                 any number
 *     RESULT     JSON {"status": "ok"} or an error as bw_error_json   last, once; ok with "cut": true says that a search ended
 *                                                                     early because of SIGUSR1, so the output is of this run only;
 *                                                                     "need": bytes of memory the next stage will need about;
 *                                                                     "kind": what the job's input was found to be, tet or hex
 *     NOTE       the best a search has found so far, for people       any number; replaces the one before
 *
 * Started with --stage trial, the worker enters its sandbox, says HELLO (version 0) and RESULT ok, and ends: so the daemon learns
 * what a sandbox it can have here.
 *
 * The daemon's words are signals: SIGTERM cancels, SIGUSR1 (never before HELLO) asks a search to settle for the best found.
 *
 * The daemon believes nothing of it without looking: sizes, order and JSON are checked, and RESULT ok counts only if the
 * process then ends by itself and its output is there. To change the frames raise BW_WORKER_PROTOCOL; daemon and worker
 * are installed together, and a worker of another version fails its stage with worker-protocol.
 */
#ifndef BW_SERVER_WORKER_PROTO_H
#define BW_SERVER_WORKER_PROTO_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/status.h"

enum { BW_WORKER_PROTOCOL = 2, BW_FRAME_HEADER = 8, BW_FRAME_MOST = 65536, BW_FRAME_NOTE_MOST = 200 };
#define BW_WORKER_TRIAL "trial"
/* Descriptors a worker is started with; the last is open only if there is a file of parameters. */
enum { BW_WORKER_CHANNEL = 3, BW_WORKER_INPUT, BW_WORKER_PARAMETERS };

typedef enum { BW_FRAME_HELLO = 1, BW_FRAME_PROGRESS, BW_FRAME_LOG, BW_FRAME_RESULT, BW_FRAME_NOTE } bw_frame_type;

typedef struct {
    bw_frame_type type;
    size_t size;
    const unsigned char *data; /* borrowed from the decoder until its next call */
} bw_frame;

typedef struct {
    unsigned char buffer[BW_FRAME_HEADER + BW_FRAME_MOST];
    size_t start, end; /* what has arrived and was not yet taken */
    bool hello, result; /* seen */
    bw_status status;   /* first violation; nothing is decoded after it */
} bw_decoder;

void bw_decoder_init(bw_decoder *decoder);
/* Where arriving bytes are to be put and how many fit (0 only if frames wait to be taken); then tell how many came. */
void *bw_decoder_space(bw_decoder *decoder, size_t *room);
void bw_decoder_filled(bw_decoder *decoder, size_t size);
/* The next complete frame, or false: then decoder->status tells whether more bytes are needed (BW_OK) or the peer broke
 * the protocol (BW_E_VERSION, BW_E_SYNTAX, BW_E_COUNT, BW_E_NUMBER). */
bool bw_decoder_next(bw_decoder *decoder, bw_frame *frame);
double bw_frame_progress(const bw_frame *frame); /* of a PROGRESS frame: checked to be in 0..1 */

/* Sends one frame, blocking. False if the daemon is gone. Longer LOG and NOTE lines are cut, longer RESULTs refused. */
bool bw_send_frame(int channel, bw_frame_type type, const void *data, size_t size);
bool bw_send_progress(int channel, double fraction);

#endif
