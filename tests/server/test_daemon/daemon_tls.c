/* TLS, and listening on other addresses than loopback. Certificates are made here, by the program openssl. */
#include <arpa/inet.h>
#include <curl/curl.h>
#include <fcntl.h>
#include <ifaddrs.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "access_kit.h"

static kit_daemon d;
static char folder[] = "/tmp/bw-tls-XXXXXX";
static char certificate[80], key[80], other_key[80];
static bool has_openssl;

static bool make_certificate(const char *to, const char *with, const char *algorithm) {
    char command[500];
    snprintf(command, sizeof command, "openssl req -x509 -newkey %s -nodes -days 2 -subj /CN=%s -addext subjectAltName=IP:127.0.0.1 -keyout %s -out %s "
             ">/dev/null 2>&1 && chmod 600 %s", algorithm, "localhost", with, to, with);
    return system(command) == 0;
}

static int begin(void **state) {
    char unused[100];
    (void)state;
    assert_non_null(mkdtemp(folder));
    snprintf(certificate, sizeof certificate, "%s/cert.pem", folder);
    snprintf(key, sizeof key, "%s/key.pem", folder);
    snprintf(other_key, sizeof other_key, "%s/other.pem", folder);
    snprintf(unused, sizeof unused, "%s/unused.pem", folder);
    has_openssl = system("command -v openssl >/dev/null 2>&1") == 0;
    if (!has_openssl) return 0;
    assert_true(make_certificate(certificate, key, "ec -pkeyopt ec_paramgen_curve:P-256"));
    assert_true(make_certificate(unused, other_key, "rsa:2048"));
    return 0;
}

static int end(void **state) {
    char command[100];
    (void)state;
    snprintf(command, sizeof command, "rm -rf %s", folder);
    return system(command);
}

static void need_openssl(void) {
    if (has_openssl) return;
    print_message("             the program openssl is not here: not tested\n");
    skip();
}

/* ---- speaking it ---- */

static size_t ignore(char *data, size_t one, size_t size, void *user) {
    (void)data, (void)user;
    return one * size;
}

/* The status, or minus libcurl's code. */
static long get(const char *scheme, const char *address, const char *path, const char *secret, long version, const char *trusted) {
    char url[300], header[120];
    long status = 0;
    CURL *curl = curl_easy_init();
    struct curl_slist *list = NULL;
    snprintf(url, sizeof url, "%s://%s%s", scheme, address, path);
    snprintf(header, sizeof header, "Authorization: Bearer %s", secret ? secret : "");
    if (secret) list = curl_slist_append(list, header);
    curl_easy_setopt(curl, CURLOPT_URL, url);
    curl_easy_setopt(curl, CURLOPT_NOSIGNAL, 1L);
    curl_easy_setopt(curl, CURLOPT_TIMEOUT, 20L);
    curl_easy_setopt(curl, CURLOPT_HTTPHEADER, list);
    curl_easy_setopt(curl, CURLOPT_WRITEFUNCTION, ignore);
    curl_easy_setopt(curl, CURLOPT_CAINFO, trusted);
    curl_easy_setopt(curl, CURLOPT_SSLVERSION, version);
    curl_easy_setopt(curl, CURLOPT_SSL_CIPHER_LIST, "DEFAULT:@SECLEVEL=0"); /* so that it is not the client who refuses TLS 1.1 */
    CURLcode code = curl_easy_perform(curl);
    curl_easy_getinfo(curl, CURLINFO_RESPONSE_CODE, &status);
    curl_slist_free_all(list);
    curl_easy_cleanup(curl);
    return code == CURLE_OK ? status : -(long)code;
}

static void tls_is_spoken_and_nothing_else(void **state) {
    (void)state;
    need_openssl();
    kit_start(&d, NULL, (const char *const[]){"--tls-cert", certificate, "--tls-key", key, NULL});
    kit_token token = kit_new_token(&d, "a", "");
    assert_int_equal(get("https", d.address, "/livez", NULL, CURL_SSLVERSION_DEFAULT, certificate), 200);
    assert_int_equal(get("https", d.address, "/livez", NULL, CURL_SSLVERSION_TLSv1_3, certificate), 200);
    assert_int_equal(get("https", d.address, "/livez", NULL, CURL_SSLVERSION_TLSv1_2 | CURL_SSLVERSION_MAX_TLSv1_2, certificate), 200);
    assert_true(get("https", d.address, "/livez", NULL, CURL_SSLVERSION_TLSv1_0 | CURL_SSLVERSION_MAX_TLSv1_1, certificate) < 0);
    assert_true(get("http", d.address, "/livez", NULL, CURL_SSLVERSION_DEFAULT, certificate) < 0);
    assert_int_equal(get("https", d.address, "/v1/jobs", NULL, CURL_SSLVERSION_DEFAULT, certificate), 401);
    assert_int_equal(get("https", d.address, "/v1/jobs", token.secret, CURL_SSLVERSION_DEFAULT, certificate), 200);
    kit_remove(&d);
}

static void a_new_certificate_is_taken_over_at_sighup(void **state) {
    char old[90], command[300], log[80];
    (void)state;
    need_openssl();
    snprintf(old, sizeof old, "%s/old.pem", folder);
    kit_start(&d, NULL, (const char *const[]){"--tls-cert", certificate, "--tls-key", key, NULL});
    snprintf(command, sizeof command, "cp %s %s", certificate, old);
    assert_int_equal(system(command), 0);
    assert_true(make_certificate(certificate, key, "rsa:2048"));
    assert_int_equal(get("https", d.address, "/livez", NULL, CURL_SSLVERSION_DEFAULT, old), 200); /* not yet */
    kill(d.pid, SIGHUP);
    long status = 0;
    for (int i = 0; i < 400 && status != 200; i++, kit_sleep_ms(10)) status = get("https", d.address, "/livez", NULL, CURL_SSLVERSION_DEFAULT, certificate);
    assert_int_equal(status, 200);
    assert_true(get("https", d.address, "/livez", NULL, CURL_SSLVERSION_DEFAULT, old) < 0);
    assert_int_equal(chmod(key, 0644), 0); /* a bad one changes nothing */
    kill(d.pid, SIGHUP);
    snprintf(log, sizeof log, "%s.log", d.data);
    snprintf(command, sizeof command, "grep -q tls.rejected %s", log);
    for (int i = 0; i < 400 && system(command) != 0; i++) kit_sleep_ms(10);
    assert_int_equal(system(command), 0);
    assert_int_equal(get("https", d.address, "/livez", NULL, CURL_SSLVERSION_DEFAULT, certificate), 200);
    assert_int_equal(chmod(key, 0600), 0);
    kit_remove(&d);
}

/* ---- the clients ---- */

/* Exit code of a command with the daemon's address and what else is set before it. */
static int client(const char *settings, const char *command) {
    char line[1000];
    snprintf(line, sizeof line, "cd %s && BLOCKWRIGHT_SERVER=https://%s %s %s >out 2>err </dev/null", folder, d.address, settings, command);
    int status = system(line);
    return WIFEXITED(status) ? WEXITSTATUS(status) : 256;
}

static bool in_file(const char *text, const char *name) {
    char command[400];
    snprintf(command, sizeof command, "grep -qF -- '%s' %s/%s", text, folder, name);
    return system(command) == 0;
}

static void both_clients_show_their_token_over_https(void **state) {
    static const char *const programs[] = {BW_BIN_DIR "/blockwright", "sh " BW_SOURCE_DIR "/clients/sh/blockwright.sh"};
    char trust[120], with[300], path[100], command[400];
    (void)state;
    need_openssl();
    kit_start(&d, NULL, (const char *const[]){"--tls-cert", certificate, "--tls-key", key, NULL});
    kit_token token = kit_new_token(&d, "a", "");
    snprintf(trust, sizeof trust, "BLOCKWRIGHT_CA_FILE=%s", certificate);
    snprintf(with, sizeof with, "%s BLOCKWRIGHT_TOKEN=%s", trust, token.secret);
    snprintf(path, sizeof path, "%s/token", folder);
    FILE *f = fopen(path, "w");
    fprintf(f, "%s\n", token.secret);
    fclose(f);
    snprintf(path, sizeof path, "%s/part", folder);
    f = fopen(path, "w");
    fprintf(f, "# a script\n");
    fclose(f);
    for (size_t i = 0; i < sizeof programs / sizeof *programs; i++) {
        snprintf(command, sizeof command, "%s ls", programs[i]);
        assert_int_not_equal(client(trust, command), 0);
        assert_true(in_file("access token", "err"));
        assert_int_not_equal(client("", command), 0); /* nobody trusts this certificate by itself */
        assert_int_equal(client(with, command), 0);
        snprintf(command, sizeof command, "%s ls --token-file token", programs[i]);
        assert_int_equal(client(trust, command), 0);
        snprintf(command, sizeof command, "%s submit part --out result%zu", programs[i], i);
        if (client(with, command) != 0) fail_msg("%s in %s", command, folder);
        assert_false(in_file(token.secret, "err"));
        assert_false(in_file("unencrypted", "err"));
    }
    kit_remove(&d);
}

/* ---- refusing to start ---- */

/* The exit code of a daemon that is not to start; -1 if it goes on. Its errors are in DATA.log. */
static int start_code(const char *listen, const char *const *more) {
    char log[90];
    int status = 0;
    snprintf(log, sizeof log, "%s/refused.log", folder);
    pid_t pid = fork();
    if (pid == 0) {
        const char *argv[20] = {BW_BIN_DIR "/blockwrightd", "--data", d.data, "--listen", listen, "--worker", BW_BIN_DIR "/blockwright-test-worker"};
        for (int n = 7; more && *more; ) argv[n++] = *more++;
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        dup2(open(log, O_WRONLY | O_CREAT | O_TRUNC, 0600), 2);
        execv(argv[0], (char **)argv);
        _exit(126);
    }
    for (int i = 0; i < 300; i++, kit_sleep_ms(10))
        if (waitpid(pid, &status, WNOHANG) == pid) return WIFEXITED(status) ? WEXITSTATUS(status) : 256;
    kill(pid, SIGTERM);
    waitpid(pid, &status, 0);
    return -1;
}

static bool refused_for(const char *text) {
    char command[300];
    snprintf(command, sizeof command, "grep -q '%s' %s/refused.log", text, folder);
    return system(command) == 0;
}

static void a_bad_pair_of_certificate_and_key_is_refused(void **state) {
    char nothing[90];
    (void)state;
    need_openssl();
    memset(&d, 0, sizeof d);
    snprintf(d.data, sizeof d.data, "%s/data", folder);
    snprintf(nothing, sizeof nothing, "%s/nothing.pem", folder);
    assert_int_equal(start_code("127.0.0.1:0", (const char *const[]){"--tls-cert", certificate, "--tls-key", other_key, NULL}), 2);
    assert_true(refused_for("not the certificate"));
    assert_int_equal(start_code("127.0.0.1:0", (const char *const[]){"--tls-cert", key, "--tls-key", key, NULL}), 2);
    assert_int_equal(start_code("127.0.0.1:0", (const char *const[]){"--tls-cert", certificate, "--tls-key", nothing, NULL}), 2);
    static const mode_t modes[] = {0604, 0644, 0602, 0620, 0666};
    for (size_t i = 0; i < sizeof modes / sizeof *modes; i++) {
        assert_int_equal(chmod(key, modes[i]), 0);
        assert_int_equal(start_code("127.0.0.1:0", (const char *const[]){"--tls-cert", certificate, "--tls-key", key, NULL}), 2);
        assert_true(refused_for("others can read or change this key"));
    }
    assert_int_equal(chmod(key, 0600), 0);
}

static void other_addresses_than_loopback_want_tokens_and_tls_or_a_proxy(void **state) {
    const char *const behind[] = {"--behind-proxy", "10.9.8.7", NULL};
    (void)state;
    memset(&d, 0, sizeof d);
    snprintf(d.data, sizeof d.data, "%s/open", folder);
    assert_int_equal(start_code("0.0.0.0:0", NULL), 2);
    assert_true(refused_for("refusing to listen"));
    assert_int_equal(start_code("0.0.0.0:0", behind), 2);
    assert_true(refused_for("blockwrightd token create"));
    char line[200];
    assert_int_equal(kit_blockwrightd(&d, "token create --owner a", line, sizeof line), 0);
    assert_int_equal(start_code("0.0.0.0:0", NULL), 2); /* tokens would cross the network in the open */
    assert_int_equal(start_code("0.0.0.0:0", behind), -1);
    if (has_openssl) assert_int_equal(start_code("[::]:0", (const char *const[]){"--tls-cert", certificate, "--tls-key", key, NULL}), -1);
}

/* ---- behind a proxy ---- */

/* An IPv4 address of this machine that is not loopback; false if it has none. */
static bool own_address(char text[INET_ADDRSTRLEN]) {
    struct ifaddrs *all, *each;
    bool found = false;
    if (getifaddrs(&all) != 0) return false;
    for (each = all; each && !found; each = each->ifa_next) {
        if (!each->ifa_addr || each->ifa_addr->sa_family != AF_INET) continue;
        const struct in_addr *in = &((const struct sockaddr_in *)(const void *)each->ifa_addr)->sin_addr;
        found = ntohl(in->s_addr) >> 24 != 127 && inet_ntop(AF_INET, in, text, INET_ADDRSTRLEN);
    }
    freeifaddrs(all);
    return found;
}

static void without_tls_only_proxies_and_loopback_may_connect(void **state) {
    char address[INET_ADDRSTRLEN], outside[60], inside[60];
    (void)state;
    if (!own_address(address)) {
        print_message("             this machine has no address but loopback: not tested\n");
        skip();
    }
    for (int trusted = 0; trusted < 2; trusted++) {
        kit_start(&d, NULL, NULL);
        kit_new_token(&d, "a", "");
        assert_int_equal(kit_stop(&d), 0);
        kit_restart(&d, (const char *const[]){"--listen", "0.0.0.0:0", "--behind-proxy", trusted ? address : "192.0.2.1", NULL});
        snprintf(outside, sizeof outside, "%s%s", address, strchr(d.address, ':'));
        snprintf(inside, sizeof inside, "127.0.0.1%s", strchr(d.address, ':'));
        assert_int_equal(get("http", inside, "/v1/jobs", NULL, CURL_SSLVERSION_DEFAULT, NULL), 401);
        long status = get("http", outside, "/v1/jobs", NULL, CURL_SSLVERSION_DEFAULT, NULL);
        if (trusted) assert_int_equal(status, 401);
        else assert_true(status < 0);
        kit_remove(&d);
    }
}


static void forwarded_addresses_are_believed_from_proxies_only(void **state) {
    static const struct {
        const char *proxies, *forwarded, *client;
    } cases[] = {
        {"10.0.0.1", "X-Forwarded-For: 192.0.2.7", "client=127.0.0.1 "},                           /* not from a proxy */
        {"127.0.0.1", "X-Forwarded-For: 192.0.2.7", "client=192.0.2.7 "},
        {"127.0.0.1", "X-Forwarded-For: 6.6.6.6, 192.0.2.8", "client=192.0.2.8 "},                 /* what a client says itself */
        {"127.0.0.0/8,192.0.2.0/24", "X-Forwarded-For: 6.6.6.6, 2001:db8::7 , 192.0.2.8", "client=2001:db8::7 "},
        {"127.0.0.1", "X-Forwarded-For: 6.6.6.6\nX-Forwarded-For: 192.0.2.8", "client=192.0.2.8 "},
        {"127.0.0.0/8,192.0.2.0/24", "X-Forwarded-For: 6.6.6.6\nX-Forwarded-For: 2001:db8::7\nX-Forwarded-For: 192.0.2.8", "client=2001:db8::7 "},
        {"127.0.0.1", "X-Forwarded-For: nonsense", "client=127.0.0.1 "},
        {"127.0.0.1", "X-Forwarded-For: 192.0.2.9, ", "client=127.0.0.1 "},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char command[200];
        kit_start(&d, NULL, (const char *const[]){"--behind-proxy", cases[i].proxies, NULL});
        kit_new_token(&d, "a", "");
        kit_expect_problem(kit_request(&d, "GET", "/v1/jobs", cases[i].forwarded, NULL, 0), 401, "unauthorized");
        snprintf(command, sizeof command, "grep access.denied %s.log | grep -q '%s'", d.data, cases[i].client);
        if (system(command) != 0) fail_msg("case %zu: no line with %s in %s.log", i, cases[i].client, d.data);
        kit_remove(&d);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(tls_is_spoken_and_nothing_else),
        cmocka_unit_test(a_new_certificate_is_taken_over_at_sighup),
        cmocka_unit_test(both_clients_show_their_token_over_https),
        cmocka_unit_test(a_bad_pair_of_certificate_and_key_is_refused),
        cmocka_unit_test(other_addresses_than_loopback_want_tokens_and_tls_or_a_proxy),
        cmocka_unit_test(without_tls_only_proxies_and_loopback_may_connect),
        cmocka_unit_test(forwarded_addresses_are_believed_from_proxies_only),
    };
    return cmocka_run_group_tests(tests, begin, end);
}
