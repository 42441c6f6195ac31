/* Who may do what: the access tokens, in memory.
 *
 * A token is "bwt_" and 64 hexadecimal digits: 256 random bits. The database has the SHA-256 of the whole text and nothing else of it; there is
 * nothing to guess, so a slow hash as for passwords would protect nothing. A token given is hashed, the hash looked up here, and the
 * hit compared in constant time.
 *
 * Invariants
 *  1. Open, where everybody may do everything, is only a daemon in whose database no token was ever made. Revoked and expired
 *     tokens keep it closed.
 *  2. Whoever commits a change of tokens calls bw_access_refresh after the commit; a request that begins after that sees it.
 *  3. No token is kept, logged or written anywhere but to whoever asked for it to be made.
 */
#ifndef BW_SERVER_ACCESS_H
#define BW_SERVER_ACCESS_H

#include <stdbool.h>

#include "server/queue/queue.h"

enum { BW_TOKEN_TEXT = 69 };
#define BW_TOKEN_LIFE_MOST INT64_C(60480000000000) /* ms: 100 000 weeks. Years keep their four digits, and sums with a time do not overflow */

typedef struct bw_access bw_access;

typedef struct {
    char owner[BW_OWNER_TEXT];    /* "": the local one, of an open daemon */
    char token[BW_TOKEN_ID_TEXT]; /* its id; "": none */
    bool open;                    /* nobody in particular: no token was ever made */
    int scopes;                   /* of bw_scope; all of them if open, 0: nobody known */
} bw_caller;

typedef enum { BW_KNOWN, BW_UNKNOWN, BW_EXPIRED, BW_REVOKED } bw_recognized;

bw_status bw_access_open(bw_queue *queue, bw_access **access); /* borrows the queue */
void bw_access_close(bw_access *access);
bw_status bw_access_refresh(bw_access *access); /* on failure what was known stays */
bool bw_access_is_open(bw_access *access);
/* Who shows this token. But for BW_KNOWN *caller is cleared. */
bw_recognized bw_access_recognize(bw_access *access, const char *secret, int64_t now, bw_caller *caller);
/* Is it still what it was, for requests that take long? */
bool bw_access_holds(bw_access *access, const bw_caller *caller, int64_t now);

/* May a caller with these scopes do what wants `scope` (0: what everybody may)? */
bool bw_scopes_allow(int scopes, int scope);
/* Words with commas between them, as flags; 0 if a word is none. */
int bw_scopes_parse(const char *text);
/* A name of an owner: 1 to 64 of A-Z a-z 0-9 . _ @ + -, the first of them no sign. */
bool bw_is_owner_name(const char *name);
/* Fills id, hash and created of *token and writes the token itself to `secret`. */
bw_status bw_token_make(bw_token *token, int64_t now, char secret[BW_TOKEN_TEXT]);

#endif
