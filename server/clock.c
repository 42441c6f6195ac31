#include "server/clock.h"

#include <stdio.h>
#include <time.h>

static int64_t read_clock(clockid_t id) {
    struct timespec t;
    clock_gettime(id, &t);
    return (int64_t)t.tv_sec * 1000 + t.tv_nsec / 1000000;
}

int64_t bw_now_ms(void) { return read_clock(CLOCK_REALTIME); }
int64_t bw_age_ms(int64_t since) {
    int64_t age = bw_now_ms() - since;
    return age < 0 ? 0 : age;
}

int64_t bw_mono_ms(void) { return read_clock(CLOCK_MONOTONIC); }

int64_t bw_mono_us(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000 + t.tv_nsec / 1000;
}

char *bw_time_text(int64_t ms, char text[BW_TIME_TEXT]) {
    time_t seconds = (time_t)(ms / 1000);
    struct tm tm;
    gmtime_r(&seconds, &tm);
    size_t n = strftime(text, BW_TIME_TEXT, "%Y-%m-%dT%H:%M:%S", &tm);
    snprintf(text + n, BW_TIME_TEXT - n, ".%03dZ", (int)(ms % 1000));
    return text;
}
