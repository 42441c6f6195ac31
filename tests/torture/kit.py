"""What the torture tests share: a daemon of their own, a client, jobs whose every result byte is known in advance, audits.

The daemon is driven through what anybody can see of it: its command line, HTTP, the data folder, exit codes, processes. Jobs are
scripts of blockwright-test-worker (tests/server/script_worker.c); `Job.expected` computes what they must come to without asking it.
"""
import argparse
import ctypes
import glob
import hashlib
import http.client
import json
import mmap
import os
import random
import resource
import shutil
import signal
import sqlite3
import struct
import subprocess
import sys
import tempfile
import time
import urllib.parse

FINAL = ("successful", "failed", "dismissed")
LIBC = ctypes.CDLL(None, use_errno=True)


class Finding(Exception):
    """The daemon broke a promise."""


class Gone(Exception):
    """No answer, or not a whole one: the daemon or its connection went away."""


def expect(condition, message, *arguments):
    if not condition:
        raise Finding(message % arguments if arguments else message)


# ---- the command line that all of them have ----

def parse(description, options):
    """options: (name, short value, full value, help). Every run is short unless --full; each value can be given on its own."""
    p = argparse.ArgumentParser(description=description)
    p.add_argument("--bin", required=True, help="folder of blockwrightd and blockwright-test-worker")
    p.add_argument("--full", action="store_true", help="the full form instead of the short one")
    p.add_argument("--seed", type=int, default=int(os.environ.get("BW_SEED", 0)) or random.SystemRandom().randrange(1, 1 << 31))
    p.add_argument("--daemon-option", action="append", default=[], metavar="OPTION", help="passed on to blockwrightd; may be repeated")
    p.add_argument("--folder", default=tempfile.gettempdir(), help="where data folders are made")
    for name, short, full, text in options:
        p.add_argument("--" + name, type=type(full), metavar=name[0].upper(), help="%s; %s, full form %s" % (text, short, full))
    a = p.parse_args()
    for name, short, full, _ in options:
        key = name.replace("-", "_")
        if getattr(a, key) is None:
            setattr(a, key, full if a.full else short)
    print("%s: seed %d%s" % (os.path.basename(sys.argv[0]), a.seed, ", full form" if a.full else ""), flush=True)
    return a


def run(main):
    """main() returns nothing; a Finding is printed and makes the exit code 1."""
    try:
        main()
    except Finding as finding:
        print("FOUND: %s" % finding, flush=True)
        sys.exit(1)


# ---- processes ----

def children(pid):
    try:
        with open("/proc/%d/task/%d/children" % (pid, pid)) as f:
            return [int(word) for word in f.read().split()]
    except OSError:
        return []


def command_line(pid):
    try:
        with open("/proc/%d/cmdline" % pid, "rb") as f:
            return f.read().decode(errors="replace").split("\0")
    except OSError:
        return []


def status_kib(pid, field):
    """A field of /proc/PID/status in KiB, 0 if the process is gone."""
    try:
        with open("/proc/%d/status" % pid) as f:
            for line in f:
                if line.startswith(field + ":"):
                    return int(line.split()[1])
    except OSError:
        pass
    return 0


def sanitized(program):
    """Whether it was built with the address sanitizer, which takes memory as it likes."""
    with open(program, "rb") as f:
        return b"__asan_init" in f.read()


def tree_bytes(path):
    """Bytes and number of the files below a folder; what vanishes meanwhile is not counted."""
    total = count = 0
    for folder, _, names in os.walk(path):
        for name in names:
            try:
                total += os.lstat(os.path.join(folder, name)).st_size
                count += 1
            except OSError:
                pass
    return total, count


class Daemon:
    def __init__(self, bin_folder, folder, options=(), worker="blockwright-test-worker"):
        self.program = os.path.join(bin_folder, "blockwrightd")
        self.worker = os.path.join(bin_folder, worker)
        self.data = tempfile.mkdtemp(prefix="bw-torture-", dir=folder)
        self.options = list(options)
        self.process = self.address = self.code = None
        self.starts = 0
        self.log_path = self.data + ".log"

    def spawn(self, environment=None, options=()):
        """Starts the process and does not wait for anything."""
        try:
            os.unlink(os.path.join(self.data, "address"))
        except OSError:
            pass
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)

        def prepare():
            LIBC.prctl(1, int(signal.SIGKILL), 0, 0, 0)  # PR_SET_PDEATHSIG: a test that dies leaves no daemon behind
            resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))

        with open(self.log_path, "ab") as log:
            self.log_start = log.tell()
            self.process = subprocess.Popen(
                [self.program, "--data", self.data, "--listen", "127.0.0.1:0", "--worker", self.worker, *self.options, *options],
                stdin=subprocess.DEVNULL, stdout=log, stderr=log, preexec_fn=prepare, env={**os.environ, **(environment or {})})
        self.starts += 1
        self.address = self.code = None

    def listening(self):
        try:
            with open(os.path.join(self.data, "address")) as f:
                line = f.read()
        except OSError:
            return False
        if line.endswith("\n"):
            self.address = line.strip()
        return self.address is not None

    def wait(self, seconds=60):
        """True when it listens, False when it has ended."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if self.listening():
                return True
            if self.ended():
                return False
            time.sleep(0.002)
        raise Finding("the daemon neither listens nor ends within %d s; %s" % (seconds, self.tail()))

    def start(self, environment=None, options=(), seconds=60):
        """Starts and waits until it listens. Returns the seconds that took."""
        before = time.monotonic()
        self.spawn(environment, options)
        if not self.wait(seconds):
            raise Finding("the daemon does not start, code %s; %s" % (self.code, self.tail()))
        return time.monotonic() - before

    def ended(self):
        if self.process and self.process.poll() is not None:
            self.code = self.process.returncode
            self.process = None
        return self.process is None

    def wait_end(self, seconds=60):
        try:
            self.code = self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            raise Finding("the daemon does not end within %d s; %s" % (seconds, self.tail())) from None
        self.process = None
        return self.code

    def kill(self, number=signal.SIGKILL):
        if self.process:
            self.process.send_signal(number)
            self.wait_end()

    def stop(self, seconds=60):
        self.process.send_signal(signal.SIGTERM)
        code = self.wait_end(seconds)
        expect(code == 0, "SIGTERM ends the daemon with code %s; %s", code, self.tail())

    def pid(self):
        return self.process.pid if self.process else 0

    def spawner(self):
        found = children(self.pid()) if self.process else []
        return found[0] if found else 0

    def workers(self):
        """[(pid, job, stage)] of the worker processes below the spawner, without what a worker starts itself (a leak checker)."""
        found, todo = [], children(self.spawner()) if self.spawner() else []
        while todo:
            pid = todo.pop()
            words = command_line(pid)
            if "--stage" in words and "--job" in words:
                found.append((pid, words[words.index("--job") + 1], words[words.index("--stage") + 1]))
            else:
                todo += children(pid)
        return found

    def log(self, all_starts=False):
        with open(self.log_path, errors="replace") as f:
            f.seek(0 if all_starts else self.log_start)
            return f.read()

    def tail(self, lines=12):
        """Of its end only: this is asked for before every expectation, and the log grows."""
        with open(self.log_path, errors="replace") as f:
            f.seek(max(0, os.path.getsize(self.log_path) - 65536))
            return "the log ends with\n  " + "\n  ".join(f.read().splitlines()[-lines:])

    def database(self):
        return os.path.join(self.data, "jobs.db")

    def remove(self):
        self.kill()
        if os.environ.get("BW_KEEP"):
            print("kept: %s" % self.data)
            return
        shutil.rmtree(self.data, ignore_errors=True)
        if os.path.exists(self.log_path):
            os.unlink(self.log_path)


# ---- faults ----

class Shim:
    """The preloaded library of shim.c: rules for one start of the daemon, and the file through which they are armed and counted."""

    SIZE = 16 + 2 * 16 * 8

    def __init__(self, bin_folder, folder, rules=""):
        self.file = tempfile.NamedTemporaryFile(prefix="bw-shim-", dir=folder)
        self.file.truncate(self.SIZE)
        self.map = mmap.mmap(self.file.fileno(), self.SIZE)
        self.environment = {"LD_PRELOAD": os.path.join(bin_folder, "torture_shim.so"), "BW_SHIM": rules, "BW_SHIM_CONTROL": self.file.name,
                            "ASAN_OPTIONS": os.environ.get("ASAN_OPTIONS", "") + ":verify_asan_link_order=0"}

    def arm(self, pid=0):
        self.map[0:8] = struct.pack("ii", 1, pid)

    def disarm(self):
        self.map[0:4] = struct.pack("i", 0)

    def move_clock(self, ms):
        self.map[8:16] = struct.pack("q", ms)

    def matched(self):
        return struct.unpack("16q", self.map[16:144])

    def fired(self):
        return struct.unpack("16q", self.map[144:272])

    def close(self):
        self.map.close()
        self.file.close()


# ---- requests ----

class Reply:
    def __init__(self, status, headers, body):
        self.status, self.headers, self.body = status, headers, body

    def json(self):
        return json.loads(self.body)

    def problem(self):
        try:
            return self.json().get("type", "").removeprefix("/problems/")
        except ValueError:
            return "no problem document"


class Client:
    """One connection that is kept alive and made anew when it has to be. `address` is asked for before each connection."""

    def __init__(self, daemon, timeout=60):
        self.daemon, self.timeout, self.connection, self.to = daemon, timeout, None, None

    def close(self):
        if self.connection:
            self.connection.close()
        self.connection = None

    def request(self, method, path, body=None, headers=None):
        address = self.daemon.address
        if not address:
            raise Gone("no address")
        if address != self.to:
            self.close()
        for fresh in (False, True):
            if not self.connection:
                host, port = address.rsplit(":", 1)
                self.connection, self.to, fresh = http.client.HTTPConnection(host, int(port), timeout=self.timeout), address, True
            try:
                self.connection.request(method, path, body, headers or {})
                reply = self.connection.getresponse()
                return Reply(reply.status, reply.headers, reply.read())
            except (OSError, http.client.HTTPException) as error:
                self.close()
                idle_closed = isinstance(error, (http.client.RemoteDisconnected, ConnectionResetError, BrokenPipeError))
                if fresh or not idle_closed or method not in ("GET", "HEAD"):
                    raise Gone(repr(error)) from None
        raise Gone("unreachable")

    def get(self, path):
        return self.request("GET", path)

    def post(self, path, document=None, headers=None):
        body = b"" if document is None else json.dumps(document).encode()
        return self.request("POST", path, body, {"Content-Type": "application/json", **(headers or {})})

    def upload(self, content):
        return self.request("PUT", "/v1/blobs/" + hashlib.sha256(content).hexdigest(), content)

    def job(self, identifier):
        reply = self.get("/v1/jobs/" + identifier)
        expect(reply.status == 200, "GET of the accepted job %s: %d %s", identifier, reply.status, reply.body[:300])
        return reply.json()

    def all_jobs(self):
        """Every job of the daemon, over all pages."""
        path, jobs = "/v1/jobs?limit=200", []
        while path:
            page = self.get(path).json()
            jobs += page["jobs"]
            path = "/v1/jobs?limit=200&cursor=" + page["next"] if "next" in page else None
        return jobs

    def wait_final(self, identifier, seconds=60):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            job = self.job(identifier)
            if job["state"] in FINAL:
                return job
            time.sleep(0.005)
        raise Finding("job %s is still %s after %d s: %s; %s"
                      % (identifier, job["state"], seconds, json.dumps(job), self.daemon.tail()))


class Interface:
    """What the daemon at hand offers, read from its own document."""

    def __init__(self, client):
        self.document = client.get("/openapi.json").json()
        self.stages = [stage["name"] for stage in self.document["x-blockwright-stages"]]
        submit = self.document["paths"]["/v1/jobs"]["post"]
        parameters = [self.resolve(p) for p in submit.get("parameters", [])]
        self.idempotency = any(p.get("name", "").lower() == "idempotency-key" for p in parameters)
        self.retry = "/v1/jobs/{id}/retry" in self.document["paths"]
        self.events = "/v1/jobs/{id}/events" in self.document["paths"]
        posts = self.resolve(self.document["paths"]["/v1/jobs"]["post"]["requestBody"])["content"]
        self.ways = ["whole"] + ["streamed"] * ("application/octet-stream" in posts) + ["parts"] * ("/v1/uploads" in self.document["paths"]) + ["batch"] * ("/v1/batches" in self.document["paths"])

    def resolve(self, node):
        for part in node.get("$ref", "#/").split("/")[1:]:
            node = self.document[part] if part in self.document else node.get(part, node)
        return node


# ---- jobs ----

MASK = (1 << 64) - 1


def pseudo_random(script, count):
    """The bytes of data.bin: a function of the script that encode reads."""
    x = 88172645463325252
    for byte in script:
        x = ((x ^ byte) * 1099511628211) & MASK
    out = bytearray(count)
    for i in range(count):
        x ^= (x << 13) & MASK
        x ^= x >> 7
        x ^= (x << 17) & MASK
        out[i] = x & 0xff
    return bytes(out)


class Job:
    """A script, what it must come to, and what the daemon has said of it so far."""

    def __init__(self, script, ends="successful", problem=None, until=None, action=None):
        self.script = script.encode()
        self.sha256 = hashlib.sha256(self.script).hexdigest()
        self.ends, self.problem, self.until, self.action = ends, problem, until, action
        self.id = self.seen = None
        self.upload, self.offset, self.twin = None, 0, None  # of a resumable upload; the other job of a batch
        self.dismissed = False  # its cancel was answered with 200

    def document(self):
        return {"input": self.sha256, "options": {"until": self.until} if self.until else {}}

    def expected(self, stages, cut=False):
        """The result files by name. `cut`: reduce was told to finish and says so in what it passes on."""
        text, size = self.script, 1000
        for stage in stages[:-1]:
            text += b"# %s\n" % stage.encode() + (b"# cut\n" if cut and stage == "reduce" else b"")
        for line in self.script.decode().split("\n"):
            words = line.split(" ", 2)
            if len(words) == 3 and words[0] in ("*", stages[-1]) and words[1] == "bytes":
                size = int(words[2])
        return {"script.txt": text, "data.bin": pseudo_random(text, size),
                "report.json": b'{"script_bytes": %d, "data_bytes": %d}\n' % (len(text), size)}

    def check_final(self, state, stages):
        """`state`: the daemon's document of this job, in a final state. Its history and its end are as they have to be."""
        name = "job %s (%s)" % (self.id, self.script.decode().replace("\n", "; ")[:80])
        last, done = 0, []
        for attempt in state["attempts"]:
            expect(attempt["attempt"] > last, "%s: attempts do not grow: %s", name, state["attempts"])
            last = attempt["attempt"]
            expect("outcome" in attempt, "%s has ended, but its attempt %d has not", name, last)
            if attempt["outcome"] == "ok":
                done.append(attempt["stage"])
        expect(done == stages[:len(done)], "%s: stages that ended well are %s", name, done)
        expect(state["state"] in self.ends.split("|"), "%s is %s instead of %s: %s", name, state["state"], self.ends, json.dumps(state))
        if self.dismissed:
            expect(state["state"] == "dismissed", "%s was cancelled with 200, but is %s", name, state["state"])
        if state["state"] == "failed":
            problem = state["failure"]["type"].removeprefix("/problems/")
            expect(problem == self.problem, "%s failed with %s instead of %s: %s", name, problem, self.problem, json.dumps(state["failure"]))
        if state["state"] == "successful":
            wanted = stages[:stages.index(self.until) + 1] if self.until else stages
            expect(done == wanted, "%s is successful after the stages %s", name, done)
        fixed = (state["state"], state.get("finished"), len(state["attempts"]))
        expect(self.seen in (None, fixed), "%s ended twice: %s, then %s", name, self.seen, fixed)
        self.seen = fixed

    def check_results(self, client, stages):
        """Every byte that is served of a successful job. Returns their number. Gone: not all could be had."""
        reply = client.get("/v1/jobs/%s/results" % self.id)
        expect(reply.status == 200 or reply.status >= 500, "results of the successful job %s: %d %s", self.id, reply.status, reply.body)
        if reply.status != 200:
            raise Gone("results: %d" % reply.status)
        listed, total = {r["name"]: r for r in reply.json()["results"]}, 0
        if self.until and self.until != stages[-1]:
            expect(not listed, "job %s has results although it stopped before", self.id)
            return 0
        for name, item in listed.items():
            reply = client.get(item["href"])
            if reply.status >= 500:
                raise Gone("%s: %d" % (name, reply.status))
            expect(reply.status == 200, "%s of job %s: %d %s", name, self.id, reply.status, reply.body[:300])
            variants = [self.expected(stages).get(name)]
            if self.action == "finish":
                variants.append(self.expected(stages, True).get(name))
            if name == "report.json":  # the daemon may add to it, but not change what the worker has written
                ours = [json.loads(v) for v in variants]
                got = json.loads(reply.body)
                good = any(all(got.get(k) == v for k, v in o.items()) for o in ours)
            else:
                good = reply.body in variants
            expect(good, "job %s: wrong bytes of %s (%d of them)", self.id, name, len(reply.body))
            expect(hashlib.sha256(reply.body).hexdigest() == item["sha256"], "job %s: %s is not what its manifest says", self.id, name)
            total += len(reply.body)
        expect(set(listed) >= {"script.txt", "data.bin", "report.json"}, "job %s: results are %s", self.id, sorted(listed))
        return total


REFUSED = (429, 423)  # passing reasons, as are all of 500 and above


def passing(reply, what, *good):
    """Whether the daemon said no for a passing reason; any other answer but those in `good` is a finding."""
    if reply.status >= 500 or reply.status in REFUSED:
        return True
    expect(reply.status in good, "%s: %d %s", what, reply.status, reply.body[:300])
    return False


def upload_in_parts(client, job):
    """Two parts over the resumable protocol, going on where the daemon is; False for a passing reason. What it has said to be on
    stable storage stays there."""
    tus, size = {"Tus-Resumable": "1.0.0"}, len(job.script)
    if not job.upload:
        reply = client.request("POST", "/v1/uploads", b"", {**tus, "Upload-Length": str(size)})
        if passing(reply, "begin of an upload", 201):
            return False
        job.upload, job.offset = reply.headers["Location"].split("://")[-1], 0
        job.upload = job.upload[job.upload.index("/v1/"):]
    while True:
        reply = client.request("HEAD", job.upload, None, tus)
        if passing(reply, "HEAD of the upload %s" % job.upload, 200):
            return False
        at = int(reply.headers["Upload-Offset"])
        expect(at >= job.offset, "%d bytes of the upload %s were on stable storage, now %d are", job.offset, job.upload, at)
        if reply.headers.get("Blockwright-Blob"):
            expect(reply.headers["Blockwright-Blob"] == job.sha256, "the upload became the blob %s", reply.headers["Blockwright-Blob"])
            return True
        part = job.script[at:at + size // 2 + 1]
        reply = client.request("PATCH", job.upload, part, {**tus, "Upload-Offset": str(at), "Content-Type": "application/offset+octet-stream"})
        if passing(reply, "PATCH of the upload %s" % job.upload, 204):
            return False
        job.offset = int(reply.headers["Upload-Offset"])
        expect(job.offset == at + len(part), "a PATCH of %d bytes at %d ends at %d", len(part), at, job.offset)


def submit(client, job, key=None, how="whole"):
    """Uploads and creates; True if the job was accepted, False if the daemon said no for a passing reason. how: "whole", "parts"
    (resumable upload), "streamed" (in one request), or "batch" (created together with job.twin)."""
    headers = {"Idempotency-Key": key} if key else None
    if how == "streamed":
        pass
    elif how == "parts":
        if not upload_in_parts(client, job):
            return False
    elif passing(client.upload(job.script), "upload", 200, 201):
        return False
    if how == "streamed":
        query = "?" + urllib.parse.urlencode(job.document()["options"])
        reply = client.request("POST", "/v1/jobs" + query, job.script, {**(headers or {}), "Content-Type": "application/octet-stream"})
    elif how == "batch":
        reply = client.post("/v1/batches", {"jobs": [job.document(), job.twin.document()]}, headers)
    else:
        reply = client.post("/v1/jobs", job.document(), headers)
    if passing(reply, "submission", 200, 201):
        return False
    answer = reply.json()
    if how == "batch":
        job.id, job.twin.id = (one["id"] for one in answer["jobs"])
    else:
        job.id = answer["id"]
    return True


# ---- what has to be true of a data folder when the daemon has stopped ----

def audit(daemon):
    """No temporaries, blobs that are what their names say, a sound database with nothing open. Returns a line of figures."""
    data = daemon.data
    for folder in ("tmp", "work"):
        left = [os.path.join(f, n) for f, d, names in os.walk(os.path.join(data, folder)) for n in names + d]
        expect(not left, "left in %s: %s", folder, left[:5])
    strays = glob.glob(data + "/**/*.new", recursive=True)
    expect(not strays, "temporaries left: %s", strays[:5])
    blobs = glob.glob(data + "/blobs/??/*")
    for path in blobs:
        with open(path, "rb") as f:
            expect(hashlib.sha256(f.read()).hexdigest() == os.path.basename(path), "the blob %s is corrupt", path)
    wal = daemon.database() + "-wal"
    expect(not os.path.exists(wal) or os.path.getsize(wal) == 0, "the daemon has stopped in order and left a WAL of %d bytes",
           os.path.getsize(wal) if os.path.exists(wal) else 0)
    db = sqlite3.connect("file:%s?mode=ro" % daemon.database(), uri=True)
    sound = db.execute("PRAGMA integrity_check").fetchone()[0]
    expect(sound == "ok", "the database is damaged: %s", sound)
    db.close()
    cache = glob.glob(data + "/cache/??/*")
    return "%d blobs, %d cache entries, database %.1f MB" % (len(blobs), len(cache), os.path.getsize(daemon.database()) / 1e6)
