/* The daemon's certificate and key, for libmicrohttpd (GnuTLS).
 *
 * They are read from their files at the start and again by bw_tls_reload; connections that are there keep what they have begun with.
 * A key that others than its owner and group can read, or others than its owner write, is refused.
 *
 * There is one per process, for libmicrohttpd gives the function that asks for it no argument.
 */
#ifndef BW_SERVER_HTTP_TLS_H
#define BW_SERVER_HTTP_TLS_H

#include <gnutls/abstract.h>
#include <gnutls/gnutls.h>

#include "base/status.h"

enum { BW_TLS_ERROR = 400 };
/* What is spoken: TLS 1.2 and 1.3. */
#define BW_TLS_PRIORITIES "NORMAL:-VERS-ALL:+VERS-TLS1.3:+VERS-TLS1.2"

/* The file names are borrowed. On failure `error` tells why. */
bw_status bw_tls_open(const char *certificate, const char *key, char error[BW_TLS_ERROR]);
bw_status bw_tls_reload(char error[BW_TLS_ERROR]); /* on failure what was in force stays */
void bw_tls_close(void);                           /* after the last connection */

/* For MHD_OPTION_HTTPS_CERT_CALLBACK. */
int bw_tls_choose(gnutls_session_t session, const gnutls_datum_t *names, int name_count, const gnutls_pk_algorithm_t *algorithms,
                  int algorithm_count, gnutls_pcert_st **chain, unsigned *length, gnutls_privkey_t *key);

#endif
