/* SHA-256 (OpenSSL's libcrypto), as 64 lower-case hexadecimal digits. */
#ifndef BW_SERVER_DIGEST_H
#define BW_SERVER_DIGEST_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/status.h"

enum { BW_SHA256_TEXT = 65 }; /* with its NUL */

typedef struct bw_digest bw_digest;

bw_digest *bw_digest_new(void); /* NULL if out of memory */
bw_digest *bw_digest_copy(const bw_digest *digest); /* as far as it is; NULL if out of memory */
bool bw_digest_add(bw_digest *digest, const void *data, size_t size);
bool bw_digest_end(bw_digest *digest, char text[BW_SHA256_TEXT]); /* only once */
void bw_digest_free(bw_digest *digest);

/* Hash of everything in the file from its start; `bytes` may be NULL. Moves the file offset. */
bw_status bw_digest_file(int fd, char text[BW_SHA256_TEXT], uint64_t *bytes);
bool bw_is_sha256(const char *text); /* exactly 64 digits 0-9 a-f */

#endif
