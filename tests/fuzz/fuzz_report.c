/* A stored report on arbitrary bytes: what is read is written to JSON that reads back the same. */
#include "fuzz.h"

#include <string.h>

#include "format/report_json.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static bw_report report, again;
    bw_context ctx;
    bw_context_init(&ctx);
    char *bytes = malloc(size ? size : 1); /* no NUL behind it */
    memcpy(bytes, data, size);
    bw_status status = bw_report_from_json(&ctx, bytes, size, &report);
    free(bytes);
    FUZZ_EXPECT(status == ctx.error.status && (status == BW_OK || status == BW_E_VERSION));
    if (status != BW_OK) return 0;
    char *text = bw_report_to_json(&report);
    FUZZ_EXPECT(text && bw_report_from_json(&ctx, text, strlen(text), &again) == BW_OK);
    char *second = bw_report_to_json(&again);
    FUZZ_EXPECT(second && !strcmp(text, second));
    FUZZ_EXPECT(again.stage_count == report.stage_count && again.result_count == report.result_count);
    free(text), free(second);
    return 0;
}
