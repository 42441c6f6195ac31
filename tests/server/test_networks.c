/* Addresses and networks of proxies. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "server/networks.h"

static bool has(const char *list, const char *address) {
    bw_networks networks;
    uint8_t raw[16];
    assert_true(bw_networks_parse(list, &networks));
    assert_true(bw_address_parse(address, raw));
    return bw_networks_have(&networks, raw);
}

static void an_address_is_in_the_networks_that_begin_with_its_bits(void **state) {
    (void)state;
    static const struct {
        const char *list, *address;
        bool in;
    } cases[] = {{"10.0.0.1", "10.0.0.1", true}, {"10.0.0.1", "10.0.0.2", false}, {"10.0.0.0/8", "10.255.3.4", true},
                 {"10.0.0.0/8", "11.0.0.0", false}, {"10.0.0.128/25", "10.0.0.127", false}, {"10.0.0.128/25", "10.0.0.200", true},
                 {"0.0.0.0/0", "1.2.3.4", true}, {"0.0.0.0/0", "2001:db8::1", false}, {"::/0", "1.2.3.4", true}, {"fd00::/8", "fd12::1", true},
                 {"fd00::/8", "fe00::1", false}, {"10.0.0.1,fd00::/8", "fd00::1", true}, {"10.0.0.1", "::ffff:10.0.0.1", true}, {"", "10.0.0.1", false}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        if (has(cases[i].list, cases[i].address) != cases[i].in) fail_msg("%s in %s", cases[i].address, cases[i].list);
}

static void what_is_no_list_of_networks_is_refused(void **state) {
    (void)state;
    static const char *const bad[] = {",", "10.0.0.1,", ",10.0.0.1", "10.0.0", "localhost", "10.0.0.1/8", "10.0.0.0/33", "10.0.0.0/-1", "10.0.0.0/", "10.0.0.0/8x",
                                      "fd00::/129", "[fd00::]/8", "10.0.0.1 10.0.0.2", "1.1.1.1,1.1.1.1,1.1.1.1,1.1.1.1,1.1.1.1,1.1.1.1,1.1.1.1,1.1.1.1,1.1.1.1,"
                                      "1.1.1.1,1.1.1.1,1.1.1.1,1.1.1.1,1.1.1.1,1.1.1.1,1.1.1.1,1.1.1.1"};
    bw_networks networks;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        if (bw_networks_parse(bad[i], &networks)) fail_msg("%s", bad[i]);
}

static void loopback_is_127_and_one(void **state) {
    (void)state;
    static const char *const yes[] = {"127.0.0.1", "127.255.0.3", "::1", "::ffff:127.0.0.1"}, *const no[] = {"128.0.0.1", "0.0.0.0", "::", "::2", "126.0.0.1"};
    uint8_t raw[16];
    for (size_t i = 0; i < sizeof yes / sizeof *yes; i++) assert_true(bw_address_parse(yes[i], raw) && bw_address_is_loopback(raw));
    for (size_t i = 0; i < sizeof no / sizeof *no; i++) assert_true(bw_address_parse(no[i], raw) && !bw_address_is_loopback(raw));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_address_is_in_the_networks_that_begin_with_its_bits),
        cmocka_unit_test(what_is_no_list_of_networks_is_refused),
        cmocka_unit_test(loopback_is_127_and_one),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
