"""Hostile clients and files against a daemon with the real worker in its sandbox, and tokens of two owners.

(a) Files: the fuzzers' corpus and damaged examples of every format (hostile_files.py) are uploaded and submitted as jobs. Each ends
typed: successful, or failed as input, limit or algorithm; never as system, never by a dead worker or one that broke out of its sandbox.
(b) HTTP (wire.py): bodies that unpack to gigabytes, deep and huge JSON, paths and names meant for a file system or a terminal, headers
without end, requests that two servers would part differently. Whatever comes back is a typed answer, or the connection is closed.
(c) Afterwards: the same process runs; nothing beside its data folder was made or changed; nothing temporary is left; neither owner
reads what is the other's; memory is bounded; no byte in any log could be taken for a line or a terminal's command by who reads it.
"""
import glob
import hashlib
import json
import os
import random
import re
import shutil
import subprocess
import tempfile
import time
import urllib.parse
from base64 import b64encode

import hostile_files
import kit
import wire

OWNERS = ("anna", "bert")
MARK = "mark-of-the-secret-file"
NAMES = ("../../etc/passwd", "..", ".", "/etc/passwd", "%2e%2e%2f%2e%2e%2fetc%2fpasswd", "..%2f..%2fjobs.db", "..%5c..%5c", "%00", "a%00b", "%0d%0aX: y",
         "%ff%fe", "%c0%ae%c0%ae%c0%af", "%", "%2", "%zz", "%252e%252e%252f", "a" * 5000, "a" * 60000, "0" * 64, "f" * 24, "F" * 24, "-1", "..;/", "*",
         "~", "$(id)", "`id`", "' OR 1=1 --", "%1b[31m", "con", "report.json%00.txt", "....//", "\\..\\..", "%e2%80%ae", "%f0%9f%92%a9")
TEXTS = ("../../../etc/passwd", "/etc/passwd", "a\0b", "\r\nlevel=error event=forged", "\x1b]0;owned\x07", "\u202e\u2028\u0085\u009b31m", "\ufeff", "x" * 200,
         "x" * 201, "x" * 100000, "'; DROP TABLE jobs; --", "%n%s%n%s", "<script>", '"\\', "\x7f\x01", "\U0010ffff" * 50, "")


class Client(kit.Client):
    def __init__(self, daemon, token):
        super().__init__(daemon)
        self.token = token

    def request(self, method, path, body=None, headers=None):
        return super().request(method, path, body, {"Authorization": "Bearer " + self.token, **(headers or {})})


def listing(folder, leave_out):
    """What is below a folder: kind, size, time and place of everything."""
    found = {}
    for base, folders, names in os.walk(folder):
        folders[:] = [n for n in folders if os.path.join(base, n) not in leave_out]
        for name in names + folders:
            path = os.path.join(base, name)
            if path not in leave_out:
                s = os.lstat(path)
                found[path] = (s.st_mode, s.st_size if name in names else 0, s.st_mtime_ns, s.st_ino)
    return found


class Hostile:
    def __init__(self, arguments):
        self.a, self.rng = arguments, random.Random(arguments.seed)
        self.folder = tempfile.mkdtemp(prefix="bw-hostile-", dir=arguments.folder)
        for name in ("cwd", "home", "tmp", "elsewhere"):
            os.mkdir(os.path.join(self.folder, name))
        self.secret = os.path.join(self.folder, "elsewhere", "secret")
        with open(self.secret, "w") as f:
            f.write(MARK * 100)
        os.chdir(os.path.join(self.folder, "cwd"))
        self.daemon = kit.Daemon(arguments.bin, self.folder, ["--workers", "2", "--max-upload", "64M", "--header-timeout", "3s", "--stage-output", "64M", "--stage-scratch", "128M",
                                                              *arguments.daemon_option], worker="blockwright-worker")
        self.sanitized = kit.sanitized(self.daemon.program)
        self.pids, self.jobs, self.problems = set(), {owner: [] for owner in OWNERS}, {}
        self.uploaded = {owner: set() for owner in OWNERS}
        self.shared = {f: set(os.listdir(f)) for f in ("/tmp", "/var/tmp", "/dev/shm") if os.path.isdir(f)}

    def start(self):
        tokens = {}
        for owner in OWNERS:
            made = subprocess.run([self.daemon.program, "token", "create", "--data", self.daemon.data, "--owner", owner], capture_output=True, check=True)
            tokens[owner] = made.stdout.decode().strip()
        self.tokens = tokens
        place = lambda name: os.path.join(self.folder, name)
        self.daemon.start({"TMPDIR": place("tmp"), "HOME": place("home")})
        self.pid, self.spawner = self.daemon.pid(), self.daemon.spawner()
        self.clients = {owner: Client(self.daemon, tokens[owner]) for owner in OWNERS}
        self.document = self.clients[OWNERS[0]].get("/openapi.json").json()
        codes = {p["code"]: p["status"] for p in self.document["x-blockwright-problems"]}
        self.wire = wire.Wire(self.daemon, tokens[OWNERS[0]], codes)
        self.before = listing(self.folder, {self.daemon.data, self.daemon.log_path})

    def alive(self, after):
        kit.expect(not self.daemon.ended(), "after %s the daemon has ended with code %s; %s", after, self.daemon.code, self.daemon.tail())
        kit.expect(self.daemon.pid() == self.pid and self.daemon.spawner() == self.spawner, "after %s daemon or spawner are others than before", after)
        reply = self.clients[OWNERS[0]].get("/readyz")
        kit.expect(reply.status == 200, "after %s /readyz says %d %s", after, reply.status, reply.body[:500])

    # ---- (a) files ----

    def submit(self, owner, files):
        """Uploads them and submits all as one batch. [(file, job)]"""
        client, wanted = self.clients[owner], []
        for f in files:
            for content in filter(lambda c: c is not None, (f.content, f.parameters)):
                reply = client.upload(content)
                self.uploaded[owner].add(hashlib.sha256(content).hexdigest())
                kit.expect(reply.status in (200, 201), "upload of %s: %d %s", f.name, reply.status, reply.body[:300])
            job = {"input": hashlib.sha256(f.content).hexdigest(), "name": f.name, "options": f.options,
                   "limits": {"cpu_seconds": 20, "wall_seconds": 120, **({} if self.sanitized else {"memory": 512 << 20})}}
            if f.parameters is not None:
                job["parameters"] = hashlib.sha256(f.parameters).hexdigest()
            wanted.append(job)
        reply = client.post("/v1/batches", {"jobs": wanted})
        kit.expect(reply.status == 201, "batch: %d %s", reply.status, reply.body[:300])
        return [(f, one["id"]) for f, one in zip(files, reply.json()["jobs"])]

    def finished(self, owner, identifier, seconds=300):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            job = self.clients[owner].job(identifier)
            self.pids.update(pid for pid, _, _ in self.daemon.workers())
            if job["state"] in kit.FINAL:
                return job
            time.sleep(0.02)
        raise kit.Finding("job %s does not end within %d s: %s; %s" % (identifier, seconds, json.dumps(job), self.daemon.tail()))

    def judge_job(self, f, job):
        of = "%s (input %s)" % (f.name, job["input"])
        code = "successful"
        if job["state"] != "successful":
            kit.expect(job["state"] == "failed", "%s ends as %s", of, job["state"])
            failure = job["failure"]
            code = failure["type"].removeprefix("/problems/")
            kit.expect(failure["class"] in ("input", "limit", "algorithm") and code != "sandbox-violation", "%s fails with %s", of, json.dumps(failure))
        for attempt in job["attempts"]:
            kit.expect(attempt["outcome"] in ("ok", code), "%s: an attempt ends with %s: %s", of, attempt["outcome"], json.dumps(job["attempts"]))
        self.problems[code] = self.problems.get(code, 0) + 1

    def files(self):
        meshes = hostile_files.corpus(hostile_files.MESHES)
        others = hostile_files.corpus(hostile_files.OTHERS)
        total = len(meshes)
        if not self.a.full:
            meshes = self.rng.sample(meshes, min(self.a.corpus, len(meshes)))
            others = self.rng.sample(others, 30)
        everything = meshes + others + hostile_files.handmade() + hostile_files.mutations(self.rng, self.a.mutations)
        everything.append(hostile_files.File("example cube", hostile_files.read(os.path.join(hostile_files.ROOT, "api/examples/formats/cube.vtk"))))
        before, step = time.monotonic(), 50
        for at in range(0, len(everything), step):
            owner = OWNERS[at // step % 2]
            for f, identifier in self.submit(owner, everything[at:at + step]):
                job = self.finished(owner, identifier)
                self.judge_job(f, job)
                self.jobs[owner].append(job)
            self.alive("the files " + everything[at].name)
        for owner in OWNERS:  # so that each has one with results
            [(f, identifier)] = self.submit(owner, everything[-1:])
            job = self.finished(owner, identifier)
            kit.expect(job["state"] == "successful", "the sound example fails: %s", json.dumps(job))
            self.jobs[owner].append(job)
        print("%d files (%d of the corpus' %d meshes) in %.0f s: %s" % (len(everything), len(meshes), total, time.monotonic() - before, ", ".join(
            "%s %d" % one for one in sorted(self.problems.items(), key=lambda one: -one[1]))), flush=True)

    # ---- (b) HTTP ----

    def bombs(self):
        """Content of gigabytes in bodies of kilobytes, at each place that takes a coded body."""
        size = self.a.bomb << 20
        bombs = [("gzip", wire.gzip_bomb(size)), ("gzip", wire.gzip_members(100000)), ("zstd", wire.zstd_bomb(size)), ("zstd", wire.zstd_bomb(size, 0xf8)),
                 ("zstd", wire.zstd_bomb(0, 0x38) * 10000), ("zstd", b"\x50\x2a\x4d\x18\xff\xff\xff\xff"), ("gzip", b"\x1f\x8b\x08\x1e" + b"a" * 100000),
                 ("gzip, gzip", wire.gzip_bomb(1 << 20)), ("zstd,gzip,zstd", b"x"), ("deflate", b"x"), ("gzip", b""), ("zstd", b"\x28\xb5\x2f\xfd")]
        content = hashlib.sha256()
        for _ in range(self.a.bomb):
            content.update(bytes(1 << 20))
        content = content.hexdigest()
        for coding, body in bombs:
            coded = "Content-Encoding: " + coding
            for target in ("/v1/blobs/" + "0" * 64, "/v1/blobs/" + content):
                self.refused(self.wire.request("PUT", target, [coded], body), "PUT", coding)
            for target in ("/v1/jobs", "/v1/batches"):
                self.refused(self.wire.request("POST", target, [coded, "Content-Type: application/json"], body), target, coding)
            tus = ["Tus-Resumable: 1.0.0", "Content-Type: application/offset+octet-stream"]
            made = self.wire.request("POST", "/v1/uploads", [tus[0], "Upload-Length: %d" % (1 << 20)])
            kit.expect(made is not None and made.status == 201, "creating an upload: %s", made)
            where = made.headers[b"location"].decode()
            where = where[where.index("/v1/"):]
            self.wire.request("PATCH", where, [*tus, "Upload-Offset: 0", coded], body)
            self.wire.request("DELETE", where, tus[:1])

    def refused(self, answer, what, of):
        kit.expect(answer is None or answer.status >= 400, "%s with a hostile body (%s) is answered with %s", what, of, answer)

    def documents(self):
        """JSON that is deep, huge, or no text."""
        sha, many = "0" * 64, "[" + ",".join(["{}"] * 100000) + "]"
        bodies = ["[" * 100000, "[" * 100000 + "]" * 100000, '{"a":' * 100000, '{"input":' * 5000 + "1" + "}" * 5000, "[" * 2000 + "]" * 2000,
                  '{"input":%s}' % ("9" * 60000), '{"input":1e999999}', '{"priority":%s,"input":"%s"}' % ("9" * 400, sha), '{"priority":-1e308,"input":"%s"}' % sha,
                  '{"limits":{"memory":1e400},"input":"%s"}' % sha, '{"limits":{"memory":18446744073709551616},"input":"%s"}' % sha, many, '{"jobs":%s}' % many,
                  '{"jobs":[%s]}' % ",".join(['{"input":"%s"}' % sha] * 1001), '{"jobs":[%s]}' % ",".join(["[]"] * 1000), '{"jobs":{}}', '{"jobs":[]}', '{"jobs":null}',
                  '{"tags":%s,"input":"%s"}' % (many, sha), '{"options":{"%s":1},"input":"%s"}' % ("x" * 50000, sha), '{"input":"%s","input":"%s"}' % (sha, sha),
                  '"' + "\\u0000" * 5000 + '"', '"\\ud800"', "nul", "", " " * 60000, "\0" * 60000, "{" + '"a":1,' * 5000 + '"b":2}', '{"input":"%s"}\0{}' % sha,
                  '{"seed":1,"input":"%s"}' % ("0" * 63 + "\\u0000"), "\ufeff{}", "[1" + ",1" * 400000 + "]"]
        raw = [b.encode() for b in bodies] + [b'{"name":"\xff\xfe","input":"%s"}' % sha.encode(), b'{"input":"\xc0\xae"}', b"\x80" * 1000, os.urandom(10000),
                                              b'{"name":"\xed\xa0\x80"}']
        for body in raw:
            for target in ("/v1/jobs", "/v1/batches"):
                self.refused(self.wire.request("POST", target, ["Content-Type: application/json"], body), target, body[:60])

    def paths(self):
        """Every parameter of every path, and what is no path of ours."""
        for path, item in self.document["paths"].items():
            for method in ("GET", "HEAD", "PUT", "POST", "PATCH", "DELETE", "OPTIONS"):
                if "{" not in path or (not self.a.full and method.lower() not in item):
                    continue
                for value in self.rng.sample(NAMES, len(NAMES) if self.a.full else 12):
                    target = re.sub(r"\{\w+\}", lambda _: value, path, count=1)
                    target = target.replace("{name}", self.rng.choice(NAMES)).replace("{id}", "f" * 24)
                    answer = self.wire.request(method, target, ["Tus-Resumable: 1.0.0", "Upload-Offset: 0"])
                    self.refused(answer, "%s %s" % (method, target[:200]), "path") if method != "OPTIONS" else None
                    kit.expect(answer is None or MARK.encode() not in answer.body, "%s reads files", target[:200])
        own = next(job["id"] for job in reversed(self.jobs[OWNERS[0]]) if job["state"] == "successful")
        there = os.path.relpath(self.secret, self.daemon.data)
        for name in (*NAMES, there, "/" + there, urllib.parse.quote(there, safe=""), "../" * 12 + self.secret, "..%2f" * 12 + self.secret[1:], self.secret,
                     urllib.parse.quote(self.secret, safe="")):
            for target in ("/v1/jobs/%s/results/%s" % (own, name), "/page/" + name, "/" + name, "//" + name, "/v1/blobs/" + name, "/v1/jobs/%s/%s" % (own, name)):
                answer = self.wire.request("GET", target)
                kit.expect(answer is None or (MARK.encode() not in answer.body and b"root:" not in answer.body), "GET %s reads a file: %s", target[:200], answer)
        for query in ("limit=%s" % ("9" * 500), "limit=-1", "limit=1e9", "cursor=" + "A" * 50000, "cursor=%00%ff", "tag=%00", "tag=../..", "owner=..%2f..", "owner=%ff",
                      "state=%0a", "&" * 50000, "a=b&" * 10000, "limit=1&limit=2", "=", "tail=99999999999999999999", "after=-9223372036854775809", "%00=%00"):
            for target in ("/v1/jobs", "/v1/jobs/%s/log" % own, "/v1/jobs/%s/results" % own):
                self.wire.request("GET", target + "?" + query)

    def fields(self):
        """Names, tags, keys, metadata, hosts, tokens and owners that somebody might print or open."""
        job = self.jobs[OWNERS[0]][-1]
        for text in TEXTS:
            raw = text.encode()
            for document in ({"name": text}, {"tags": [text]}, {"tags": [text] * 20}, {"options": {text: 1}}, {"options": {"until": text}}, {text: 1}, {"parameters": text}):
                answer = self.wire.request("POST", "/v1/jobs", ["Content-Type: application/json"], json.dumps({"input": job["input"], **document}).encode())
                if answer is not None and answer.status == 201:
                    made = json.loads(answer.body)
                    for key in {"name", "tags"} & document.keys():
                        kit.expect(made.get(key, "") == document[key], "%s %r came back as %r", key, document[key], made.get(key))
                    self.jobs[OWNERS[0]].append(self.finished(OWNERS[0], made["id"]))
            line = raw.replace(b"\r\n", b" ").replace(b"\0", b"?")[:50000]
            for name in (b"Idempotency-Key", b"Authorization", b"X-Forwarded-For", b"Host", b"Origin", b"Accept-Encoding", b"Range", b"If-None-Match", b"If-Modified-Since",
                         b"Last-Event-ID", b"Prefer", b"Upload-Metadata", b"Upload-Length", b"Upload-Checksum", b"Content-Type", b"Expect", b"User-Agent", b"Tus-Resumable"):
                for method, target in (("GET", "/v1/jobs/" + job["id"]), ("POST", "/v1/uploads"), ("POST", "/v1/jobs")):
                    if self.a.full or self.rng.random() < 0.12:
                        self.wire.request(method, target, [name + b": " + line])
            metadata = "Upload-Metadata: filename %s,%s x" % (b64encode(raw).decode()[:50000], "y" * 1000)
            answer = self.wire.request("POST", "/v1/uploads", ["Tus-Resumable: 1.0.0", "Upload-Length: 1", metadata])
            if answer is not None and answer.status == 201:
                where = answer.headers[b"location"].decode()
                self.wire.request("DELETE", where[where.index("/v1/"):], ["Tus-Resumable: 1.0.0"])
            if "\0" not in text:
                made = subprocess.run([self.daemon.program, "token", "create", "--data", self.daemon.data, "--owner", text], capture_output=True)
                kit.expect(made.returncode in (0, 1, 2), "token create --owner %r ends with %d", text[:100], made.returncode)
        for length in ("-1", "99999999999999999999999", "0x10", "1e3", "", "9223372036854775807", "18446744073709551615"):
            self.refused(self.wire.request("POST", "/v1/uploads", ["Tus-Resumable: 1.0.0", "Upload-Length: " + length]), "Upload-Length", length)

    def floods(self):
        """Headers without end: many, long, nameless."""
        head = b"GET /livez HTTP/1.1\r\nHost: localhost\r\n"
        for flood in (b"X: y\r\n" * 100000, b"X: " + b"y" * (4 << 20) + b"\r\n", b"x" * (1 << 20) + b": y\r\n", b": y\r\n" * 1000, b"X\r\n" * 1000, b"Cookie: " + b"a=b;" * 20000 + b"\r\n",
                      b"Range: bytes=" + b"0-1," * 10000 + b"\r\n", b"Accept-Encoding: " + b"gzip;q=0.1," * 9000 + b"\r\n", b"If-None-Match: " + b'"a",' * 20000 + b"\r\n",
                      b"X-Forwarded-For: " + b"1.2.3.4," * 10000 + b"\r\n", b"Host: localhost\r\n" * 1000, b"Authorization: Bearer x\r\n" * 1000):
            self.wire.raw(head + flood + b"\r\n")
        self.wire.raw(b"GET /" + b"a" * (1 << 20) + b" HTTP/1.1\r\nHost: localhost\r\n\r\n")
        self.wire.raw(b"A" * (1 << 20))
        self.wire.raw(b"\r\n" * 100000)

    def smuggled(self):
        """Requests that two readers would part differently. `inner` must never be answered where the outer one is ambiguous."""
        inner = b"DELETE /v1/jobs/%s HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer %s\r\n\r\n" % (
            self.jobs[OWNERS[0]][0]["id"].encode(), self.tokens[OWNERS[0]].encode())
        body = b'{"input":"x"}'
        def post(headers, rest):
            return (b"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer %s\r\nContent-Type: application/json\r\n" % self.tokens[OWNERS[0]].encode()
                    + headers + b"\r\n" + rest)
        size, chunked = b"Content-Length: %d\r\n" % len(body), b"Transfer-Encoding: chunked\r\n"
        chunk = b"%x\r\n%s\r\n0\r\n\r\n" % (len(body), body)
        ambiguous = {
            "length and chunked": post(size + chunked, b"0\r\n\r\n" + inner), "chunked and length": post(chunked + size, b"0\r\n\r\n" + inner),
            "two lengths": post(size + b"Content-Length: 0\r\n", body + inner), "two lengths in one": post(b"Content-Length: 13, 0\r\n", body + inner),
            "no length": post(b"Content-Length: \r\n", inner), "length +": post(b"Content-Length: +13\r\n", body + inner), "length -": post(b"Content-Length: -1\r\n", inner),
            "length hex": post(b"Content-Length: 0xd\r\n", body + inner), "length huge": post(b"Content-Length: 18446744073709551629\r\n", body + inner),
            "length and words": post(b"Content-Length: 13 13\r\n", body + inner), "length folded": post(b"Content-Length:\r\n 13\r\n", body + inner),
            "chunked twice": post(b"Transfer-Encoding: chunked, chunked\r\n", chunk + inner), "chunked, identity": post(b"Transfer-Encoding: chunked, identity\r\n", chunk + inner),
            "xchunked": post(b"Transfer-Encoding: xchunked\r\n" + size, body + inner), "chunked, tab": post(b"Transfer-Encoding:\x0bchunked\r\n" + size, body + inner),
            "gzip, chunked": post(b"Transfer-Encoding: gzip, chunked\r\n", chunk + inner), "identity": post(b"Transfer-Encoding: identity\r\n" + size, body + inner),
            "blank before colon": post(b"Content-Length : 13\r\n", body + inner), "blank before colon, coded": post(b"Transfer-Encoding : chunked\r\n" + size, chunk + inner),
            "blank before name": post(b" Transfer-Encoding: chunked\r\n" + size, chunk + inner), "obs-fold, coded": post(b"Transfer-Encoding:\r\n chunked\r\n", chunk + inner), "obs-fold in length": post(b"Content-Length: 1\r\n 3\r\n", body + inner),
            "obs-fold to length": post(b"Content: 13\r\n -Length\r\n", body + inner), "obs-fold": post(b"X: y\r\n Transfer-Encoding: chunked\r\n" + size, chunk + inner),
            "NUL in name": post(b"Content-\0Length: 13\r\n", inner), "NUL in value": post(b"X: a\0b\r\n" + size, body + inner), "bare CR": post(b"X: a\rContent-Length: 0\r\n" + size, body + inner),
            "chunk, bad size": post(chunked, b"zz\r\n" + inner), "chunk, huge size": post(chunked, b"fffffffffffffffff\r\n" + inner), "chunk, minus": post(chunked, b"-1\r\n" + inner),
            "chunk, 0x": post(chunked, b"0xd\r\n" + body + b"\r\n0\r\n\r\n" + inner), "chunk, no end": post(chunked, b"d\r\n" + body + inner),
            "chunk, blank": post(chunked, b" d\r\n" + body + b"\r\n0\r\n\r\n" + inner), "chunk, long extension": post(chunked, b"d;" + b"x" * 200000 + b"\r\n" + body + b"\r\n0\r\n\r\n" + inner),
            "chunk, long size": post(chunked, b"0" * 200000 + b"d\r\n" + body + b"\r\n0\r\n\r\n" + inner), "1.0 and chunked": post(chunked, chunk + inner).replace(b"HTTP/1.1", b"HTTP/1.0", 1),
        }
        found = {}
        for name, data in ambiguous.items():
            count = len(self.wire.raw(data, ["POST", "DELETE"]))
            if count > 1 and name not in ("NUL in value",):  # of which the library tells nothing; the value ends there
                found[name] = count
        print("  ambiguous requests behind which another was answered: %s" % (", ".join(sorted(found)) or "none"), flush=True)
        get = b"GET /livez HTTP/1.1\r\nHost: localhost\r\n"
        for data in (b"GET /livez\r\n\r\n", b"GET /livez HTTP/0.9\r\n\r\n", b"GET /livez HTTP/9.9\r\n\r\n", b"GET /livez HTTP/1.1\r\n\r\n", b"GET  /livez HTTP/1.1\r\n\r\n",
                     b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes(100), b"GET /livez HTTP/1.1\nHost: localhost\n\n", b"\0" * 1000, b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(200),
                     b"CONNECT localhost:1 HTTP/1.1\r\nHost: localhost\r\n\r\n", b"TRACE / HTTP/1.1\r\nHost: localhost\r\n\r\n", b"GET http://elsewhere/livez HTTP/1.1\r\nHost: x\r\n\r\n",
                     b"OPTIONS * HTTP/1.1\r\nHost: localhost\r\n\r\n", b"get /livez HTTP/1.1\r\nHost: localhost\r\n\r\n", b"G\xff\x00T / HTTP/1.1\r\n\r\n", b"GET \xff\xfe HTTP/1.1\r\nHost: x\r\n\r\n",
                     get + b"Host: other\r\n\r\n", get + b"Upgrade: h2c\r\nConnection: Upgrade, HTTP2-Settings\r\nHTTP2-Settings: AAMAAABkAAQ\r\n\r\n", get + b"Connection: " + b"x," * 10000 + b"\r\n\r\n",
                     get + b"Expect: 200-maybe\r\n\r\n", (get + b"\r\n") * 50 + os.urandom(5000), (get + b"\r\n") * 200, get + b"\r\n" + b"GARBAGE\r\n\r\n" * 20,
                     post(chunked, b"d;a=b;c=\"d\"\r\n" + body + b"\r\n0;x\r\nTrailer: y\r\nContent-Length: 5\r\n\r\n"), post(size, body[:5]), post(b"Expect: 100-continue\r\n" + size, b"")):
            self.wire.raw(data)
        for i in range(self.a.noise):
            data = bytearray(self.rng.choice(list(ambiguous.values())))
            for _ in range(self.rng.randrange(1, 10)):
                data[self.rng.randrange(min(len(data), 400))] = self.rng.choice(b"\0\r\n :;,\xff\x80A0\t")
            self.wire.raw(bytes(data))
        kit.expect(not found, "requests within ambiguous requests are answered: %s", found)

    # ---- (c) afterwards ----

    def foreign(self):
        """What is one owner's is not there for the other, whichever way it is asked for. daemon_access.c has every operation; this, more jobs."""
        tried = 0
        for one, other in (OWNERS, OWNERS[::-1]):
            own = next(job["id"] for job in reversed(self.jobs[other]) if job["state"] == "successful")
            successful = [job for job in self.jobs[one] if job["state"] == "successful"]
            for job in self.rng.sample(self.jobs[one], min(20, len(self.jobs[one]))) + successful[-5:]:
                path, token = "/v1/jobs/" + job["id"], self.tokens[other]
                for rest in ("", "/results", "/results/report.json", "/results/mesh.vtk", "/report", "/log", "/events", "/../" + job["id"], "/./results"):
                    answer = self.wire.request("GET", path + rest, token=token)
                    kit.expect(answer is not None and answer.status == 404, "GET %s of %s is answered to %s: %s", path + rest, one, other, answer)
                for method, rest in (("POST", "/cancel"), ("POST", "/finish"), ("POST", "/retry"), ("PUT", "/pin"), ("DELETE", "/pin"), ("DELETE", "")):
                    answer = self.wire.request(method, path + rest, token=token)
                    kit.expect(answer is not None and answer.status == 404, "%s %s of %s is answered to %s: %s", method, path + rest, one, other, answer)
                for way in ("/../%s/report", "/%%2e%%2e/%s/report", "/results/../../%s/report", "/results/..%%2f..%%2f%s%%2freport.json"):
                    answer = self.wire.request("GET", "/v1/jobs/" + own + way % job["id"], token=token)
                    kit.expect(answer is None or answer.status >= 400, "GET %s: %s", way, answer)
                if job["input"] not in self.uploaded[other]:
                    answer = self.wire.request("HEAD", "/v1/blobs/" + job["input"], token=token)
                    kit.expect(answer is not None and answer.status == 404, "HEAD of a blob of %s by %s: %s", one, other, answer)
                    body = json.dumps({"input": job["input"]}).encode()
                    answer = self.wire.request("POST", "/v1/jobs", ["Content-Type: application/json"], body, token=token)
                    kit.expect(answer is not None and answer.status == 422, "%s names a blob of %s: %s", other, one, answer)
                tried += 1
            listed = self.clients[other].all_jobs()
            mine = {job["id"] for job in self.jobs[one]}
            kit.expect(not mine & {job["id"] for job in listed}, "%s sees jobs of %s in its list", other, one)
        print("foreign tokens: %d jobs, 19 ways each" % tried, flush=True)

    def outside(self):
        after = listing(self.folder, {self.daemon.data, self.daemon.log_path})
        changed = sorted(path for path in self.before.keys() | after.keys() if self.before.get(path) != after.get(path))
        kit.expect(not changed, "made or changed beside the data folder: %s", changed[:10])
        pids = {str(pid) for pid in self.pids | {self.pid, self.spawner}}
        for folder, names in self.shared.items():
            made = [n for n in set(os.listdir(folder)) - names if pids & set(re.findall(r"\d+", n))]
            kit.expect(not made, "made in %s: %s", folder, made)
        print("nothing beside the data folder was touched; %d worker processes were seen" % len(self.pids), flush=True)

    def logs(self):
        """Whole lines, of printable letters only, none of them forged."""
        bad, total = re.compile(rb"[\x00-\x08\x0b-\x1f\x7f]|\xc2[\x80-\x9f]|\xe2\x80[\xa8\xa9\xae]"), 0
        for path in [self.daemon.log_path, *glob.glob(os.path.join(self.daemon.data, "logs", "**", "*"), recursive=True)]:
            if os.path.isdir(path):
                continue
            data = hostile_files.read(path)
            total += len(data)
            found = bad.search(data)
            kit.expect(not found, "%s has a raw control character: %r", path, found and data[max(0, found.start() - 100):found.end() + 100])
            kit.expect(not re.search(rb"(?m)^level=error event=forged", data), "%s has a forged line", path)
            for token in self.tokens.values():
                kit.expect(token.encode() not in data, "%s has a token in it", path)
        for line in self.daemon.log(True).splitlines():
            kit.expect(re.match(r"\S+ level=\w+ |time=|ts=|\d{4}-", line), "a line of the log is not of the daemon's form: %r", line[:300])
        print("logs: %d bytes without control characters" % total, flush=True)

    def run(self):
        try:
            self.start()
            self.files()
            for part in (self.bombs, self.documents, self.paths, self.fields, self.floods, self.smuggled, self.foreign):
                before, sent, peak = time.monotonic(), self.wire.sent, kit.status_kib(self.pid, "VmHWM")
                part()
                self.alive(part.__name__)
                print("%s: %d exchanges in %.0f s, peak %.0f -> %.0f MB" % (part.__name__, self.wire.sent - sent, time.monotonic() - before, peak / 1024,
                                                                         kit.status_kib(self.pid, "VmHWM") / 1024), flush=True)
            print("answers: %s; %d by the HTTP library itself, %d closed without any; the slowest exchange took %.1f s" % (
                ", ".join("%d: %d" % one for one in sorted(self.wire.counts.items())), self.wire.by_library, self.wire.closed, self.wire.slowest), flush=True)
            peak = kit.status_kib(self.pid, "VmHWM") / 1024
            kit.expect(self.sanitized or peak <= self.a.memory, "the daemon took %.0f MB, it is to take %d at most", peak, self.a.memory)
            self.daemon.stop()
            self.outside()
            self.logs()
            print("daemon peak %.0f MB; stopped in order: %s" % (peak, kit.audit(self.daemon)), flush=True)
        finally:
            self.daemon.remove()
            if not os.environ.get("BW_KEEP"):
                shutil.rmtree(self.folder, ignore_errors=True)


def main():
    arguments = kit.parse(__doc__, [("corpus", 150, 100000, "meshes of the fuzzers' corpus"), ("mutations", 120, 3000, "damaged examples"),
                                    ("bomb", 256, 8192, "MB that a coded body unpacks to"), ("noise", 20, 1000, "damaged requests"),
                                    ("memory", 160, 160, "MB that the daemon may take at most")])
    arguments.bin, arguments.folder = os.path.abspath(arguments.bin), os.path.abspath(arguments.folder)
    Hostile(arguments).run()


if __name__ == "__main__":
    kit.run(main)
