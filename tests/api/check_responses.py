#!/usr/bin/env python3
"""Runs a command against a daemon and holds every response to what the daemon's /openapi.json says of it.

    check_responses.py ADDRESS API_DIR COMMAND...      {} in COMMAND stands for the address it is to talk to

A response has to have a status that its operation declares, a media type declared for it, the headers it must have, header values and a
body that fit their schemas, and no member that the schemas do not name (clients may ignore those; the document may not). Problem
documents also have to be of a listed type, with its status. Events of streams fit x-blockwright-events. report.json and other results
fit API_DIR/schemas. Then the responses are damaged in every way that was just checked, and each damage has to be noticed.
Exit code 77 without jsonschema.
"""
import copy
import json
import os
import re
import subprocess
import sys
import urllib.request
import zlib

try:
    import jsonschema
except ImportError:
    print("SKIPPED: responses are not validated, for the Python module jsonschema (python3-jsonschema) is not installed")
    sys.exit(77)

from recorder import Exchange, Recorder

METHODS = ("get", "put", "post", "delete", "head", "patch", "options")
formats = jsonschema.FormatChecker(formats=())


@formats.checks("date-time")
def is_date_time(value):
    return not isinstance(value, str) or bool(re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?(Z|[+-]\d\d:\d\d)", value))


class Wrong(Exception):
    pass


def close(node):
    """The same schemas without room for members that they do not name."""
    if isinstance(node, dict):
        node = {k: close(v) for k, v in node.items()}
        if isinstance(node.get("properties"), dict) and node.get("type") == "object":
            node.setdefault("additionalProperties", False)
    elif isinstance(node, list):
        node = [close(v) for v in node]
    return node


class Contract:
    def __init__(self, doc, api):
        self.doc = doc
        self.schemas = close(doc["components"]["schemas"])
        self.problems = {"/problems/" + p["code"]: p for p in doc["x-blockwright-problems"]}
        self.files = {}
        for name in os.listdir(os.path.join(api, "schemas")):
            if name.endswith(".schema.json"):
                with open(os.path.join(api, "schemas", name), encoding="utf-8") as stream:
                    self.files[name.removesuffix(".schema.json") + ".json"] = json.load(stream)
        self.operations = []
        for path, item in doc["paths"].items():
            for method in METHODS:
                if method in item:
                    pattern = re.compile(re.sub(r"\\{\w+\\}", "[^/]+", re.escape(path)) + r"\Z")
                    self.operations.append((method.upper(), pattern, item[method]))

    def resolve(self, node):
        while "$ref" in node:
            target = self.doc
            for part in node["$ref"].removeprefix("#/").split("/"):
                target = target[part]
            node = {**target, **{k: v for k, v in node.items() if k != "$ref"}}
        return node

    def operation(self, exchange):
        path = exchange.target.split("?")[0]
        fits = [(m, o) for m, pattern, o in self.operations if pattern.match(path)]
        for wanted in (exchange.method, "GET" if exchange.method == "HEAD" else None):
            for method, operation in fits:
                if method == wanted:
                    return operation
        if exchange.status != (405 if fits else 404):
            raise Wrong("no operation is meant, and the answer is not %d" % (405 if fits else 404))
        if fits and not exchange.header("Allow"):
            raise Wrong("405 without Allow")
        return None

    def fit(self, value, schema, what):
        schema = {**close(schema), "components": {"schemas": self.schemas}}
        self.fit_file(value, schema, what)

    @staticmethod
    def fit_file(value, schema, what):
        for error in jsonschema.Draft202012Validator(schema, format_checker=formats).iter_errors(value):
            raise Wrong("%s: %s: %s" % (what, "/".join(map(str, error.absolute_path)) or "it", error.message[:300]))

    def check(self, exchange):
        """Raises Wrong; returns the operation's id, None if it is none's."""
        operation = self.operation(exchange)
        if operation is None:
            response = self.resolve({"$ref": "#/components/responses/Problem"})
        elif str(exchange.status) not in operation["responses"]:
            raise Wrong("%s does not declare %d" % (operation["operationId"], exchange.status))
        else:
            response = self.resolve(operation["responses"][str(exchange.status)])
        for name, header in response.get("headers", {}).items():
            self.check_header(name, self.resolve(header), exchange.header(name))
        media = (exchange.header("Content-Type") or "").split(";")[0].strip()
        declared = response.get("content", {})
        if exchange.method != "HEAD" and exchange.status not in (204, 304):
            if not exchange.complete and media != "text/event-stream":
                raise Wrong("the body breaks off")
            if declared or exchange.body:
                if media not in declared:
                    raise Wrong("media type '%s' is not declared, but %s" % (media, ", ".join(declared) or "no content"))
                self.check_body(exchange, media, declared[media])
        return operation and operation["operationId"]

    def check_header(self, name, header, value):
        if value is None:
            if header.get("required"):
                raise Wrong("the header %s is missing" % name)
            return
        if header["schema"].get("type") == "integer":
            if not re.fullmatch(r"-?\d+", value):
                raise Wrong("the header %s is no integer: %s" % (name, value))
            value = int(value)
        self.fit(value, header["schema"], "header " + name)

    def check_body(self, exchange, media, declared):
        body, coding = exchange.body, exchange.header("Content-Encoding")
        if coding == "gzip":
            body = zlib.decompress(body, 31)
        elif coding:
            return  # zstd: the example compares it with what comes uncoded
        if media == "text/event-stream":
            self.check_events(body.decode(), declared)
        elif media.endswith("json") and exchange.status != 206:
            try:
                value = json.loads(body)
            except ValueError as error:
                raise Wrong("not JSON: %s" % error) from None
            self.fit(value, declared.get("schema", {}), "body")
            if media == "application/problem+json":
                self.check_problem(exchange, value)
            name = exchange.target.split("?")[0].rsplit("/", 1)[-1]
            name = "report.json" if name == "report" else name
            if exchange.status == 200 and "/v1/jobs/" in exchange.target and name in self.files:
                self.fit_file(value, self.files[name], name)
        elif "schema" in declared:
            self.fit(body.decode(), declared["schema"], "body")

    def check_problem(self, exchange, value):
        problem = self.problems.get(value["type"])
        if not problem:
            raise Wrong("problem type %s is not listed" % value["type"])
        if not problem["status"] == value["status"] == exchange.status or problem["title"] != value["title"]:
            raise Wrong("%s with status %d, status %d in it, title '%s'" % (value["type"], exchange.status, value["status"], value["title"]))

    def check_events(self, text, declared):
        for block in text.split("\n\n")[:-1]:  # behind the last blank line is what broke off
            fields = dict(line.split(": ", 1) for line in block.split("\n") if ": " in line and not line.startswith(":"))
            if "event" not in fields:
                continue
            kinds = declared["x-blockwright-events"]
            if fields["event"] not in kinds:
                raise Wrong("event '%s' is not declared" % fields["event"])
            if kinds[fields["event"]].get("type") != "string":
                self.fit(json.loads(fields.get("data", "null")), kinds[fields["event"]], "event " + fields["event"])


def damages(contract, exchange):
    """(what, a damaged copy) for every damage that must not pass."""
    def but(**changes):
        return Exchange(**{**copy.deepcopy(exchange.__dict__), **changes})

    yield "an undeclared status", but(status=299)
    if not exchange.body or exchange.header("Content-Encoding") or exchange.status == 206:
        return
    yield "another media type", but(headers=[(k, "image/png" if k == "content-type" else v) for k, v in exchange.headers])
    media = exchange.header("Content-Type").split(";")[0]
    if media.endswith("json"):
        yield "half the body", but(body=exchange.body[:len(exchange.body) // 2])
        operation = contract.operation(exchange)
        declared = contract.resolve((operation or {}).get("responses", {}).get(str(exchange.status), {"$ref": "#/components/responses/Problem"}))
        schema = declared["content"][media].get("schema")
        value = json.loads(exchange.body)
        if schema and isinstance(value, dict):
            yield "a member more", but(body=json.dumps({**value, "undeclared": 1}).encode())
            for name in contract.resolve(schema).get("required", []):
                yield "no " + name, but(body=json.dumps({k: v for k, v in value.items() if k != name}).encode())
                yield "null as " + name, but(body=json.dumps({**value, name: None}).encode())
        if media == "application/problem+json":
            yield "another problem type", but(body=json.dumps({**value, "type": "/problems/none"}).encode())
            yield "another status", but(body=json.dumps({**value, "status": value["status"] + 1}).encode())
    elif media == "text/event-stream" and b"event: state" in exchange.body:
        yield "an undeclared event", but(body=exchange.body.replace(b"event: state", b"event: other"))
        yield "an event without its job", but(body=exchange.body.replace(b'"job"', b'"jab"'))
    for name in [k for k, v in exchange.headers if k in ("location", "upload-offset", "etag", "www-authenticate", "retry-after")]:
        operation = contract.operation(exchange)
        headers = contract.resolve(operation["responses"][str(exchange.status)]).get("headers", {}) if operation else {}
        if any(h.lower() == name and contract.resolve(v).get("required") for h, v in headers.items()):
            yield "no " + name, but(headers=[(k, v) for k, v in exchange.headers if k != name])


def check_self(contract, good):
    """Every damage to a good response is noticed. Returns how many were made and those that were not noticed."""
    made, missed = 0, []
    for exchange in good:
        for what, damaged in damages(contract, exchange):
            made += 1
            try:
                contract.check(damaged)
                missed.append("%s %s %d with %s passes" % (exchange.method, exchange.target, exchange.status, what))
            except Wrong:
                pass
    return made, missed


def tell(contract, seen):
    for _, _, operation in contract.operations:
        name = operation["operationId"]
        never = [s for s in operation["responses"] if int(s) not in seen.get(name, {})]
        print("%-16s %s" % (name, " ".join("%d(%d)" % pair for pair in sorted(seen.get(name, {}).items())) or "NEVER CALLED"))
        if never:
            print("%-16s   never: %s" % ("", " ".join(never)))


def main():
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    with urllib.request.urlopen("http://%s/openapi.json" % sys.argv[1]) as stream:
        contract = Contract(json.load(stream), sys.argv[2])
    recorder = Recorder(sys.argv[1])
    code = subprocess.run([word.replace("{}", recorder.address) for word in sys.argv[3:]], check=False).returncode
    failures = ["the command ended with %d" % code] if code else []
    seen, good, exchanges = {}, [], recorder.exchanges()
    for exchange in exchanges:
        try:
            name = contract.check(exchange) or "(no operation)"
            seen.setdefault(name, {}).setdefault(exchange.status, 0)
            seen[name][exchange.status] += 1
            good.append(exchange)
        except Wrong as wrong:
            failures.append("%s %s: %d: %s" % (exchange.method, exchange.target, exchange.status, wrong))
    tell(contract, seen)
    failures += ["%s was never called" % o["operationId"] for _, _, o in contract.operations if o["operationId"] not in seen]
    made, missed = check_self(contract, good)
    if not made:
        failures.append("nothing was damaged")
    for message in failures + missed:
        print(message)
    print("check_responses: %d responses, %d pairs of operation and status, %d damages of which %d noticed, %d problem(s)" % (
        len(exchanges), sum(map(len, seen.values())), made, made - len(missed), len(failures) + len(missed)))
    return 1 if failures or missed else 0


if __name__ == "__main__":
    sys.exit(main())
