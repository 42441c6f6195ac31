"""Many jobs through one daemon: does anything grow that should not?

Jobs are submitted so that a few dozen wait at any time. Every so many jobs the daemon is looked at when it has just become idle:
resident memory of daemon and spawner, their open descriptors, bytes of WAL and database, bytes and files of each folder of its data.
Over the last two thirds of the samples a straight line is laid through each; its slope per 10 000 jobs is printed and held against
what rows and the retention policy explain. Memory may grow until the caches of the database's connections are full (--cache MB);
after that its slope counts too. The WAL comes and goes: its size counts (--wal MB). A sample of the results is compared byte for byte.

Without retention the folders keep what the jobs have made: blobs, cache and logs may grow by what these jobs write, no more. With
--keep N (and a daemon configured, by --daemon-option, to keep about that many ended jobs) they may not grow once N jobs have ended.
"""
import os
import random
import time

import kit

SAMPLES = 12


class Soak:
    def __init__(self, arguments):
        self.a, self.rng = arguments, random.Random(arguments.seed)
        self.daemon = kit.Daemon(arguments.bin, arguments.folder, ["--workers", "2", *arguments.daemon_option])
        self.daemon.start()
        self.client = kit.Client(self.daemon)
        self.sanitized = kit.sanitized(self.daemon.program)  # keeps what was freed: its memory tells nothing
        self.stages = kit.Interface(self.client).stages
        self.waiting, self.recent = [], []
        self.submitted = self.ended = self.compared = 0
        self.made = {"blobs": 0, "cache": 0, "logs": 0}  # bytes that the jobs ended so far explain, at most
        self.samples = []

    # ---- jobs ----

    def next_job(self):
        """A fifth is new and runs a stage or more; the others are of scripts seen lately and reuse what is there."""
        self.submitted += 1
        if self.recent and self.rng.random() >= self.a.fresh / 100:
            return kit.Job(self.rng.choice(self.recent).script.decode(), until=None)
        text = "encode bytes %d\n# %d of %d\n" % (self.rng.randrange(0, 2000), self.submitted, self.a.seed)
        until = None if self.rng.random() < 0.25 else self.rng.choice(self.stages[:2])
        if self.rng.random() < 0.03:
            return kit.Job("sanitize fail non-manifold\n" + text, "failed", "non-manifold", until)
        job = kit.Job(text, until=until)
        if not until:
            self.recent = (self.recent + [job])[-20:]
        self.made["blobs"] += len(job.script)
        self.made["cache"] += 8 * (len(job.script) + 400) + 3000 if not until else 2 * (len(job.script) + 400)
        return job

    def fill(self):
        """Submits until enough wait; a daemon that says 429 has its reasons."""
        while len(self.waiting) < 40 and self.submitted < self.a.jobs:
            job = self.next_job()
            end = time.monotonic() + 60
            while not kit.submit(self.client, job):
                kit.expect(time.monotonic() < end, "submissions are refused for a minute; %s", self.daemon.tail())
                time.sleep(0.05)
            self.waiting.append(job)
            self.made["logs"] += 400

    def drain(self, left):
        """Looks at the waiting jobs, oldest first, until no more than `left` of them wait."""
        end = time.monotonic() + 300
        while len(self.waiting) > left:
            kit.expect(time.monotonic() < end, "nothing ends any more; %s", self.daemon.tail())
            job = self.waiting[0]
            reply = self.client.get("/v1/jobs/" + job.id)
            if reply.status == 410 and self.a.keep:  # it ended, and so many after it that it has been removed
                self.waiting.pop(0)
                self.ended += 1
                continue
            kit.expect(reply.status == 200, "job %s: %d", job.id, reply.status)
            state = reply.json()
            if state["state"] not in kit.FINAL:
                time.sleep(0.005)
                continue
            job.check_final(state, self.stages)
            if state["state"] == "successful" and self.rng.random() < 0.05:
                job.check_results(self.client, self.stages)
                self.compared += 1
            self.waiting.pop(0)
            self.ended += 1

    # ---- what grows ----

    def look(self):
        data, pids = self.daemon.data, (self.daemon.pid(), self.daemon.spawner())
        kit.expect(all(pids), "the daemon has ended; %s", self.daemon.tail())
        wal = self.daemon.database() + "-wal"
        s = {"jobs": self.ended, "memory MB": kit.status_kib(pids[0], "VmRSS") / 1024, "spawner MB": kit.status_kib(pids[1], "VmRSS") / 1024,
             "descriptors": sum(len(os.listdir("/proc/%d/fd" % pid)) for pid in pids), "threads": len(os.listdir("/proc/%d/task" % pids[0])),
             "WAL MB": (os.path.getsize(wal) if os.path.exists(wal) else 0) / 1e6, "database MB": os.path.getsize(self.daemon.database()) / 1e6}
        for folder in sorted(os.listdir(data)):
            if os.path.isdir(os.path.join(data, folder)):
                size, count = kit.tree_bytes(os.path.join(data, folder))
                s[folder + " MB"], s[folder + " files"] = size / 1e6, count
        self.samples.append(s)
        print("  %6d jobs: %s" % (s["jobs"], ", ".join("%s %.5g" % item for item in list(s.items())[1:])), flush=True)

    def slope(self, name):
        """Least squares over the last two thirds: by how much `name` grows in 10 000 jobs."""
        part = self.samples[len(self.samples) // 3:]
        xs, ys = [s["jobs"] for s in part], [s.get(name, 0) for s in part]
        x, y = sum(xs) / len(xs), sum(ys) / len(ys)
        below = sum((v - x) ** 2 for v in xs)
        return 1e4 * sum((v - x) * (w - y) for v, w in zip(xs, ys)) / below if below else 0

    def allowed(self, name):
        """Greatest slope that is explained; None: only looked at."""
        kept = bool(self.a.keep)
        per_job = {k: 0.1 + 1.5 * v / self.submitted * 1e4 / 1e6 for k, v in self.made.items()}
        if name == "memory MB" and (self.sanitized or self.samples[-1][name] < self.samples[0][name] + self.a.cache):
            return None
        if name == "descriptors" and self.samples[-1][name] <= self.samples[0][name] + 16:  # readers of the database, opened when wanted
            return None
        fixed = {"memory MB": self.a.memory, "spawner MB": 5 if self.sanitized else 0.5, "descriptors": 1, "threads": 1, "tmp files": 0.5, "work files": 0.5}
        if name in fixed:
            return fixed[name]
        if name == "database MB":
            return 4 if kept else self.a.row * 1e4 / 1e6
        folder = name.split(" ")[0]
        if name.endswith(" MB") and folder in per_job:
            return 1 if kept else per_job[folder]
        return None

    def judge(self):
        print("slope per 10 000 jobs, from %d to %d jobs (allowed):" % (self.samples[len(self.samples) // 3]["jobs"], self.ended))
        too_much = []
        for name in list(self.samples[-1])[1:]:
            slope, most = self.slope(name), self.allowed(name)
            print("  %-18s %+10.4f  %s" % (name, slope, "" if most is None else "(%.4f)" % most), flush=True)
            if most is not None and slope > most:
                too_much.append("%s grows by %.3f in 10 000 jobs, explained is %.3f" % (name, slope, most))
        wal = max(s["WAL MB"] for s in self.samples)
        if wal > self.a.wal:
            too_much.append("the WAL had %.0f MB, it is to have %.0f at most" % (wal, self.a.wal))
        kit.expect(not too_much, "; ".join(too_much))

    def run(self):
        try:
            step, before = max(1, self.a.jobs // SAMPLES), time.monotonic()
            while self.ended < self.a.jobs:
                self.fill()
                due = self.ended + len(self.waiting) >= step * (len(self.samples) + 1) or self.submitted == self.a.jobs
                self.drain(0 if due else 20)
                if due:
                    self.look()
            seconds = time.monotonic() - before
            print("%d jobs in %.0f s, %.0f a second; %d results compared" % (self.ended, seconds, self.ended / seconds, self.compared), flush=True)
            self.judge()
            self.daemon.stop()
            print("stopped in order: %s" % kit.audit(self.daemon), flush=True)
        finally:
            self.daemon.remove()


def main():
    Soak(kit.parse(__doc__, [("jobs", 1200, 50000, "how many jobs"), ("fresh", 20, 20, "percent of the jobs that reuse nothing"),
                             ("keep", 0, 0, "ended jobs that the daemon was configured to keep about; 0: all"),
                             ("memory", 3.0, 3.0, "MB that the daemon may grow by in 10 000 jobs when its caches are full"),
                             ("cache", 110.0, 110.0, "MB of the database that the daemon keeps in memory"),
                             ("wal", 80.0, 80.0, "MB that the WAL may have at any look"),
                             ("row", 8000, 8000, "bytes of the database that a job may take")])).run()


if __name__ == "__main__":
    kit.run(main)
