"""A proxy on loopback that keeps every byte that passes, and what it amounts to as pairs of request and response."""
import socket
import threading
from dataclasses import dataclass


@dataclass
class Exchange:
    method: str
    target: str
    status: int
    headers: list  # of the response: (name in lower case, value)
    body: bytes
    complete: bool  # the body did not break off

    def header(self, name):
        return next((v for k, v in self.headers if k == name.lower()), None)


class Recorder:
    def __init__(self, upstream):
        host, port = upstream.rsplit(":", 1)
        self.upstream = (host.strip("[]"), int(port))
        self.streams = []  # one (to the daemon, from the daemon) per connection
        self.pumps = []
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.address = "127.0.0.1:%d" % self.listener.getsockname()[1]
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self):
        while True:
            try:
                client, _ = self.listener.accept()
            except OSError:
                return
            daemon = socket.create_connection(self.upstream)
            kept = (bytearray(), bytearray())
            self.streams.append(kept)
            for source, sink, into in ((client, daemon, kept[0]), (daemon, client, kept[1])):
                pump = threading.Thread(target=self._pump, args=(source, sink, into), daemon=True)
                self.pumps.append(pump)
                pump.start()

    @staticmethod
    def _pump(source, sink, into):
        try:
            while data := source.recv(65536):
                into += data
                sink.sendall(data)
        except OSError:
            pass
        for end in (source, sink):
            try:
                end.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass

    def exchanges(self):
        """Ends the recording and takes it apart, connection by connection."""
        self.listener.close()
        for pump in self.pumps:
            pump.join(5)
        found = []
        for sent, received in self.streams:
            found += pair(bytes(sent), bytes(received))
        return found


def head(data):
    """The first line, the header lines and the rest; None if they are not all there."""
    top, blank, rest = data.partition(b"\r\n\r\n")
    if not blank:
        return None
    lines = top.decode("latin-1").split("\r\n")
    headers = [(name.strip().lower(), value.strip()) for name, _, value in (line.partition(":") for line in lines[1:])]
    return lines[0], headers, rest


def chunks(data):
    """The content of a chunked body, the rest, whether it was all there."""
    body = b""
    while True:
        size, line_end, data = data.partition(b"\r\n")
        if not line_end:
            return body, b"", False
        n = int(size.split(b";")[0], 16)
        body += data[:n]
        if len(data) < n + 2:
            return body, b"", False
        data = data[n + 2:]
        if n == 0:
            return body, data, True


def content(headers, data, until_end):
    fields = dict(headers)
    if fields.get("transfer-encoding", "").lower() == "chunked":
        return chunks(data)
    if "content-length" in fields:
        n = int(fields["content-length"])
        return data[:n], data[n:], len(data) >= n
    return (data, b"", True) if until_end else (b"", data, True)


def pair(sent, received):
    found = []
    while (request := head(sent)) and (response := head(received)):
        method, target, _ = request[0].split(" ", 2)
        status = int(response[0].split(" ")[1])
        if status < 200:  # 100: the request's body may come
            received = response[2]
            continue
        _, sent, _ = content(request[1], request[2], False)
        empty = method == "HEAD" or status in (204, 304)
        body, received, complete = (b"", response[2], True) if empty else content(response[1], response[2], True)
        found.append(Exchange(method, target, status, response[1], body, complete))
    if head(received):
        raise ValueError("a response without a request: %r" % received[:200])
    return found
