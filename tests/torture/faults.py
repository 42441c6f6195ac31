"""System calls that fail, crash points, a full and a slow disk, a locked database, clocks that jump, at every stage of a job's life.

Every call of a kind that the daemon makes between the upload and the last byte of the results is counted, then made to fail in a run
of its own (shim.c). Whatever happens: a job whose 201 was seen ends as its script asks for with the right bytes, at the latest after
a restart without faults; no wrong byte is ever served; the daemon goes on, or ends with code 5 or abort and says why in its log.
"""
import os
import random
import sqlite3
import threading
import time

import kit

ACTIONS = {"write": ("EIO", "ENOSPC", "EINTR", "short", "torn", "kill"), "read": ("EIO", "short"), "open": ("EIO", "EMFILE", "kill"),
           "fsync": ("EIO", "ENOSPC", "kill"), "fdatasync": ("EIO", "ENOSPC", "kill"), "ftruncate": ("EIO", "kill"),
           "rename": ("EIO", "ENOSPC", "kill"), "mkdir": ("EIO", "ENOSPC", "kill"), "unlink": ("EIO", "kill")}
FULL_DISK = "write|ftruncate|mkdir|rename"
DATA = "path=*/bw-torture-*/*,"  # all below the data folder, not the log
HOUR, DAY = 3600 * 1000, 86400 * 1000


class Faults:
    def __init__(self, arguments):
        self.a, self.rng = arguments, random.Random(arguments.seed)
        self.daemon = kit.Daemon(arguments.bin, arguments.folder, ["--workers", "2", "--upload-keep", "10m", *arguments.daemon_option])
        self.daemon.start()
        self.client = kit.Client(self.daemon, timeout=30)
        self.interface = kit.Interface(self.client)
        self.stages = self.interface.stages
        self.daemon.stop()
        self.number, self.shim = 0, None
        self.done = []  # jobs of earlier cases
        self.once = {}  # hash of the input: how many jobs of it have been accepted, by their keys
        self.tally = {}  # what became of the daemon: how often

    def new_job(self, script="", **kind):
        self.number += 1
        return kit.Job("encode bytes %d\n%s# %d of %d\n" % (self.rng.randrange(0, 5000), script, self.number, self.a.seed), **kind)

    # ---- one case ----

    def note_end(self, rules):
        """The daemon has ended: it may, if it says why."""
        code = self.daemon.code
        killed = "do=kill" in rules or "do=torn" in rules
        kit.expect(code in (5, -6) or (killed and code == -9), "ended with code %s; %s", code, self.daemon.tail())
        if code != -9:
            kit.expect("level=error" in self.daemon.log(), "ended with code %s and does not say why; %s", code, self.daemon.tail())
        what = {5: "stopped with a message", -6: "aborted with a message", -9: "killed"}[code]
        self.tally[what] = self.tally.get(what, 0) + 1

    def insist(self, rules, attempt, seconds=60):
        """Repeats `attempt` until it is not False; starts the daemon again, without faults, when it has ended. A fault that lasts
        is over after a while (the disk has room again)."""
        begun = time.monotonic()
        while time.monotonic() < begun + seconds:
            if self.shim and time.monotonic() > begun + 2:
                self.shim.disarm()
            try:
                result = attempt()
                if result is not False:
                    return result
            except kit.Gone:
                if self.daemon.process and not self.daemon.ended():
                    time.sleep(0.01)  # it may be about to end
            if self.daemon.ended():
                self.note_end(rules)
                self.daemon.start()
            time.sleep(0.005)
        raise kit.Finding("nothing helps for %d s; %s" % (seconds, self.daemon.tail()))

    def live(self, rules, job, may_fail):
        """The life of a job from upload to results, against all odds."""
        how = self.rng.choice(self.interface.ways)
        key = "faults-%d-%s" % (self.a.seed, job.sha256[:20]) if self.interface.idempotency else None
        job.twin = kit.Job(job.script.decode(), until=self.stages[1])
        self.insist(rules, lambda: kit.submit(self.client, job, key, how))
        if key:
            self.once[job.sha256] = 1 + (how == "batch")
        if how == "batch":
            self.done.append(job.twin)

        def ended():
            reply = self.client.get("/v1/jobs/" + job.id)
            kit.expect(reply.status == 200 or reply.status >= 500, "the accepted job %s: %d %s", job.id, reply.status, reply.body[:200])
            return reply.json() if reply.status == 200 and reply.json()["state"] in kit.FINAL else False

        state = self.insist(rules, ended)
        if state["state"] == "failed" and may_fail and state["failure"]["class"] == "system":
            return False
        job.check_final(state, self.stages)
        self.insist(rules, lambda: self.check(job))
        return True

    def check(self, job):
        job.check_results(self.client, self.stages)
        return True

    def case(self, rules, phase="job", may_fail=False):
        shim = self.shim = kit.Shim(self.a.bin, self.a.folder, rules)
        job = self.new_job()
        try:
            if phase == "start":
                self.leave_work(job)
                shim.arm()
            self.daemon.spawn(shim.environment)
            if not self.daemon.wait():
                self.note_end(rules)
                self.daemon.start()
            if phase == "job":
                shim.arm(self.daemon.pid())
            good = self.live(rules, job, may_fail)
            shim.disarm()
            if not good:
                job = self.again(rules, job)
            self.finish_case(rules, shim, phase, job)
            return sum(shim.fired())
        except kit.Finding as finding:
            raise kit.Finding("%s\n  in the case --case '%s' of phase %s" % (finding, rules, phase)) from None
        finally:
            shim.close()
            self.shim = None

    def leave_work(self, job):
        """A daemon dies with an attempt open and a cache entry without its job's end, for the next start to put right."""
        self.daemon.start()
        held = kit.Job("build sleep 10000\n" + job.script.decode())
        kit.expect(kit.submit(self.client, held), "cannot submit")
        while not any(stage == "build" for _, _, stage in self.daemon.workers()):
            time.sleep(0.005)
        self.client.post("/v1/jobs/%s/cancel" % held.id)
        self.daemon.kill()

    def again(self, rules, job):
        """A job that failed as the system's fault while the fault lasted is as good as new when it is over."""
        self.tally["job failed as system"] = self.tally.get("job failed as system", 0) + 1
        if self.interface.retry:
            kit.expect(self.client.post("/v1/jobs/%s/retry" % job.id).status == 200, "cannot retry job %s", job.id)
        else:
            job = kit.Job(job.script.decode())
        kit.expect(self.live(rules, job, False), "job %s fails after the fault is over", job.id)
        return job

    def finish_case(self, rules, shim, phase, job):
        if self.daemon.ended():
            self.note_end(rules)
            self.daemon.start()
        elif phase != "stop":
            self.tally["went on"] = self.tally.get("went on", 0) + (1 if sum(shim.fired()) else 0)
        for old in self.rng.sample(self.done, min(2, len(self.done))) + [job]:
            old.check_final(self.client.wait_final(old.id), self.stages)
            old.check_results(self.client, self.stages)
        self.done.append(job)
        if phase == "stop":
            shim.arm(self.daemon.pid())
            self.daemon.process.send_signal(15)
            if self.daemon.wait_end() != 0:
                self.note_end(rules)
        else:
            self.daemon.stop()

    # ---- all of them ----

    def count(self, phase):
        """How many calls of each kind the daemon makes in this phase."""
        calls = list(ACTIONS)
        shim = kit.Shim(self.a.bin, self.a.folder, ";".join(DATA + "call=%s,do=count" % c for c in calls))
        job = self.new_job()
        if phase == "start":
            self.leave_work(job)
            shim.arm()
        self.daemon.start(shim.environment)
        if phase == "start":
            counted = shim.matched()
        else:
            if phase == "job":
                shim.arm(self.daemon.pid())
            self.live("", job, False)
            counted = shim.matched()
            if phase == "stop":
                shim.arm(self.daemon.pid())
        self.daemon.stop()
        counted = shim.matched() if phase == "stop" else counted
        shim.close()
        return dict(zip(calls, counted))

    def plan(self):
        cases = []
        for phase in ("job", "start", "stop"):
            numbers = self.count(phase)
            print("%s: %s" % (phase, ", ".join("%d %s" % (n, c) for c, n in numbers.items() if n)), flush=True)
            for call, n in numbers.items():
                cases += [(DATA + "call=%s,nth=%d,do=%s" % (call, i, what), phase, False) for i in range(1, n + 1) for what in ACTIONS[call]]
            if phase == "job":
                full = numbers["write"] + numbers["mkdir"] + numbers["rename"]
                cases += [(DATA + "call=%s,nth=%d,times=%d,do=ENOSPC" % (FULL_DISK, i, times), phase, True) for i in range(1, full + 1) for times in (5, 0)]
                cases += [(DATA + "call=fsync|fdatasync,nth=%d,times=0,do=%s" % (i, what), phase, True)
                          for i in range(1, numbers["fsync"] + numbers["fdatasync"] + 1) for what in ("EIO", "ENOSPC")]
        return cases

    def enumerate(self):
        cases = self.plan()
        chosen = cases[self.a.skip:] if self.a.cases >= len(cases) else self.rng.sample(cases, self.a.cases)
        hits, before = [], time.monotonic()
        for i, (rules, phase, may_fail) in enumerate(chosen):
            self.attempt("calls", lambda: hits.append(self.case(rules, phase, may_fail)))
            if (i + 1) % 200 == 0:
                print("  %d cases, %.0f s, %s" % (i + 1, time.monotonic() - before, self.tally), flush=True)
        print("%d of %d cases in %.0f s, the fault came in %d; the daemon: %s" % (len(chosen), len(cases), time.monotonic() - before, sum(map(bool, hits)), self.tally), flush=True)

    def slow_disk(self):
        """Every sync takes long: all is answered in the end, and what needs no disk is answered at once."""
        shim = kit.Shim(self.a.bin, self.a.folder, "call=fsync|fdatasync,times=0,do=delay:%d" % self.a.delay)
        self.daemon.start(shim.environment)
        shim.arm(self.daemon.pid())
        jobs, times, stop = [self.new_job() for _ in range(3)], [], threading.Event()

        def probe():
            client = kit.Client(self.daemon)
            while not stop.is_set():
                before = time.monotonic()
                client.get("/livez")
                times.append(time.monotonic() - before)
                time.sleep(0.02)

        prober = threading.Thread(target=probe, daemon=True)
        prober.start()
        before = time.monotonic()
        for job in jobs:
            kit.expect(self.live("", job, False), "a slow disk makes job %s fail", job.id)
        seconds = time.monotonic() - before
        stop.set()
        prober.join()
        shim.close()
        kit.expect(not self.daemon.ended(), "a slow disk ended the daemon; %s", self.daemon.tail())
        self.daemon.stop()
        print("syncs of %d ms: 3 jobs in %.1f s; /livez meanwhile: worst of %d %.1f ms" % (self.a.delay, seconds, len(times), 1e3 * max(times)), flush=True)

    # ---- a second process that holds the database ----

    def hold(self, seconds, released):
        """Holds the write lock. False if the daemon does not let anybody in."""
        db = sqlite3.connect(self.daemon.database(), isolation_level=None, timeout=5, check_same_thread=False)
        try:
            db.execute("BEGIN IMMEDIATE")
        except sqlite3.OperationalError as error:
            print("a second process cannot lock the database (%s): nothing to see here" % error, flush=True)
            db.close()
            return False

        def release():
            db.execute("ROLLBACK")
            db.close()
            released.set()

        threading.Timer(seconds, release).start()
        return True

    def busy(self, seconds, at_start):
        released, rules = threading.Event(), "SQLITE_BUSY for %d s" % seconds
        running = self.new_job("build sleep 300\n")
        try:
            if at_start:
                if not self.hold(seconds, released):
                    return
                self.daemon.spawn()
                if not self.daemon.wait(seconds + 60):
                    self.note_end(rules)
            else:
                self.daemon.start()
                self.live_submit(rules, running)
                if not self.hold(seconds, released):
                    self.daemon.stop()
                    return
            job = self.new_job()
            before = time.monotonic()
            if self.daemon.ended():
                released.wait()
                self.daemon.start()
            self.insist_locked(rules, released, lambda: kit.submit(self.client, job), seconds)
            accepted = time.monotonic() - before
            self.insist_locked(rules, released, lambda: released.is_set(), seconds)
            for one in (job,) if at_start else (job, running):
                self.finish_locked(rules, one)
            print("database locked for %d s %s: accepted after %.1f s, daemon started %d times in all"
                  % (seconds, "at the start" if at_start else "with a job running", accepted, self.daemon.starts), flush=True)
            self.daemon.stop()
        except kit.Finding as finding:
            raise kit.Finding("%s\n  with the database locked for %d s%s" % (finding, seconds, " at the start" if at_start else "")) from None

    def live_submit(self, rules, job):
        self.insist(rules, lambda: kit.submit(self.client, job))

    def insist_locked(self, rules, released, attempt, seconds):
        """As insist, but a daemon that has ended is started again only when the lock is gone, as its supervisor would in the end."""
        end = time.monotonic() + seconds + 60
        while time.monotonic() < end:
            try:
                if attempt():
                    return
            except kit.Gone:
                time.sleep(0.05)
            if self.daemon.ended():
                self.note_end(rules)
                released.wait(seconds + 10)
                self.daemon.start()
            time.sleep(0.02)
        raise kit.Finding("nothing helps; %s" % self.daemon.tail())

    def finish_locked(self, rules, job):
        def ended():
            state = self.client.job(job.id)
            return state if state["state"] in kit.FINAL else False
        job.check_final(self.insist(rules, ended), self.stages)
        self.insist(rules, lambda: self.check(job))

    # ---- clocks ----

    def clock(self, ms, script, when):
        """The wall clock jumps by `ms` when a worker of the stage `when` runs (or while the daemon is down): the job ends in good time."""
        shim, job = kit.Shim(self.a.bin, self.a.folder), self.new_job(script)
        try:
            self.daemon.start(shim.environment)
            self.live_submit("", job)
            end = time.monotonic() + 20
            while when != "down" and time.monotonic() < end and not any(stage == when for _, _, stage in self.daemon.workers()):
                time.sleep(0.002)
            if when == "down":
                time.sleep(0.2)
                self.daemon.kill()
            shim.move_clock(ms)
            if when == "down":
                self.daemon.start(shim.environment)
            before = time.monotonic()
            state = self.client.wait_final(job.id, 30)
            job.check_final(state, self.stages)
            self.check(job)
            self.daemon.stop()
            print("clock moved by %+.1f h with '%s' (%s): ended after %.1f s" % (ms / HOUR, script.strip().replace("\n", ", "), when, time.monotonic() - before), flush=True)
        except kit.Finding as finding:
            raise kit.Finding("%s\n  after the clock moved by %d ms with '%s' (%s)" % (finding, ms, script.strip().replace("\n", ", "), when)) from None
        finally:
            shim.close()

    def clocks(self):
        for ms in (HOUR, -HOUR, 400 * DAY, -400 * DAY) if self.a.full else (DAY, -DAY):
            self.clock(ms, "build sleep 300\n", "build")
            self.clock(ms, "build sleep 60\nbuild flaky 4\n", "build")
            self.clock(ms, "build sleep 60\nbuild flaky 4\n", "down")

    # ---- the whole ----

    def count_jobs(self):
        """With keys, no job is there twice, whatever answer was lost."""
        found = {}
        for job in self.client.all_jobs():
            found[job["input"]] = found.get(job["input"], 0) + 1
        wrong = {sha256: found.get(sha256, 0) for sha256, n in self.once.items() if found.get(sha256, 0) != n}
        kit.expect(not wrong, "jobs of these inputs are there so often, and not as often as accepted: %s", wrong)
        print("%d inputs submitted with a key, each accepted exactly as often as it was asked for" % len(self.once), flush=True)

    def attempt(self, name, function, *arguments):
        """Goes on after a finding, so that one run tells all."""
        try:
            function(*arguments)
        except kit.Finding as finding:
            self.findings += 1
            print("FOUND (%s): %s" % (name, finding), flush=True)
            self.daemon.kill()
            kit.expect(self.findings < 20, "too many findings to go on")

    def run(self):
        self.findings = 0
        try:
            if self.a.case:
                self.case(self.a.case, self.a.phase, True)
                return print("the case went well: %s" % self.tally)
            self.attempt("clock", self.clocks)
            self.attempt("busy", self.busy, 2, False)
            self.attempt("busy", self.busy, 2, True)
            if self.a.full:
                self.attempt("busy", self.busy, 15, False)
                self.attempt("busy", self.busy, 15, True)
            self.attempt("slow disk", self.slow_disk)
            self.attempt("calls", self.enumerate)
            self.daemon.start()
            self.attempt("count", self.count_jobs)
            self.daemon.stop()
            print("in the end: %s" % kit.audit(self.daemon), flush=True)
        finally:
            self.daemon.remove()
        kit.expect(not self.findings, "%d findings, see above", self.findings)


def main():
    Faults(kit.parse(__doc__, [("cases", 40, 1000000, "how many of the enumerated faults, drawn at random"), ("delay", 50, 300, "ms of a sync on the slow disk"),
                               ("skip", 0, 0, "with all of them: leave out the first so many"),
                               ("case", "", "", "only this rule of shim.c"), ("phase", "job", "job", "its phase: job, start or stop")])).run()


if __name__ == "__main__":
    kit.run(main)
