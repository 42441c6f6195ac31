/* Time: wall clock in milliseconds since 1970 for what is stored, monotonic milliseconds for what is waited for. */
#ifndef BW_SERVER_CLOCK_H
#define BW_SERVER_CLOCK_H

#include <stdint.h>

enum { BW_TIME_TEXT = 32 };

int64_t bw_now_ms(void);
int64_t bw_age_ms(int64_t since); /* how long ago that was by the wall clock; 0 if the clock was set back behind it */
int64_t bw_mono_ms(void);
int64_t bw_mono_us(void); /* for measuring */
/* RFC 3339 in UTC with milliseconds, e.g. 2026-01-31T09:05:07.123Z. Returns text. */
char *bw_time_text(int64_t ms, char text[BW_TIME_TEXT]);

#endif
