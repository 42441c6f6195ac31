/* The sandbox: what a worker gives up for good before it looks at its input.
 *
 * The spawner has already closed all descriptors but the worker's own and set no_new_privs and the resource limits (spawner.h).
 * Here the worker, single-threaded still and with all libraries loaded, adds
 *
 *     Landlock   its scratch folder is all it can write, make, list or remove in; beside it, it reads its input's descriptors
 *                and /dev/urandom. No TCP, no signal and no abstract socket leaves it (as far as the kernel's Landlock can)
 *     seccomp    an allow-list of system calls. Unknown ones are ENOSYS; those that no honest worker makes (new processes and
 *                programs, sockets, ptrace, mounts, modules, ...) kill the process with SIGSYS. New threads are allowed
 *
 * Invariants
 *  1. Both are asked of the running kernel, not assumed; what could not be had is told (bw_sandbox.missing), and the worker
 *     tells it to the daemon in its hello frame.
 *  2. In builds with a sanitizer that needs system calls of its own (address, thread) there is no seccomp, and /proc is readable.
 */
#ifndef BW_SERVER_SANDBOX_H
#define BW_SERVER_SANDBOX_H

#include <stdbool.h>
#include <stddef.h>

enum { BW_SANDBOX_TEXT = 400 };

typedef struct {
    bool no_new_privileges, seccomp, address_space; /* in force; the last: RLIMIT_AS */
    int landlock;                                   /* version of its interface in force; 0: not in force */
    char missing[160];                              /* for people: what is not in force and why; "" if all is */
} bw_sandbox;

/* Enters the sandbox. `readable`: descriptors whose files may be opened again for reading (by /proc/self/fd); the scratch folder
 * is the working directory. Whatever fails is left out and told. */
void bw_sandbox_enter(const int *readable, size_t count, bw_sandbox *sandbox);
/* Everything is in force. */
static inline bool bw_sandbox_complete(const bw_sandbox *sandbox) {
    return sandbox->no_new_privileges && sandbox->seccomp && sandbox->address_space && sandbox->landlock > 0;
}
/* As a JSON object, the member "sandbox" of the hello frame. */
void bw_sandbox_json(const bw_sandbox *sandbox, char text[BW_SANDBOX_TEXT]);

#endif
