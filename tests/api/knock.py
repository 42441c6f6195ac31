#!/usr/bin/env python3
"""Calls every operation in ways that none may answer otherwise.

    knock.py ADDRESS                  a daemon without tokens: an unknown query parameter, another host's name, a page of another site
    knock.py ADDRESS SUBMIT READ      with tokens of these scopes: without a token, with an unknown one, with one whose scope does not do
"""
import http.client
import json
import re
import sys


def call(address, method, path, headers):
    connection = http.client.HTTPConnection(address, timeout=20)
    connection.request(method, path, headers=headers)
    response = connection.getresponse()
    body = response.read()
    connection.close()
    return response.status, body


def mistakes(method, path):
    """(path, headers, the status that must follow) on a daemon without tokens"""
    site = {"Origin": "http://elsewhere.example"}
    yield path + "?undeclared=1", {}, 400
    yield path, {"Host": "elsewhere.example"}, 421
    if method not in ("get", "head"):
        yield path, site, 403


def strangers(path, security, tokens):
    if not security:
        return
    wrong = tokens["read" if security[0]["token"] == ["submit"] else "submit"]
    for token, status in ((None, 401), ("bw_unknown", 401), (wrong, 403)):
        yield path, {"Authorization": "Bearer " + token} if token else {}, status


def main():
    address, tokens = sys.argv[1], dict(zip(("submit", "read"), sys.argv[2:]))
    doc = json.loads(call(address, "GET", "/openapi.json", {})[1])
    failures = 0
    for template, item in doc["paths"].items():
        for method in ("get", "put", "post", "delete", "head", "patch", "options"):
            if method not in item:
                continue
            path = re.sub(r"{\w+}", "0" * 24, template)
            calls = strangers(path, item[method]["security"], tokens) if tokens else mistakes(method, path)
            for target, headers, wanted in calls:
                status = call(address, method.upper(), target, headers)[0]
                if status != wanted:
                    print("%s %s %s: %d instead of %d" % (method, target, headers, status, wanted))
                    failures += 1
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
