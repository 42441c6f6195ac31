#!/usr/bin/env python3
"""Checks api/openapi.yaml beyond what the generator needs, and that every operation has an example: check_openapi.py API_DIR"""
import os
import re
import sys

import yaml

METHODS = ("get", "put", "post", "delete", "head", "patch", "options")
failures = []


def expect(condition, message):
    if not condition:
        failures.append(message)


def walk(node, path=""):
    yield path, node
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in items:
        yield from walk(value, "%s/%s" % (path, key))


def resolve(doc, ref):
    for part in ref.removeprefix("#/").split("/"):
        doc = doc.get(part, {}) if isinstance(doc, dict) else {}
    return doc


def operations(doc):
    for path, item in doc["paths"].items():
        for method in METHODS:
            if method in item:
                yield method, path, item[method], item.get("parameters", [])


def main():
    api = sys.argv[1]
    with open(os.path.join(api, "openapi.yaml"), encoding="utf-8") as stream:
        doc = yaml.safe_load(stream)
    expect(doc["openapi"].startswith("3.1."), "not OpenAPI 3.1")
    for path, node in walk(doc):
        if isinstance(node, dict) and isinstance(node.get("$ref"), str):
            expect(resolve(doc, node["$ref"]), "%s points at nothing: %s" % (path, node["$ref"]))
    statuses = {p["status"] for p in doc["x-blockwright-problems"]}
    examples = os.path.join(api, "examples")
    for method, path, operation, shared in operations(doc):
        name = operation["operationId"]
        parameters = [resolve(doc, p["$ref"]) if "$ref" in p else p for p in shared + operation.get("parameters", [])]
        stated = {p["name"] for p in parameters if p["in"] == "path"}
        expect(stated == set(re.findall(r"{(\w+)}", path)), "%s: path parameters differ from %s" % (name, path))
        expect(operation.get("summary"), "%s has no summary" % name)
        expect(any(c.startswith("2") for c in operation["responses"]), "%s never succeeds" % name)
        for code in operation["responses"]:
            expect(int(code) < 400 or int(code) in statuses, "%s answers %s, which no problem type has" % (name, code))
        script = os.path.join(examples, "job_wait.sh" if name == "job_get" else name + ".sh")
        if not os.path.exists(script):
            expect(False, "%s has no example" % name)
            continue
        with open(script, encoding="utf-8") as stream:
            first = stream.readline()
        expect(first.startswith("# %s %s" % (method.upper(), path)), "%s does not begin with its call" % script)
        with open(os.path.join(examples, "walkthrough.sh"), encoding="utf-8") as stream:
            expect(os.path.basename(script) in stream.read(), "walkthrough.sh leaves out " + script)
    known = {suffix for f in doc["x-blockwright-input-formats"] for suffix in f["suffixes"]}
    shown = {os.path.splitext(name)[1] for name in os.listdir(os.path.join(examples, "formats"))} - {".md", ".parameters"}
    expect(shown <= known, "x-blockwright-input-formats lacks %s" % sorted(shown - known))
    for row in doc["x-blockwright-input-formats"]:
        expect(shown & set(row["suffixes"]), "input format %s has no example" % row["name"])
        for kind, stem in (("tet", "cube"), ("hex", "hexes")):
            there = any(os.path.exists(os.path.join(examples, "formats", stem + suffix)) for suffix in row["suffixes"])
            expect(there == (kind in row["kinds"]), "input format %s and its examples differ about %s" % (row["name"], kind))
    for message in failures:
        print(message)
    print("check_openapi: %d problem(s)" % len(failures))
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
