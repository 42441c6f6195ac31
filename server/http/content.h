/* Replies with content: files, texts, documents; conditional, in part, coded (RFC 9110).
 *
 *     conditions   If-Match, If-Unmodified-Since: 412; If-None-Match, If-Modified-Since: 304
 *     ranges       one range of bytes: 206, none of whose bytes is there: 416. Several ranges at once: the whole.
 *     codings      gzip or zstd by Accept-Encoding, made as it is sent, with a bounded buffer. Text only. A request for a range is answered
 *                  without coding, from the descriptor, as is what is binary.
 * Each coding has its own strong ETag: the SHA-256 of the content, with "-gzip" or "-zstd" behind it.
 */
#ifndef BW_SERVER_HTTP_CONTENT_H
#define BW_SERVER_HTTP_CONTENT_H

#include "server/http/request.h"

typedef struct {
    int fd;               /* of a file, taken by the reply; -1: the content is at `data` */
    const char *data;     /* static, or malloc'ed and taken by the reply if `owned` */
    bool owned;
    uint64_t offset;      /* in the file, where the content begins */
    uint64_t bytes;
    const char *media_type;
    const char *sha256;   /* of the content, for ETag and Repr-Digest; NULL: not known, or the content is not to be kept */
    int64_t modified;     /* ms since 1970; 0: not known */
} bw_content;

enum { BW_HTTP_DATE = 40 };
const char *bw_http_date(int64_t ms, char text[BW_HTTP_DATE]); /* as RFC 9110, 5.6.7 wants it. Returns text. */
void bw_reply_content(bw_request *request, unsigned status, const bw_content *content);

#endif
