/* Content codings: gzip (RFC 1952) and zstd (RFC 8878), both ways, in pieces and with bounded memory.
 *
 * What comes in is hostile: a few bytes may announce gigabytes. An unpacker therefore hands on at most BW_UNPACK_PIECE bytes at a time, and
 * stops when whoever takes them says so. zstd windows are at most 8 MiB, as RFC 9659 asks of this coding.
 */
#ifndef BW_SERVER_HTTP_CODING_H
#define BW_SERVER_HTTP_CODING_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/status.h"

typedef enum { BW_CODING_IDENTITY, BW_CODING_GZIP, BW_CODING_ZSTD, BW_CODING_COUNT } bw_coding;
extern const char *const bw_coding_names[BW_CODING_COUNT];

/* The coding that a client with this Accept-Encoding (NULL: none sent) likes best; of equals zstd, then gzip. Identity if it takes none. */
bw_coding bw_coding_accepted(const char *accept);
/* A value of Content-Encoding; false if it is another coding or several. */
bool bw_coding_find(const char *name, bw_coding *coding);
/* Is it worth coding? Text is; pictures, archives and binary data are not. */
bool bw_coding_helps(const char *media_type);

typedef struct bw_packer bw_packer;
/* `bytes`: how many will come in all. NULL if out of memory. Not for BW_CODING_IDENTITY. */
bw_packer *bw_packer_new(bw_coding coding, uint64_t bytes);
void bw_packer_free(bw_packer *packer);
/* Takes from *data what it can, writes at most `room` bytes and returns how many. `last`: *data are the last ones. *done: all is written. */
bw_status bw_pack(bw_packer *packer, const char **data, size_t *size, bool last, char *out, size_t room, size_t *written, bool *done);

enum { BW_UNPACK_PIECE = 65536 };
typedef struct bw_unpacker bw_unpacker;
typedef bool (*bw_unpack_sink)(void *user, const char *data, size_t size); /* false: enough */

bw_unpacker *bw_unpacker_new(bw_coding coding); /* NULL if out of memory. Not for BW_CODING_IDENTITY. */
void bw_unpacker_free(bw_unpacker *unpacker);
/* BW_E_SYNTAX: this is not of the coding; BW_E_LIMIT: the sink has had enough. Either way it is over then. */
bw_status bw_unpack(bw_unpacker *unpacker, const char *data, size_t size, bw_unpack_sink sink, void *user);
bool bw_unpacker_complete(const bw_unpacker *unpacker); /* does the data end where it may end? */

#endif
