"""HTTP as bytes: requests that no client library would send, and answers taken apart without believing them."""
import gzip
import json
import select
import socket
import time
import zlib

import kit

SILENCE = 0.4  # seconds without a byte after which the client says that it has no more to send
PATIENCE = 30.0
OF_LIBRARY = (400, 411, 413, 414, 431, 500, 501, 505)  # 500: a line of a chunk that does not fit into the connection's memory


class Answer:
    def __init__(self, status, headers, body):
        self.status, self.headers, self.body = status, headers, body

    def kind(self):
        return self.headers.get(b"content-type", b"").split(b";")[0].strip().decode("latin-1")

    def __str__(self):
        return "%d %s %r" % (self.status, self.kind(), self.body[:200])


def chunked_body(data, at):
    body = b""
    while True:
        end = data.find(b"\r\n", at)
        kit.expect(end >= 0, "an answer ends within its chunks: %r", data[-200:])
        size = int(data[at:end].split(b";")[0], 16)
        at = end + 2
        if size == 0:
            return body, data.index(b"\r\n", at) + 2
        body, at = body + data[at:at + size], at + size + 2


def answers(data, methods):
    """All final answers in what has come on a connection; `methods` are those of the requests, as far as they are known."""
    found, at = [], 0
    while at < len(data):
        end = data.find(b"\r\n\r\n", at)
        kit.expect(end >= 0 and data.startswith(b"HTTP/1.", at), "what has come is no answer: %r", data[:at + 300])
        head, lines = data[at:end + 4], data[at:end].split(b"\r\n")
        status, at = int(lines[0].split(b" ")[1]), end + 4
        headers = {k.strip().lower(): v.strip() for k, _, v in (line.partition(b":") for line in lines[1:])}
        if 100 <= status < 200:
            continue
        if status in OF_LIBRARY and data.startswith(head + b"<html>", at):  # libmicrohttpd 0.9.75 sends the head of a 431 twice now and then
            at += len(head)
        method = methods[len(found)] if len(found) < len(methods) else ""
        if method == "HEAD" or status in (204, 304):
            body = b""
        elif b"chunked" in headers.get(b"transfer-encoding", b""):
            body, at = chunked_body(data, at)
        else:
            size = int(headers.get(b"content-length", len(data) - at))
            body, at = data[at:at + size], at + size
            kit.expect(len(body) == size, "an answer of %d bytes ends after %d", size, len(body))
        found.append(Answer(status, headers, body))
    return found


class Wire:
    """A connection for each exchange. `problems`: the codes of the interface's document and their status."""

    def __init__(self, daemon, token, problems):
        self.daemon, self.token, self.problems = daemon, token, problems
        self.sent = self.closed = self.by_library = 0
        self.slowest = 0.0
        self.counts = {}

    def exchange(self, data):
        """Sends all as far as it is taken, reads until the end. (bytes, whether it was the daemon that closed first)."""
        host, port = self.daemon.address.rsplit(":", 1)
        self.sent += 1
        begun = time.monotonic()
        try:
            return self.talk(data, host, port)
        finally:
            self.slowest = max(self.slowest, time.monotonic() - begun)

    @staticmethod
    def talk(data, host, port):
        with socket.create_connection((host, int(port)), PATIENCE) as s:
            s.setblocking(False)
            got, at, last, said_end, end = b"", 0, time.monotonic(), False, time.monotonic() + PATIENCE
            while True:
                kit.expect(time.monotonic() < end, "a connection stays open, unanswered, for %d s: %r", PATIENCE, data[:200])
                readable, writable, _ = select.select([s], [s] if at < len(data) else [], [], 0.05)
                try:
                    if writable:
                        at += s.send(data[at:at + (1 << 18)])
                        last = time.monotonic()
                    if readable:
                        part, last = s.recv(1 << 18), time.monotonic()
                        if not part:
                            return got, not said_end
                        got += part
                except (ConnectionResetError, BrokenPipeError):
                    if not readable:
                        at = len(data)  # it does not take any more; what it has answered can be read yet
                        continue
                    return got, not said_end
                if not said_end and at == len(data) and time.monotonic() - last > SILENCE:
                    s.shutdown(socket.SHUT_WR)
                    said_end = True

    def request(self, method, target, headers=(), body=b"", token=True):
        """Well-formed but for what the arguments bring. One typed answer."""
        head = [b"%s %s HTTP/1.1" % (method.encode(), target if isinstance(target, bytes) else target.encode()), b"Host: localhost", b"Connection: close"]
        if token:
            head.append(b"Authorization: Bearer " + (self.token if token is True else token).encode())
        if body or method in ("PUT", "POST", "PATCH"):
            head.append(b"Content-Length: %d" % len(body))
        head += [h if isinstance(h, bytes) else h.encode() for h in headers]
        data, _ = self.exchange(b"\r\n".join(head) + b"\r\n\r\n" + body)
        found = answers(data, [method])
        kit.expect(len(found) <= 1, "one request has %d answers: %r", len(found), head[0][:200])
        if not found:
            self.closed += 1
            return None
        self.judge(found[0], head[0], method == "HEAD")
        return found[0]

    def raw(self, data, methods=()):
        """As it stands. All answers, each judged."""
        got, _ = self.exchange(data)
        found = answers(got, methods)
        self.closed += not found
        for answer in found:
            self.judge(answer, data[:200])
        return found

    def judge(self, answer, of, empty=False):
        """It is a success, a problem document of the interface, or the library's own refusal of what is not HTTP, after which the
        connection is closed (Known gaps of server/README.md)."""
        self.counts[answer.status] = self.counts.get(answer.status, 0) + 1
        if answer.status < 400 or (empty and answer.status < 500):
            return
        if answer.status in OF_LIBRARY and answer.body.startswith(b"<html>"):
            kit.expect(answer.headers.get(b"connection", b"").lower() == b"close", "refused, but not closed: %s to %r", answer, of)
            self.by_library += 1
            return
        kit.expect(answer.status < 500, "answered with %s: %r", answer, of)
        kit.expect(answer.kind() == "application/problem+json", "no problem document: %s to %r", answer, of)
        try:
            document = json.loads(answer.body)
        except ValueError:
            raise kit.Finding("a problem document is not JSON: %s to %r" % (answer, of)) from None
        code = document["type"].removeprefix("/problems/")
        kit.expect(self.problems.get(code) == answer.status == document["status"], "an unknown problem: %s to %r", answer, of)


# ---- bodies that are more than they look ----

def gzip_bomb(size):
    packer, block = zlib.compressobj(9, zlib.DEFLATED, 31), bytes(1 << 20)
    return b"".join(packer.compress(block) for _ in range(size >> 20)) + packer.flush()


def gzip_members(count):
    """Many members of nothing, one behind another."""
    return gzip.compress(b"") * count


def zstd_bomb(size, window=0x38):
    """A frame of blocks of 128 KiB that are one byte repeated: 4 bytes each. Window 0x38 is 128 KiB, 0xf8 is 2 TiB."""
    count = max(1, size >> 17)
    blocks = [((1 << 17) << 3 | 1 << 1 | (i == count - 1)).to_bytes(3, "little") + b"\0" for i in range(count)]
    return b"\x28\xb5\x2f\xfd" + bytes([0x00, window]) + b"".join(blocks)
