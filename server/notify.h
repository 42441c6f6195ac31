/* What the daemon tells systemd (sd_notify(3)): datagrams to the socket that NOTIFY_SOCKET names, a path or, with a leading '@', an
 * abstract name. Without that variable nothing is sent. */
#ifndef BW_SERVER_NOTIFY_H
#define BW_SERVER_NOTIFY_H

#include <stdbool.h>
#include <stdint.h>

/* Sends lines such as "READY=1\nSTATUS=...". False if there is nobody to tell, or telling failed (errno). */
bool bw_notify(const char *lines);
void bw_notify_reloading(void); /* RELOADING=1 with the time that goes with it; READY=1 ends it */
/* How often WATCHDOG=1 is to be sent, half of what systemd waits for (WATCHDOG_USEC); 0: never. */
int64_t bw_notify_watchdog_ms(void);

#endif
