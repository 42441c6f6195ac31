/* How often an owner asks: so many requests a second over any longer time, and what comes to BW_RATE_BURST_SECONDS of that at once.
 *
 * Of each owner the time is kept at which it would have made its requests if it had made one after the other at that rate (the generic cell
 * rate algorithm, ITU-T I.371). Owners for whom that has passed are forgotten, so as many are known as have asked lately. */
#ifndef BW_SERVER_HTTP_RATE_H
#define BW_SERVER_HTTP_RATE_H

#include <stddef.h>
#include <stdint.h>

enum { BW_RATE_BURST_SECONDS = 10 };

typedef struct bw_rates bw_rates;

bw_rates *bw_rates_open(void); /* NULL: no memory */
void bw_rates_close(bw_rates *rates); /* may be NULL */
/* A request of `owner` at `now` (microseconds, monotonic), who may make `per_second` (> 0). 0: it may be made, and counts; else it does not, and
 * one may be made in so many microseconds. From any thread. */
int64_t bw_rates_ask(bw_rates *rates, const char *owner, int per_second, int64_t now);
size_t bw_rates_known(bw_rates *rates); /* owners that are kept */

#endif
