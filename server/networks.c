#include "server/networks.h"

#include <arpa/inet.h>
#include <stdlib.h>
#include <string.h>

static const uint8_t four[12] = {[10] = 0xff, [11] = 0xff};

bool bw_address_of(const struct sockaddr *from, uint8_t address[16]) {
    if (from->sa_family == AF_INET6) {
        memcpy(address, &((const struct sockaddr_in6 *)(const void *)from)->sin6_addr, 16);
    } else if (from->sa_family == AF_INET) {
        memcpy(address, four, 12);
        memcpy(address + 12, &((const struct sockaddr_in *)(const void *)from)->sin_addr, 4);
    } else {
        return false;
    }
    return true;
}

bool bw_address_parse(const char *text, uint8_t address[16]) {
    memcpy(address, four, 12);
    return inet_pton(AF_INET, text, address + 12) == 1 || inet_pton(AF_INET6, text, address) == 1;
}

static bool bit(const uint8_t address[16], unsigned i) { return address[i / 8] >> (7 - i % 8) & 1; }

/* "ADDRESS" or "ADDRESS/BITS" of n letters. */
static bool parse_one(const char *text, size_t n, bw_networks *to) {
    char copy[64], *end = NULL;
    if (n == 0 || n >= sizeof copy || to->count == BW_NETWORKS_MOST) return false;
    memcpy(copy, text, n);
    copy[n] = '\0';
    char *slash = strchr(copy, '/');
    if (slash) *slash = '\0';
    uint8_t *address = to->each[to->count].address;
    if (!bw_address_parse(copy, address)) return false;
    unsigned long width = strchr(copy, ':') ? 128 : 32, bits = slash ? strtoul(slash + 1, &end, 10) : width;
    if (slash && (slash[1] < '0' || slash[1] > '9' || *end || bits > width)) return false;
    bits += 128 - width;
    for (unsigned i = (unsigned)bits; i < 128; i++)
        if (bit(address, i)) return false; /* 10.0.0.1/8: it is not clear what is meant */
    to->each[to->count++].bits = (uint8_t)bits;
    return true;
}

bool bw_networks_parse(const char *text, bw_networks *networks) {
    networks->count = 0;
    if (!*text) return true;
    for (;;) {
        size_t n = strcspn(text, ",");
        if (!parse_one(text, n, networks)) return false;
        if (!text[n]) return true;
        text += n + 1;
    }
}

bool bw_networks_have(const bw_networks *networks, const uint8_t address[16]) {
    for (unsigned k = 0; k < networks->count; k++) {
        unsigned i = 0;
        while (i < networks->each[k].bits && bit(networks->each[k].address, i) == bit(address, i)) i++;
        if (i == networks->each[k].bits) return true;
    }
    return false;
}

bool bw_address_is_loopback(const uint8_t address[16]) {
    static const uint8_t six[16] = {[15] = 1};
    return (memcmp(address, four, 12) == 0 && address[12] == 127) || memcmp(address, six, 16) == 0;
}
