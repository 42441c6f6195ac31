#include "hash.h"

#include <openssl/evp.h>
#include <stdlib.h>

enum { CHUNK = 1 << 18 };

static bool update_all(FILE *file, EVP_MD_CTX *digest, unsigned char *chunk, int64_t *size) {
    size_t n;
    rewind(file);
    while ((n = fread(chunk, 1, CHUNK, file)) > 0) {
        if (EVP_DigestUpdate(digest, chunk, n) != 1) return false;
        *size += (int64_t)n;
    }
    return !ferror(file);
}

bool cli_hash_file(FILE *file, char hex[CLI_HASH_TEXT], int64_t *size) {
    unsigned char sum[EVP_MAX_MD_SIZE];
    unsigned length = 0;
    EVP_MD_CTX *digest = EVP_MD_CTX_new();
    unsigned char *chunk = malloc(CHUNK);
    *size = 0;
    bool good = digest && chunk && EVP_DigestInit_ex(digest, EVP_sha256(), NULL) == 1 &&
                update_all(file, digest, chunk, size) && EVP_DigestFinal_ex(digest, sum, &length) == 1;
    if (good)
        for (unsigned i = 0; i < length; i++) snprintf(hex + 2 * i, 3, "%02x", sum[i]);
    free(chunk);
    EVP_MD_CTX_free(digest);
    rewind(file);
    return good;
}
