/* Addresses and networks, for whom a proxy is: "10.0.0.1,192.168.0.0/16,fd00::/8". */
#ifndef BW_SERVER_NETWORKS_H
#define BW_SERVER_NETWORKS_H

#include <stdbool.h>
#include <stdint.h>
#include <sys/socket.h>

enum { BW_NETWORKS_MOST = 16 };

typedef struct {
    unsigned count;
    struct {
        uint8_t address[16]; /* IPv4 as ::ffff:a.b.c.d */
        uint8_t bits;        /* of the 128, that count */
    } each[BW_NETWORKS_MOST];
} bw_networks;

/* False if it is no such list, has more than BW_NETWORKS_MOST, or an address with bits set behind its mask. "" is the empty list. */
bool bw_networks_parse(const char *text, bw_networks *networks);
/* The address in 16 bytes, an IPv4 one as ::ffff:a.b.c.d; false if it is of another family. */
bool bw_address_of(const struct sockaddr *from, uint8_t address[16]);
bool bw_address_parse(const char *text, uint8_t address[16]);
bool bw_networks_have(const bw_networks *networks, const uint8_t address[16]);
bool bw_address_is_loopback(const uint8_t address[16]);

#endif
