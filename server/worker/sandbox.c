#include "server/worker/sandbox.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/landlock.h>
#include <seccomp.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "server/worker/worker_proto.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SANITIZER 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define SANITIZER 1
#endif
#endif
#ifndef SANITIZER
#define SANITIZER 0
#endif

static void miss(bw_sandbox *s, const char *what, const char *why) {
    size_t n = strlen(s->missing);
    snprintf(s->missing + n, sizeof s->missing - n, "%s%s: %s", n ? "; " : "", what, why);
}

/* ---- Landlock ---- */

/* Rights by the version of the interface that brought them; Debian's header ends before the last ones. */
enum { FS_V1 = 13, FS_V2 = 14, FS_V3 = 15, FS_V5 = 16 };
#define FS_BITS(n) ((UINT64_C(1) << (n)) - 1)
#define NET_TCP_BOTH UINT64_C(3)   /* version 4: bind, connect */
#define SCOPE_BOTH UINT64_C(3)     /* version 6: abstract sockets, signals */
#define FS_REFER (UINT64_C(1) << 13)
#define FS_TRUNCATE (UINT64_C(1) << 14)

/* struct landlock_ruleset_attr of version 6; older kernels take a prefix of it. */
typedef struct {
    uint64_t fs, net, scoped;
} ruleset;

static const uint64_t read_file = LANDLOCK_ACCESS_FS_READ_FILE;
static const uint64_t scratch_rights = LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_READ_DIR | LANDLOCK_ACCESS_FS_WRITE_FILE |
                                       LANDLOCK_ACCESS_FS_MAKE_REG | LANDLOCK_ACCESS_FS_MAKE_DIR | LANDLOCK_ACCESS_FS_REMOVE_FILE |
                                       LANDLOCK_ACCESS_FS_REMOVE_DIR | FS_REFER | FS_TRUNCATE;

static uint64_t known_rights(int version) {
    return FS_BITS(version >= 5 ? FS_V5 : version >= 3 ? FS_V3 : version == 2 ? FS_V2 : FS_V1);
}

static bool allow_below(int rules, int fd, uint64_t rights, int version) {
    struct landlock_path_beneath_attr rule = {.allowed_access = rights & known_rights(version), .parent_fd = fd};
    return fd >= 0 && syscall(SYS_landlock_add_rule, rules, LANDLOCK_RULE_PATH_BENEATH, &rule, 0) == 0;
}

static bool allow_path(int rules, const char *path, uint64_t rights, int version) {
    int fd = open(path, O_PATH | O_CLOEXEC);
    bool good = allow_below(rules, fd, rights, version);
    if (fd >= 0) close(fd);
    return good;
}

/* Landlock binds the calling thread and those it will start. */
static bool is_alone(void) {
    int count = 0;
    DIR *tasks = opendir("/proc/self/task");
    if (!tasks) return false;
    for (struct dirent *e; (e = readdir(tasks));) count += *e->d_name != '.';
    closedir(tasks);
    return count == 1;
}

static bool fill_rules(int rules, const int *readable, size_t count, int version) {
    bool good = allow_path(rules, ".", scratch_rights, version) && allow_path(rules, "/dev/urandom", read_file, version);
    if (SANITIZER) good = good && allow_path(rules, "/proc", read_file | LANDLOCK_ACCESS_FS_READ_DIR, version); /* leak check */
    for (size_t i = 0; i < count; i++) {
        struct stat st;
        if (fstat(readable[i], &st) != 0 || !S_ISREG(st.st_mode)) continue; /* none given: the trial of the sandbox reads /dev/null */
        good = good && allow_below(rules, readable[i], read_file, version);
    }
    return good;
}

static void enter_landlock(const int *readable, size_t count, bw_sandbox *s) {
    long version = syscall(SYS_landlock_create_ruleset, NULL, 0, LANDLOCK_CREATE_RULESET_VERSION);
    if (version < 1) return miss(s, "landlock", "not in this kernel");
    if (!is_alone()) return miss(s, "landlock", "a library has started threads already");
    ruleset attributes = {known_rights((int)version), version >= 4 ? NET_TCP_BOTH : 0, version >= 6 ? SCOPE_BOTH : 0};
    size_t size = version >= 6 ? sizeof attributes : version >= 4 ? 2 * sizeof(uint64_t) : sizeof(uint64_t);
    int rules = (int)syscall(SYS_landlock_create_ruleset, &attributes, size, 0);
    if (rules < 0) return miss(s, "landlock", strerror(errno));
    if (fill_rules(rules, readable, count, (int)version) && syscall(SYS_landlock_restrict_self, rules, 0) == 0)
        s->landlock = (int)version;
    else miss(s, "landlock", strerror(errno));
    close(rules);
}

/* ---- seccomp ---- */

/* What the core, the C library, its allocator and threads, and HDF5 need. Calls that a machine does not have are passed over. */
static const int allowed[] = {
    SCMP_SYS(read), SCMP_SYS(write), SCMP_SYS(pread64), SCMP_SYS(pwrite64), SCMP_SYS(readv), SCMP_SYS(writev), SCMP_SYS(lseek),
    SCMP_SYS(open), SCMP_SYS(openat), SCMP_SYS(close), SCMP_SYS(stat), SCMP_SYS(lstat), SCMP_SYS(fstat), SCMP_SYS(newfstatat),
    SCMP_SYS(statx), SCMP_SYS(access), SCMP_SYS(faccessat), SCMP_SYS(faccessat2), SCMP_SYS(getdents64), SCMP_SYS(getcwd),
    SCMP_SYS(readlink), SCMP_SYS(readlinkat), SCMP_SYS(mkdir), SCMP_SYS(mkdirat), SCMP_SYS(rmdir), SCMP_SYS(unlink),
    SCMP_SYS(unlinkat), SCMP_SYS(rename), SCMP_SYS(renameat), SCMP_SYS(renameat2), SCMP_SYS(ftruncate), SCMP_SYS(fallocate),
    SCMP_SYS(fsync), SCMP_SYS(fdatasync), SCMP_SYS(flock), SCMP_SYS(dup), SCMP_SYS(dup2), SCMP_SYS(dup3),
    SCMP_SYS(pipe), SCMP_SYS(pipe2), /* reach nobody; how the sanitizer of undefined behaviour asks whether memory is readable */
    SCMP_SYS(brk), SCMP_SYS(munmap), SCMP_SYS(mremap), SCMP_SYS(madvise), SCMP_SYS(mincore), SCMP_SYS(futex),
    SCMP_SYS(sched_yield), SCMP_SYS(sched_getaffinity), SCMP_SYS(set_robust_list), SCMP_SYS(get_robust_list), SCMP_SYS(rseq),
    SCMP_SYS(set_tid_address), SCMP_SYS(membarrier), SCMP_SYS(exit), SCMP_SYS(exit_group), SCMP_SYS(restart_syscall),
    SCMP_SYS(rt_sigaction), SCMP_SYS(rt_sigprocmask), SCMP_SYS(rt_sigreturn), SCMP_SYS(sigaltstack), SCMP_SYS(pause),
    SCMP_SYS(nanosleep), SCMP_SYS(clock_nanosleep), SCMP_SYS(clock_gettime), SCMP_SYS(clock_getres), SCMP_SYS(gettimeofday),
    SCMP_SYS(time), SCMP_SYS(times), SCMP_SYS(getrusage), SCMP_SYS(getpid), SCMP_SYS(gettid), SCMP_SYS(getppid),
    SCMP_SYS(getuid), SCMP_SYS(geteuid), SCMP_SYS(getgid), SCMP_SYS(getegid), SCMP_SYS(uname), SCMP_SYS(sysinfo),
    SCMP_SYS(getrandom), SCMP_SYS(getrlimit), SCMP_SYS(getcpu),
};

/* Of fcntl. Others would have the kernel send a signal of the worker's choice to whom it likes (F_SETOWN with F_SETSIG). */
static const int allowed_fcntl[] = {F_DUPFD, F_DUPFD_CLOEXEC, F_GETFD, F_SETFD, F_GETFL, F_SETFL, F_GETLK, F_SETLK, F_SETLKW};

/* What only a worker does that is not its own master any more. */
static const int deadly[] = {
    SCMP_SYS(fork), SCMP_SYS(vfork), SCMP_SYS(execve), SCMP_SYS(execveat), SCMP_SYS(socket), SCMP_SYS(socketpair),
    SCMP_SYS(connect), SCMP_SYS(bind), SCMP_SYS(listen), SCMP_SYS(accept), SCMP_SYS(accept4), SCMP_SYS(ptrace),
    SCMP_SYS(process_vm_readv), SCMP_SYS(process_vm_writev), SCMP_SYS(pidfd_open), SCMP_SYS(pidfd_getfd),
    SCMP_SYS(pidfd_send_signal), SCMP_SYS(mount), SCMP_SYS(umount2), SCMP_SYS(pivot_root), SCMP_SYS(chroot), SCMP_SYS(unshare),
    SCMP_SYS(setns), SCMP_SYS(open_tree), SCMP_SYS(move_mount), SCMP_SYS(fsopen), SCMP_SYS(bpf), SCMP_SYS(perf_event_open),
    SCMP_SYS(userfaultfd), SCMP_SYS(io_uring_setup), SCMP_SYS(keyctl), SCMP_SYS(add_key), SCMP_SYS(request_key),
    SCMP_SYS(init_module), SCMP_SYS(finit_module), SCMP_SYS(delete_module), SCMP_SYS(kexec_load), SCMP_SYS(reboot),
    SCMP_SYS(setuid), SCMP_SYS(setgid), SCMP_SYS(setreuid), SCMP_SYS(setresuid), SCMP_SYS(setgroups), SCMP_SYS(capset),
};

enum { CLONE_THREAD_BIT = 0x10000 };

/* -EDOM and the like: the call does not exist on this machine. */
static bool add(scmp_filter_ctx filter, uint32_t action, int call, unsigned count, const struct scmp_arg_cmp *arguments) {
    return call < 0 || seccomp_rule_add_array(filter, action, call, count, arguments) == 0;
}

/* Calls of which only some uses are a worker's. */
static bool add_conditional(scmp_filter_ctx filter) {
    const struct scmp_arg_cmp thread = SCMP_A0(SCMP_CMP_MASKED_EQ, CLONE_THREAD_BIT, CLONE_THREAD_BIT);
    const struct scmp_arg_cmp process = SCMP_A0(SCMP_CMP_MASKED_EQ, CLONE_THREAD_BIT, 0);
    const struct scmp_arg_cmp not_code = SCMP_A2(SCMP_CMP_MASKED_EQ, PROT_EXEC, 0);
    const struct scmp_arg_cmp myself = SCMP_A0(SCMP_CMP_EQ, (scmp_datum_t)getpid());
    const struct scmp_arg_cmp say[] = {SCMP_A0(SCMP_CMP_EQ, BW_WORKER_CHANNEL), SCMP_A4(SCMP_CMP_EQ, 0)}; /* no address */
    const struct scmp_arg_cmp read_limit[] = {SCMP_A0(SCMP_CMP_EQ, 0), SCMP_A2(SCMP_CMP_EQ, 0)};
    return add(filter, SCMP_ACT_ALLOW, SCMP_SYS(clone), 1, &thread) && /* clone3 is ENOSYS: its flags are not in sight */
           add(filter, SCMP_ACT_KILL_PROCESS, SCMP_SYS(clone), 1, &process) &&
           add(filter, SCMP_ACT_ALLOW, SCMP_SYS(mmap), 1, &not_code) &&
           add(filter, SCMP_ACT_ALLOW, SCMP_SYS(mprotect), 1, &not_code) &&
           add(filter, SCMP_ACT_ALLOW, SCMP_SYS(kill), 1, &myself) &&
           add(filter, SCMP_ACT_ALLOW, SCMP_SYS(tgkill), 1, &myself) &&
           add(filter, SCMP_ACT_ALLOW, SCMP_SYS(sendto), 2, say) &&
           add(filter, SCMP_ACT_ALLOW, SCMP_SYS(prlimit64), 2, read_limit);
}

static bool add_fcntl(scmp_filter_ctx filter) {
    bool good = true;
    for (size_t i = 0; good && i < sizeof allowed_fcntl / sizeof *allowed_fcntl; i++) {
        const struct scmp_arg_cmp command = SCMP_A1(SCMP_CMP_EQ, (scmp_datum_t)allowed_fcntl[i]);
        good = add(filter, SCMP_ACT_ALLOW, SCMP_SYS(fcntl), 1, &command);
    }
    return good;
}

static void enter_seccomp(bw_sandbox *s) {
    if (SANITIZER) return miss(s, "seccomp", "built with a sanitizer");
    scmp_filter_ctx filter = seccomp_init(SCMP_ACT_ERRNO(ENOSYS));
    bool good = filter && seccomp_attr_set(filter, SCMP_FLTATR_ACT_BADARCH, SCMP_ACT_KILL_PROCESS) == 0 &&
                seccomp_attr_set(filter, SCMP_FLTATR_CTL_TSYNC, 1) == 0 && seccomp_attr_set(filter, SCMP_FLTATR_CTL_OPTIMIZE, 2) == 0;
    for (size_t i = 0; good && i < sizeof allowed / sizeof *allowed; i++) good = add(filter, SCMP_ACT_ALLOW, allowed[i], 0, NULL);
    for (size_t i = 0; good && i < sizeof deadly / sizeof *deadly; i++)
        good = add(filter, SCMP_ACT_KILL_PROCESS, deadly[i], 0, NULL);
    int error = good && add_conditional(filter) && add_fcntl(filter) ? seccomp_load(filter) : -EINVAL;
    if (filter) seccomp_release(filter);
    s->seccomp = error == 0;
    if (error) miss(s, "seccomp", strerror(-error));
}

/* ---- all of it ---- */

void bw_sandbox_enter(const int *readable, size_t count, bw_sandbox *s) {
    struct rlimit as;
    memset(s, 0, sizeof *s);
    s->no_new_privileges = prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0;
    if (!s->no_new_privileges) miss(s, "no_new_privs", strerror(errno));
    s->address_space = getrlimit(RLIMIT_AS, &as) == 0 && as.rlim_cur != RLIM_INFINITY;
    if (!s->address_space) miss(s, "memory", SANITIZER ? "built with a sanitizer" : "the address space is not limited");
    enter_landlock(readable, count, s);
    enter_seccomp(s); /* last, for Landlock's own calls are not on the list */
}

void bw_sandbox_json(const bw_sandbox *s, char text[BW_SANDBOX_TEXT]) {
    static const char *const words[] = {"false", "true"};
    snprintf(text, BW_SANDBOX_TEXT,
             "{\"no_new_privileges\":%s,\"seccomp\":%s,\"landlock\":%d,\"address_space\":%s,\"missing\":\"%s\"}",
             words[s->no_new_privileges], words[s->seccomp], s->landlock, words[s->address_space], s->missing);
}
