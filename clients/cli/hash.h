/* SHA-256, the name of every blob and result. */
#ifndef BW_CLI_HASH_H
#define BW_CLI_HASH_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

enum { CLI_HASH_TEXT = 65 }; /* 64 lower-case hex digits and NUL */

/* Hashes a file from its start to its end; leaves it rewound. *size: its bytes. False on a read error. */
bool cli_hash_file(FILE *file, char hex[CLI_HASH_TEXT], int64_t *size);

#endif
