"""A daemon and its load on one machine: durable accepts, status, idle event streams, uploads, slow-loris connections, with many rows
in the queue. Prints every figure beside its target; times never fail a run unless --strict is given, wrong answers always do.

The rows are made by the queue's own functions (torture_rows): nine of ten have ended, one waits. One worker runs and sleeps, so that
daemon and generator have the cores for themselves. At the end the daemon is killed with SIGKILL and the rows are counted: each 201
has to have left one.
"""
import json
import os
import random
import subprocess
import threading
import time

import kit

MB = 1e6


class Sampler:
    """The greatest resident memory of daemon and spawner together while a phase runs, in MB, and where it began."""

    def __init__(self, daemon):
        self.pids, self.most, self.enough = (daemon.pid(), daemon.spawner()), 0, threading.Event()
        self.begin = self.now()
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def now(self):
        return sum(kit.status_kib(pid, "VmRSS") for pid in self.pids if pid) * 1024 / MB

    def run(self):
        while not self.enough.wait(0.05):
            self.most = max(self.most, self.now())

    def stop(self):
        self.most = max(self.most, self.now())
        self.enough.set()
        self.thread.join()
        return self.most


class Load:
    def __init__(self, arguments):
        self.a, self.rng = arguments, random.Random(arguments.seed)
        options = ["--workers", "1", "--max-upload", str(max(arguments.upload, arguments.flat) + 1)]
        self.daemon = kit.Daemon(arguments.bin, arguments.folder, options + arguments.daemon_option)
        self.ids = self.daemon.data + ".ids"
        self.rows, self.missed, self.accepted = [], 0, 0

    # ---- figures ----

    def figure(self, what, value, unit, target=None, least=False):
        good = target is None or (value >= target if least else value <= target)
        self.missed += not good
        self.rows.append((what, "%.4g %s" % (value, unit), "" if target is None else "%s %g %s" % (">=" if least else "<=", target, unit),
                          "" if target is None else "yes" if good else "MISSED"))
        print("  %-64s %16s %14s %s" % self.rows[-1], flush=True)

    def generate(self, mode, **settings):
        words = ["%s=%s" % item for item in settings.items()]
        return subprocess.Popen([os.path.join(self.a.bin, "torture_load"), mode, self.daemon.address, *words], stdout=subprocess.PIPE)

    def read(self, process, good):
        """The generator's report; every answer must have one of the codes in `good`."""
        text = process.communicate()[0]
        kit.expect(process.returncode == 0, "the generator ended with code %d; %s", process.returncode, self.daemon.tail())
        report = json.loads(text)
        if "status" in report:
            kit.expect(set(report["status"]) <= set(good), "answers: %s; %s", report["status"], self.daemon.tail())
            kit.expect(not report["broken"], "%d requests were not answered; %s", report["broken"], self.daemon.tail())
        self.accepted += report.get("status", {}).get("201", 0)
        return report

    # ---- phases ----

    def prepare(self):
        self.daemon.start()
        self.sleeper = kit.Job("* sleep 100000000\n")
        client = kit.Client(self.daemon)
        kit.expect(client.upload(self.sleeper.script).status == 201, "upload")
        self.interface = kit.Interface(client)
        self.daemon.stop()
        shim = kit.Shim(self.a.bin, self.a.folder, "call=fsync|fdatasync,times=0,do=skip")
        shim.arm()
        waiting, before = self.a.rows // 10, time.monotonic()
        done = subprocess.run([os.path.join(self.a.bin, "torture_rows"), self.daemon.database(), self.sleeper.sha256, str(waiting), "0",
                               str(self.a.rows - waiting), self.ids], env={**os.environ, **shim.environment})
        shim.close()
        kit.expect(done.returncode == 0, "torture_rows ended with code %d", done.returncode)
        print("%d rows in %.0f s, database %.0f MB" % (self.a.rows, time.monotonic() - before, os.path.getsize(self.daemon.database()) / MB), flush=True)
        self.figure("start with these rows", self.daemon.start(seconds=300), "s", 5)
        while not self.daemon.workers():
            time.sleep(0.01)

    def accepts(self):
        self.report_accepts("as fast as 32 connections can", 0, 32)
        self.report_accepts("1 000 due a second", 1000, 64)

    def report_accepts(self, how, rate, connections):
        sampler = Sampler(self.daemon)
        r = self.read(self.generate("accept", connections=connections, seconds=self.a.seconds, rate=rate, input=self.sleeper.sha256), ["201"])
        if rate:
            self.figure("accepts (%s): p50" % how, r["p50_ms"], "ms")
            self.figure("accepts (%s): p99" % how, r["p99_ms"], "ms", 50)
        self.figure("accepts (%s)" % how, r["per_second"], "/s", None if rate else 1000, least=True)
        if not rate:
            self.figure("accepts (%s): p99" % how, r["p99_ms"], "ms")
        self.figure("memory meanwhile, at most", sampler.stop(), "MB")

    def statuses(self):
        for how, rate in (("500 due a second", 500), ("8 connections, as fast as they can", 0)):
            r = self.read(self.generate("status", connections=8, seconds=self.a.seconds, rate=rate, ids=self.ids, seed=self.a.seed), ["200"])
            self.figure("status (%s): p50 of %d" % (how, r["answers"]), r["p50_ms"], "ms")
            self.figure("status (%s): p99" % how, r["p99_ms"], "ms", 5 if rate else None)
        both = [self.generate("accept", connections=64, seconds=self.a.seconds, rate=500, input=self.sleeper.sha256),
                self.generate("status", connections=8, seconds=self.a.seconds, rate=500, ids=self.ids, seed=self.a.seed)]
        accepts, status = self.read(both[0], ["201"]), self.read(both[1], ["200"])
        self.figure("500 accepts and 500 status a second: p99 accept", accepts["p99_ms"], "ms", 50)
        self.figure("500 accepts and 500 status a second: p99 status", status["p99_ms"], "ms", 5)

    def events(self):
        if not self.interface.events:
            print("  SKIPPED: this daemon has no /v1/jobs/{id}/events")
            return
        waiting = self.daemon.data + ".waiting"
        with open(self.ids) as f, open(waiting, "w") as out:
            out.writelines(f.readlines()[:1000])
        time.sleep(3)  # a quiet daemon gives the database's pages back
        before = Sampler(self.daemon)
        process = self.generate("events", connections=self.a.streams, seconds=self.a.seconds + 3, ids=waiting)
        r, most = self.read(process, ["200"]), before.stop()
        os.unlink(waiting)
        kit.expect(r["open"] == self.a.streams and not r["closed"], "%d streams wanted, %d stayed open, %d were closed, %d refused",
                   self.a.streams, r["open"], r["closed"], r["refused"])
        self.figure("%d idle event streams: memory" % self.a.streams, most, "MB", 64)
        self.figure("%d idle event streams: more memory than before" % self.a.streams, most - before.begin, "MB")

    def uploads(self):
        for size, text in ((self.a.upload, "speed"), (self.a.flat, "flat memory")):
            sampler = Sampler(self.daemon)
            r = self.read(self.generate("upload", bytes=size, seed=self.rng.randrange(1, 1 << 30)), [])
            most = sampler.stop()
            kit.expect(r["good"], "an upload was not answered with 201; %s", self.daemon.tail())
            kit.expect(most - sampler.begin < 64 or kit.sanitized(self.daemon.program), "an upload of %d bytes takes %.0f MB of memory", size, most - sampler.begin)
            name = "upload of %.4g MB (%s)" % (size / MB, text)
            self.figure(name + ", hashed and on disk", r["mb_per_second"], "MB/s", 400 if text == "speed" else None, least=True)
            self.figure(name + ": more memory than before", most - sampler.begin, "MB", 16)

    def loris(self):
        soft = self.a.loris
        r = self.read(self.generate("loris", connections=soft, seconds=self.a.seconds + 3, seed=self.a.seed), ["200", "408", "503"])
        kit.expect(r["answers"] > 0, "no answer of /readyz with %d slow connections: %s", soft, r)
        self.figure("%d slow-loris connections: p99 of %d /readyz" % (soft, r["answers"]), r["p99_ms"], "ms", 50)
        self.figure("%d slow-loris connections: open at the end" % soft, r["open"], "")
        self.figure("%d slow-loris connections: closed by the daemon" % soft, r["closed"], "")
        self.figure("%d slow-loris connections: /readyz refused or cut off" % soft, r["refused"], "", 0)

    def count(self):
        client = kit.Client(self.daemon)
        kit.expect(client.get("/readyz").status == 200, "not ready in the end")
        self.daemon.kill()
        db = kit.sqlite3.connect("file:%s?mode=ro" % self.daemon.database(), uri=True)
        found = db.execute("SELECT count(*) FROM jobs").fetchone()[0]
        db.close()
        kit.expect(found >= self.a.rows + self.accepted, "%d jobs were there and %d accepted, but after kill -9 there are %d", self.a.rows, self.accepted, found)
        print("after kill -9: %d rows, %d of them accepted here, each with its 201" % (found, self.accepted), flush=True)

    def run(self):
        try:
            print("on %d cores, load %.1f before; figures of a busy machine are rough" % (os.cpu_count(), os.getloadavg()[0]))
            self.prepare()
            for phase in (self.accepts, self.statuses, self.events, self.uploads, self.loris, self.count):
                if not self.a.only or phase.__name__ in self.a.only.split(","):
                    phase()
        finally:
            self.daemon.remove()
            if os.path.exists(self.ids):
                os.unlink(self.ids)
        print("%d targets missed" % self.missed)
        kit.expect(not (self.a.strict and self.missed), "%d targets missed", self.missed)


def main():
    Load(kit.parse(__doc__, [("rows", 5000, 1000000, "rows in the queue before"), ("seconds", 2, 20, "how long each load lasts"),
                             ("upload", 64 << 20, 1 << 30, "bytes of the upload that is timed"), ("flat", 128 << 20, 1 << 32, "bytes of the upload at flat memory"),
                             ("streams", 1000, 1000, "event streams"), ("loris", 400, 500, "slow connections"),
                             ("only", "", "", "phases, with commas: accepts statuses events uploads loris count"),
                             ("strict", 0, 0, "1: a missed target is a failure")])).run()


if __name__ == "__main__":
    kit.run(main)
