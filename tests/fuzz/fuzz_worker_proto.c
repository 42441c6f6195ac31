/* The daemon's decoder of worker frames on arbitrary bytes, in pieces whose sizes the input chooses; a result that is JSON becomes the
 * problem document of a failed job. */
#include "fuzz.h"

#include <string.h>

#include "server/failure.h"
#include "server/worker/worker_proto.h"

volatile unsigned sink; /* keeps the reading of payloads */

static void judge(const bw_frame *frame) {
    json_t *result = json_loadb((const char *)frame->data, frame->size, JSON_REJECT_DUPLICATES, NULL), *element;
    if (!result) return;
    bw_problem problem = bw_failure_problem(json_string_value(json_object_get(result, "status")));
    char *text = bw_failure_json(problem, "trace", NULL, result, NULL);
    json_t *document = text ? json_loads(text, 0, NULL) : NULL;
    FUZZ_EXPECT(json_is_string(json_object_get(document, "type")) && json_is_string(json_object_get(document, "class")));
    size_t i;
    json_array_foreach(json_object_get(document, "elements"), i, element)
        FUZZ_EXPECT(json_is_string(json_object_get(element, "kind")) && json_is_integer(json_object_get(element, "id")));
    json_decref(document), json_decref(result);
    free(text);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static bw_decoder d;
    bw_frame frame;
    int results = 0, frames = 0;
    bw_decoder_init(&d);
    while (size > 1 && d.status == BW_OK) {
        size_t room, n = (size_t)*data++ * 97 + 1;
        void *space = bw_decoder_space(&d, &room);
        FUZZ_EXPECT(room > 0);
        size--;
        if (n > size) n = size;
        if (n > room) n = room;
        memcpy(space, data, n);
        bw_decoder_filled(&d, n);
        data += n;
        size -= n;
        while (bw_decoder_next(&d, &frame)) {
            FUZZ_EXPECT(!results && frame.size <= BW_FRAME_MOST && (frames++ == 0) == (frame.type == BW_FRAME_HELLO));
            if (frame.type == BW_FRAME_PROGRESS) FUZZ_EXPECT(bw_frame_progress(&frame) >= 0 && bw_frame_progress(&frame) <= 1);
            for (size_t i = 0; i < frame.size; i++) sink += frame.data[i];
            results += frame.type == BW_FRAME_RESULT;
            if (frame.type == BW_FRAME_RESULT) judge(&frame);
        }
    }
    return 0;
}
