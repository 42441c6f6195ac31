"""kill -9 of the daemon, its spawner and its workers at random moments, while clients go on submitting.

Every accepted job (its 201 was seen) must end exactly once, in the state its script asks for, with the right bytes; its attempts
grow; nothing is accepted twice or lost; nothing temporary is left. A job whose worker dies three times in one stage fails, and
rightly so: no worker of the same job and stage is killed more than twice. Then a queue of many rows is recovered.
"""
import json
import os
import random
import signal
import subprocess
import threading
import time

import kit


def make_job(rng, number, stages, shared):
    """A random kind of job; some of them are of a script that another job has already."""
    stage = rng.choice(stages)
    kind = rng.random()
    script = "* sleep %d\nencode bytes %d\n" % (rng.choice((0, 0, 1, 5, 20)), rng.randrange(0, 3000))
    if kind < 0.08:
        return kit.Job(script + "%s fail non-manifold\n# %d\n" % (stage, number), "failed", "non-manifold")
    if kind < 0.10:
        return kit.Job(script + "%s exit 3\n# %d\n" % (stage, number), "failed", "worker-died")
    if kind < 0.13:
        return kit.Job(script + "%s flaky %d\n# %d\n" % (stage, rng.randrange(1, 3) + stages.index(stage), number))
    if kind < 0.22:
        return kit.Job(script + "%s sleep %d\n# %d\n" % (stage, rng.randrange(0, 200), number), "successful|dismissed", action="cancel")
    if kind < 0.27:
        return kit.Job(script + "reduce search 300\n# %d\n" % number, action="finish")
    if kind < 0.34:
        return kit.Job(script + "# %d\n" % number, until=stage)
    if kind < 0.44 and shared:
        return kit.Job(rng.choice(shared).script.decode())
    job = kit.Job(script + "# %d\n" % number)
    shared.append(job)
    return job


class Storm:
    def __init__(self, arguments):
        self.a, self.rng = arguments, random.Random(arguments.seed)
        self.daemon = kit.Daemon(arguments.bin, arguments.folder, ["--workers", "2", *arguments.daemon_option])
        self.daemon.start()
        self.interface = kit.Interface(kit.Client(self.daemon))
        self.stages = self.interface.stages
        self.lock = threading.Lock()
        self.jobs, self.shared = [], []  # accepted ones, in the order of their 201
        self.made = self.unanswered = self.acted = self.looked = 0
        self.kills = {"daemon": 0, "daemon while it starts": 0, "spawner": 0, "worker": 0}
        self.killed = {}  # (job, stage): workers of it killed here
        self.restarts = []
        self.enough, self.finding = False, None

    def total_kills(self):
        return sum(self.kills.values())

    # ---- clients ----

    def next_job(self):
        with self.lock:
            quota = self.a.jobs if self.enough else self.a.jobs * (self.total_kills() + 1) // self.a.kills + 8
            if self.made >= min(quota, self.a.jobs):
                return None
            self.made += 1
            return make_job(self.rng, self.made, self.stages, self.shared), self.made

    def insist(self, attempt, until_end=600):
        """Repeats what the death of the daemon may have cut short."""
        end = time.monotonic() + until_end
        while time.monotonic() < end:
            try:
                result = attempt()
                if result is not False:
                    return result
            except kit.Gone:
                pass
            time.sleep(0.01)
        raise kit.Finding("no answer for %d s; %s" % (until_end, self.daemon.tail()))

    def submit(self, client, job, number):
        key = "storm-%d-%d" % (self.a.seed, number) if self.interface.idempotency else None
        how = "streamed" if number % 3 == 0 and "streamed" in self.interface.ways else "whole"

        def attempt():
            try:
                return kit.submit(client, job, key, how)
            except kit.Gone:
                with self.lock:
                    self.unanswered += 1
                raise
        self.insist(attempt)

    def act(self, client, job):
        """Cancels or finishes what its kind says; what was answered with 200 binds the daemon."""
        def attempt():
            reply = client.post("/v1/jobs/%s/%s" % (job.id, job.action))
            if reply.status >= 500:
                return False
            kit.expect(reply.status in (200, 409), "%s of job %s: %d %s", job.action, job.id, reply.status, reply.body[:300])
            return reply.status
        if self.insist(attempt) == 200:
            job.dismissed = job.action == "cancel"
            self.acted += 1

    def client(self):
        client = kit.Client(self.daemon)
        try:
            while True:
                got = self.next_job()
                if got is None and self.enough:
                    return
                if got is None:
                    time.sleep(0.005)
                    continue
                job, number = got
                self.submit(client, job, number)
                with self.lock:
                    self.jobs.append(job)
                if job.action:
                    self.act(client, job)
        except Exception as error:
            self.finding = self.finding or error

    def reader(self):
        """Looks at jobs while the storm is on: what has ended once has ended for good, what is served is right at any time."""
        client, rng = kit.Client(self.daemon), random.Random(self.a.seed + 1)
        try:
            while not self.enough:
                with self.lock:
                    job = rng.choice(self.jobs) if self.jobs else None
                try:
                    self.look(client, job)
                except kit.Gone:
                    pass
                time.sleep(0.01)
        except Exception as error:
            self.finding = self.finding or error

    def look(self, client, job):
        if not job:
            return
        reply = client.get("/v1/jobs/" + job.id)
        kit.expect(reply.status == 200 or reply.status >= 500, "the accepted job %s: %d %s", job.id, reply.status, reply.body[:200])
        state = reply.json() if reply.status == 200 else {"state": ""}
        if state["state"] in kit.FINAL:
            job.check_final(state, self.stages)
            self.looked += 1
        if state["state"] == "successful":
            job.check_results(client, self.stages)

    # ---- kills ----

    def restart(self):
        self.daemon.spawn()
        if self.rng.random() < 0.15 and self.total_kills() < self.a.kills:
            time.sleep(self.rng.random() * 0.06)
            self.daemon.kill()
            self.kills["daemon while it starts"] += 1
            self.daemon.spawn()
        before = time.monotonic()
        kit.expect(self.daemon.wait(), "the daemon does not start again, code %s; %s", self.daemon.code, self.daemon.tail())
        self.restarts.append(time.monotonic() - before)

    def kill_worker(self):
        found = [(pid, job, stage) for pid, job, stage in self.daemon.workers() if self.killed.get((job, stage), 0) < 2]
        if not found:
            return
        pid, job, stage = self.rng.choice(found)
        self.killed[job, stage] = self.killed.get((job, stage), 0) + 1
        try:
            os.kill(pid, signal.SIGKILL)
            self.kills["worker"] += 1
        except OSError:
            pass

    def kill_spawner(self):
        pid = self.daemon.spawner()
        if not pid:
            return
        os.kill(pid, signal.SIGKILL)
        self.kills["spawner"] += 1
        code = self.daemon.wait_end(30)
        kit.expect(code == 5, "without its spawner the daemon ends with code %s; %s", code, self.daemon.tail())
        kit.expect("level=error" in self.daemon.log(), "the daemon ended without its spawner and did not say why")
        self.restart()

    def kill_one(self):
        which = self.rng.random()
        if which < 0.50:
            self.kill_worker()
        elif which < 0.60:
            self.kill_spawner()
        else:
            self.daemon.kill()
            self.kills["daemon"] += 1
            self.restart()

    # ---- the whole ----

    def storm(self):
        threads = [threading.Thread(target=self.client, daemon=True) for _ in range(2)] + [threading.Thread(target=self.reader, daemon=True)]
        for thread in threads:
            thread.start()
        before = time.monotonic()
        while self.total_kills() < self.a.kills and not self.finding:
            time.sleep(0.3 * self.rng.random() ** 2)
            kit.expect(not self.daemon.ended(), "the daemon ended by itself with code %s; %s", self.daemon.code, self.daemon.tail())
            self.kill_one()
        self.enough = True
        for thread in threads:
            thread.join(900)
            kit.expect(not thread.is_alive(), "a client does not come to its end; %s", self.daemon.tail())
        if self.finding:
            raise self.finding
        print("%d kills in %.0f s: %s; %d restarts, longest until it listened %.2f s"
              % (self.total_kills(), time.monotonic() - before, ", ".join("%d of %s" % (n, k) for k, n in self.kills.items()),
                 len(self.restarts), max(self.restarts, default=0)), flush=True)

    def settle(self):
        client, total, states = kit.Client(self.daemon), 0, {}
        before = time.monotonic()
        for job in self.jobs:
            state = client.wait_final(job.id, 900 if self.a.full else 120)
            job.check_final(state, self.stages)
            states[state["state"]] = states.get(state["state"], 0) + 1
            if state["state"] == "successful":
                total += job.check_results(client, self.stages)
        print("%d accepted jobs ended after %.0f s more: %s; %d cancels and finishes answered with 200; %.1f MB of results compared; "
              "%d ends seen in the storm" % (len(self.jobs), time.monotonic() - before, states, self.acted, total / 1e6, self.looked), flush=True)
        self.count(client)

    def count(self, client):
        ids = {job.id for job in self.jobs}
        kit.expect(len(ids) == len(self.jobs), "two submissions were answered with the same id")
        deadline = time.monotonic() + 120
        while True:
            listed = client.all_jobs()
            if all(job["state"] in kit.FINAL for job in listed) or time.monotonic() > deadline:
                break
            time.sleep(0.2)
        found = [job["id"] for job in listed]
        kit.expect(len(found) == len(set(found)), "a job is listed twice")
        kit.expect(ids <= set(found), "accepted and not listed: %s", sorted(ids - set(found))[:5])
        open_ones = [job["id"] for job in listed if job["state"] not in kit.FINAL]
        kit.expect(not open_ones, "jobs that never end: %s", open_ones[:5])
        extra = len(found) - len(ids)
        most = 0 if self.interface.idempotency else self.unanswered
        kit.expect(extra <= most, "%d jobs too many (%d submissions were unanswered)", extra, self.unanswered)
        print("%d jobs listed, %d of them from the %d submissions that the daemon died in; idempotency keys: %s"
              % (len(found), extra, self.unanswered, "yes" if self.interface.idempotency else "not offered by this daemon"), flush=True)

    def run(self):
        try:
            self.storm()
            self.settle()
            self.daemon.stop()
            print("stopped in order: %s" % kit.audit(self.daemon), flush=True)
        finally:
            self.daemon.remove()


def count_rows(daemon):
    """Jobs by state, and how many have an attempt under way, read while no daemon runs."""
    db = kit.sqlite3.connect("file:%s?mode=ro" % daemon.database(), uri=True)
    states = dict(db.execute("SELECT state, count(*) FROM jobs GROUP BY state").fetchall())
    under_way = db.execute("SELECT count(*) FROM attempts WHERE finished = 0").fetchone()[0]
    db.close()
    return states, under_way


def recovery(a):
    """A daemon that was killed with many jobs waiting and half as many attempts open: how long until it listens again."""
    daemon = kit.Daemon(a.bin, a.folder, ["--workers", "2", *a.daemon_option])
    try:
        daemon.start()
        sleeper = kit.Job("* sleep 10000000\n")
        kit.Client(daemon).upload(sleeper.script)
        daemon.stop()
        waiting, under_way = a.rows - a.rows // 3, a.rows // 3
        shim = kit.Shim(a.bin, a.folder, "call=fsync|fdatasync,times=0,do=skip")  # the disk is not the point
        shim.arm()
        before = time.monotonic()
        done = subprocess.run([os.path.join(a.bin, "torture_rows"), daemon.database(), sleeper.sha256, str(waiting), str(under_way), "0"],
                              env={**os.environ, **shim.environment})
        shim.close()
        kit.expect(done.returncode == 0, "torture_rows ended with code %d", done.returncode)
        made = time.monotonic() - before
        seconds = daemon.start(seconds=300)
        client = kit.Client(daemon)
        before = time.monotonic()
        while len(daemon.workers()) < 2:
            kit.expect(time.monotonic() - before < 60, "no worker starts after the recovery; %s", daemon.tail())
            time.sleep(0.01)
        working = time.monotonic() - before
        before = time.monotonic()
        kit.expect(client.get("/readyz").status == 200, "not ready after the recovery")
        answer = time.monotonic() - before
        daemon.kill()
        states, _ = count_rows(daemon)
        kit.expect(sum(states.values()) == a.rows and set(states) <= {0, 1}, "%d rows were waiting and open, now: %s", a.rows, states)
        line = [l for l in daemon.log().splitlines() if "event=daemon.recovered" in l]
        print("%d rows waiting, %d open (made in %.0f s): listens after %.2f s (target 5 s), both workers busy %.2f s later, "
              "/readyz in %.1f ms; %s" % (waiting, under_way, made, seconds, working, answer * 1e3, line[0].split("event=")[1] if line else ""), flush=True)
        if a.full and seconds >= 5:
            print("TARGET MISSED: recovery %.2f s" % seconds)
    finally:
        daemon.remove()


def main():
    a = kit.parse(__doc__, [("kills", 60, 1000, "how many kills"), ("jobs", 120, 2000, "how many jobs"),
                            ("rows", 6000, 100000, "rows of the recovery")])
    Storm(a).run()
    recovery(a)


if __name__ == "__main__":
    kit.run(main)
