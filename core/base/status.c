#include "base/status.h"

#include <string.h>

static const struct {
    const char *code, *text;
    bw_class class_;
    int exit, http;
} table[BW_STATUS_COUNT] = {
#define BW_STATUS(name, code, class, exit, http, text) {code, text, BW_CLASS_##class, exit, http},
#include "base/status.def"
#undef BW_STATUS
};

static bw_status known(bw_status s) { return (unsigned)s < BW_STATUS_COUNT ? s : BW_E_INTERNAL; }

const char *bw_status_code(bw_status status) { return table[known(status)].code; }
const char *bw_status_text(bw_status status) { return table[known(status)].text; }
bw_class bw_status_class(bw_status status) { return table[known(status)].class_; }
int bw_status_exit(bw_status status) { return table[known(status)].exit; }
int bw_status_http(bw_status status) { return table[known(status)].http; }

const char *bw_class_name(bw_class class_) {
    static const char *const names[] = {"none", "input", "algorithm", "limit", "system"};
    return (unsigned)class_ < sizeof names / sizeof *names ? names[class_] : "system";
}

bw_status bw_status_from_code(const char *code) {
    for (int s = 0; s < BW_STATUS_COUNT; s++)
        if (!strcmp(table[s].code, code)) return (bw_status)s;
    return BW_E_INTERNAL;
}
