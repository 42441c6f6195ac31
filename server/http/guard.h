/* Guards the daemon's connections against clients that take their time, whether by design or by accident.
 *
 * libmicrohttpd closes a connection on which nothing at all happens for a while; a client that sends a byte now and then stays for ever, and
 * sometimes (edge-triggered epoll) it misses that a client has gone. So every connection has a deadline here, by what it is at:
 *
 *     waiting for the headers of the first request   header-timeout
 *     waiting for those of another one               the same, and BW_IDLE_SECONDS
 *     sending the body                               body-timeout, and what it takes at BW_RATE_LEAST; also cut if the client has gone
 *     being worked on, suspended                     none
 *     taking the answer                              body-timeout, and what it takes at BW_RATE_LEAST; an answer without a size: none
 *
 * Invariant: a socket is shut down here, never closed; the library notices, and is the one who closes it. Under the lock a listed connection's
 * descriptor is open.
 */
#ifndef BW_SERVER_HTTP_GUARD_H
#define BW_SERVER_HTTP_GUARD_H

#include <microhttpd.h>
#include <stdbool.h>
#include <stdint.h>

#include "base/status.h"
#include "server/config.h"

enum { BW_IDLE_SECONDS = 30, BW_RATE_LEAST = 4096 /* bytes per second */ };

typedef struct bw_guard bw_guard;
typedef struct bw_guarded bw_guarded; /* a connection */

bw_status bw_guard_open(const bw_config *config, bw_guard **guard); /* starts its thread; config is borrowed */
void bw_guard_close(bw_guard *guard);                               /* after all connections are gone */

/* For libmicrohttpd: a connection begins or ends; `user` is the bw_guard. */
void bw_guard_on_connection(void *user, struct MHD_Connection *connection, void **context, enum MHD_ConnectionNotificationCode code);

/* What a connection is at. All take NULL for a connection that is not guarded, for want of memory. */
bw_guarded *bw_guard_find(struct MHD_Connection *connection);
void bw_guard_body(bw_guarded *connection, uint64_t bytes);   /* it is to send so many */
void bw_guard_work(bw_guarded *connection);
void bw_guard_answer(bw_guarded *connection, uint64_t bytes); /* it is to take so many */
bool bw_guard_has_gone(const bw_guarded *connection); /* nothing more will come from the client, nor is anything of it left to be read */
void bw_guard_next(bw_guarded *connection);                   /* it may send another request */

#endif
