#include "server/digest.h"

#include <errno.h>
#include <openssl/evp.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

struct bw_digest {
    EVP_MD_CTX *md;
};

bw_digest *bw_digest_new(void) {
    bw_digest *digest = calloc(1, sizeof *digest);
    if (!digest) return NULL;
    digest->md = EVP_MD_CTX_new();
    if (!digest->md || EVP_DigestInit_ex(digest->md, EVP_sha256(), NULL) != 1) {
        bw_digest_free(digest);
        return NULL;
    }
    return digest;
}

bw_digest *bw_digest_copy(const bw_digest *digest) {
    bw_digest *copy = bw_digest_new();
    if (!copy || EVP_MD_CTX_copy_ex(copy->md, digest->md) == 1) return copy;
    bw_digest_free(copy);
    return NULL;
}

bool bw_digest_add(bw_digest *digest, const void *data, size_t size) {
    return EVP_DigestUpdate(digest->md, data, size) == 1;
}

bool bw_digest_end(bw_digest *digest, char text[BW_SHA256_TEXT]) {
    static const char digits[] = "0123456789abcdef";
    unsigned char raw[EVP_MAX_MD_SIZE];
    unsigned size = 0;
    if (EVP_DigestFinal_ex(digest->md, raw, &size) != 1 || size != 32) return false;
    for (unsigned i = 0; i < size; i++) {
        text[2 * i] = digits[raw[i] >> 4];
        text[2 * i + 1] = digits[raw[i] & 15];
    }
    text[64] = '\0';
    return true;
}

void bw_digest_free(bw_digest *digest) {
    if (!digest) return;
    EVP_MD_CTX_free(digest->md);
    free(digest);
}

bw_status bw_digest_file(int fd, char text[BW_SHA256_TEXT], uint64_t *bytes) {
    enum { CHUNK = 1 << 18 };
    bw_status status = BW_E_IO;
    uint64_t total = 0;
    bw_digest *digest = bw_digest_new();
    char *chunk = malloc(CHUNK);
    if (!digest || !chunk) {
        status = BW_E_MEMORY;
        goto out;
    }
    if (lseek(fd, 0, SEEK_SET) < 0) goto out;
    for (;;) {
        ssize_t n = read(fd, chunk, CHUNK);
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) goto out;
        if (n == 0) break;
        if (!bw_digest_add(digest, chunk, (size_t)n)) goto out;
        total += (uint64_t)n;
    }
    if (!bw_digest_end(digest, text)) goto out;
    if (bytes) *bytes = total;
    status = BW_OK;
out:
    bw_digest_free(digest);
    free(chunk);
    return status;
}

bool bw_is_sha256(const char *text) {
    size_t n = strspn(text, "0123456789abcdef");
    return n == 64 && text[n] == '\0';
}
