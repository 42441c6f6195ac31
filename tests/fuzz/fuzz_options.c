/* Job options on arbitrary JSON, by both that read them. What the daemon accepts has one form, fits where it has to go, names cache entries,
 * and is accepted by the core; the core refuses everything else with its reason. */
#include "fuzz.h"

#include <string.h>

#include "blockwright.h"
#include "server/joboptions.h"
#include "server/worker/spawner.h"

/* The reason may quote the input; it has to reach the daemon as JSON all the same. */
static void expect_told(const bw_context *ctx) {
    char *text = bw_error_json(ctx);
    json_t *error = text ? json_loads(text, JSON_REJECT_DUPLICATES, NULL) : NULL;
    FUZZ_EXPECT(json_string_length(json_object_get(error, "message")) > 0);
    json_decref(error);
    free(text);
}

static bw_status core_reads(const char *json, size_t size) {
    bw_context ctx;
    bw_options options;
    bw_context_init(&ctx);
    bw_options_defaults(&options);
    bw_status status = bw_options_from_json(&ctx, &options, json, size);
    FUZZ_EXPECT(status == ctx.error.status && (status == BW_OK || status == BW_E_USAGE));
    if (status != BW_OK) expect_told(&ctx);
    return status;
}

static void expect_one_form(const json_t *all) {
    char detail[200], key[BW_SHA256_TEXT], same[BW_SHA256_TEXT];
    static const char input[] = "0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef";
    json_t *again;
    FUZZ_EXPECT(json_object_size(all) == BW_API_OPTION_COUNT);
    char *text = json_dumps(all, JSON_COMPACT | JSON_SORT_KEYS | JSON_REAL_PRECISION(17)); /* as job_create.c stores it */
    FUZZ_EXPECT(text && strlen(text) < BW_OPTIONS_TEXT && core_reads(text, strlen(text)) == BW_OK);
    json_t *stored = json_loads(text, 0, NULL);
    FUZZ_EXPECT(bw_joboptions_check(stored, &again, detail, sizeof detail));
    for (int s = 0; s < BW_API_STAGE_COUNT; s++) {
        FUZZ_EXPECT(bw_cache_key(input, "", all, s, "", key) && bw_cache_key(input, "", again, s, "", same));
        FUZZ_EXPECT(bw_is_sha256(key) && !strcmp(key, same));
    }
    FUZZ_EXPECT(bw_joboptions_stages(all) >= 1 && bw_joboptions_stages(all) <= BW_API_STAGE_COUNT);
    json_decref(again), json_decref(stored);
    free(text);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    char detail[200] = "";
    char *bytes = malloc(size ? size : 1); /* no NUL behind it */
    memcpy(bytes, data, size);
    core_reads(bytes, size);
    json_t *all = NULL, *given = json_loadb(bytes, size, JSON_REJECT_DUPLICATES, NULL);
    if (given && bw_joboptions_check(given, &all, detail, sizeof detail)) expect_one_form(all);
    else if (given) FUZZ_EXPECT(*detail);
    json_decref(all), json_decref(given);
    free(bytes);
    return 0;
}
