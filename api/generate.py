#!/usr/bin/env python3
"""Turns openapi.yaml into the C tables of the daemon: generate.py openapi.yaml OUT.h OUT.c

Build-time only. Fails with a message when the document contradicts itself, so that the tables never do.
"""
import json
import sys

import yaml

METHODS = ("get", "put", "post", "delete", "head", "patch", "options")


def die(message):
    sys.exit("generate.py: " + message)


def quote(text):
    return json.dumps(text, ensure_ascii=True)


def upper(word):
    return word.upper().replace("-", "_")


def resolve(doc, node):
    """Follows $ref; members beside it win."""
    while isinstance(node, dict) and "$ref" in node:
        target = doc
        for part in node["$ref"].removeprefix("#/").split("/"):
            if part not in target:
                die("dangling reference " + node["$ref"])
            target = target[part]
        node = {**target, **{k: v for k, v in node.items() if k != "$ref"}}
    return node


def endpoints(doc):
    seen = set()
    for path, item in doc["paths"].items():
        for method in METHODS:
            if method not in item:
                continue
            operation = item[method].get("operationId") or die("no operationId: %s %s" % (method, path))
            if operation in seen:
                die("operationId twice: " + operation)
            seen.add(operation)
            wanted = scope(doc, item[method])
            yield operation, method.upper(), path, "BW_SCOPE_" + upper(wanted) if wanted else "0", str("{id}" in path).lower()


def scopes(doc):
    return list(doc["components"]["securitySchemes"]["token"]["x-blockwright-scopes"])


def scope(doc, operation):
    """The scope that the operation wants, None if it is for everybody. It has to say so: nothing is public by oversight."""
    name, wanted = operation["operationId"], operation.get("security")
    if wanted is None:
        die("%s has no security: [{token: [SCOPE]}], or [] if everybody may do it" % name)
    if not wanted:
        return None
    if len(wanted) != 1 or list(wanted[0]) != ["token"] or len(wanted[0]["token"]) != 1 or wanted[0]["token"][0] not in scopes(doc):
        die("%s: security is not one token with one scope of x-blockwright-scopes" % name)
    return wanted[0]["token"][0]


def complete(doc):
    """Adds the answers that any operation may have, where it does not describe them itself: to a query parameter that is not there or a request
    that is unclear, from a daemon that is meant by another name or is stopping, to a failure inside, to other sites' pages if it
    changes something, and if it wants a token to requests without one or with one that does not do, or that come too often."""
    for item in doc["paths"].values():
        for method in METHODS:
            if method not in item:
                continue
            token = scope(doc, item[method])
            answers = {"400": "Problem", "421": "Problem", "500": "Problem", "503": "NotReady"}
            if token or method not in ("get", "head"):
                answers["403"] = "Problem"
            if token:
                answers.update({"401": "Unauthorized", "429": "TooMany"})
            for status, response in answers.items():
                item[method]["responses"].setdefault(status, {"$ref": "#/components/responses/" + response})
            item[method]["responses"] = dict(sorted(item[method]["responses"].items()))


def queries(doc):
    """The names that may stand in an operation's query; of an exploded object those of its members."""
    for item in doc["paths"].values():
        for method in METHODS:
            if method not in item:
                continue
            names = []
            for parameter in (resolve(doc, p) for p in item[method].get("parameters", [])):
                if parameter["in"] == "query":
                    schema = resolve(doc, parameter["schema"])
                    names += schema["properties"] if schema.get("type") == "object" else [parameter["name"]]
            if len(set(names)) != len(names):
                die("%s: a name stands twice for something in its query" % item[method]["operationId"])
            yield item[method]["operationId"], names


def option_rows(doc):
    for name, schema in sorted(doc["components"]["schemas"]["Options"]["properties"].items()):
        kind = {"string": "ENUM", "number": "NUMBER", "integer": "INTEGER", "boolean": "BOOLEAN", "array": "NUMBERS"}.get(schema["type"])
        if not kind or (kind == "ENUM" and "enum" not in schema):
            die("option %s has a type without a C table" % name)
        if "default" not in schema:
            die("option %s needs a default" % name)
        length = schema.get("maxItems", 0)
        if kind == "NUMBERS":
            kind = {"number": "NUMBERS", "string": "ENUMS"}.get(schema["items"].get("type"))
            if not length or not kind or (kind == "ENUMS") != ("enum" in schema["items"]):
                die("option %s has to be a list of numbers, or of an enumeration, with maxItems" % name)
            schema = dict(schema["items"], default=schema["default"])
        low = schema.get("exclusiveMinimum", schema.get("minimum", 0))
        high = schema.get("exclusiveMaximum", schema.get("maximum", 0))
        yield (name, kind, schema.get("enum", []), low, "exclusiveMinimum" in schema, high, "exclusiveMaximum" in schema,
               length, json.dumps(schema["default"]))


def check(doc):
    stages = [s["name"] for s in doc["x-blockwright-stages"]]
    options = doc["components"]["schemas"]["Options"]["properties"]
    if options["until"]["enum"] != stages:
        die("option until does not list the stages")
    for stage in doc["x-blockwright-stages"]:
        for name in stage["options"]:
            if name not in options:
                die("stage %s depends on an unknown option %s" % (stage["name"], name))
    used = {name for stage in doc["x-blockwright-stages"] for name in stage["options"]} | {"until"}
    if set(options) != used:
        die("no stage depends on option(s) %s" % ", ".join(sorted(set(options) - used)))
    codes = [p["code"] for p in doc["x-blockwright-problems"]]
    if len(set(codes)) != len(codes):
        die("a problem code is listed twice")
    for path in doc["paths"]:
        if "{id}" in path and not path.startswith("/v1/jobs/{id}"):
            die("{id} is a job's, who may see it is decided by it: " + path)
    classes = doc["components"]["schemas"]["FailureClass"]["enum"]
    for problem in doc["x-blockwright-problems"]:
        if problem.get("class") not in [None] + classes:
            die("problem %s has an unknown class" % problem["code"])


def capabilities(doc):
    """What GET /v1/capabilities says that does not depend on how the daemon was started."""
    def bare(schema):
        return {k: bare(v) if isinstance(v, dict) else v for k, v in schema.items() if k != "description"}

    options = doc["components"]["schemas"]["Options"]["properties"]
    return {"stages": doc["x-blockwright-stages"],
            "options": {name: bare(schema) for name, schema in options.items()},
            "formats": {"input": doc["x-blockwright-input-formats"], "output": options["hex_formats"]["items"]["enum"]}}


def header(doc):
    out = ["/* Generated by api/generate.py from api/openapi.yaml. Do not edit. */",
           "#ifndef BW_API_H", "#define BW_API_H", "#include <stdbool.h>", "#include <stddef.h>", ""]

    def enum(name, prefix, words):
        out.append("typedef enum {\n    %s,\n    %s_COUNT\n} %s;\n" % (
            ",\n    ".join(prefix + "_" + upper(w) for w in words), prefix, name))

    enum("bw_op", "BW_OP", [e[0] for e in endpoints(doc)])
    enum("bw_problem", "BW_PROBLEM", [p["code"] for p in doc["x-blockwright-problems"]])
    enum("bw_job_state", "BW_JOB", doc["components"]["schemas"]["JobState"]["enum"])
    out.append("typedef enum {\n    %s\n} bw_scope; /* flags */" %
               ",\n    ".join("BW_SCOPE_%s = %d" % (upper(s), 1 << i) for i, s in enumerate(scopes(doc))))
    out.append("enum { BW_SCOPE_COUNT = %d };\nextern const char *const bw_scope_names[BW_SCOPE_COUNT]; /* in the order of the flags */\n" %
               len(scopes(doc)))
    out.append("""/* An operation. `path` has {name} in the place of variable segments; `query` ends with NULL. `scope` is the one it wants of a token, 0 if
 * it is for everybody; `of_job`: its first variable segment is the id of a job. */
typedef struct {
    const char *id, *method, *path;
    const char *const *query;
    int scope;
    bool of_job;
} bw_endpoint;
extern const bw_endpoint bw_endpoints[BW_OP_COUNT];

/* `failure_class` is NULL for what only a request can run into. */
typedef struct {
    const char *code, *type, *title, *failure_class;
    int http;
} bw_problem_type;
extern const bw_problem_type bw_problem_types[BW_PROBLEM_COUNT];

extern const char *const bw_job_state_names[BW_JOB_COUNT];

enum { BW_API_STAGE_COUNT = %d };
typedef struct {
    const char *name;
    int version;
    const char *const *options; /* NULL-terminated: the job options that the stage's output depends on */
} bw_api_stage;
extern const bw_api_stage bw_api_stages[BW_API_STAGE_COUNT];

typedef enum { BW_OPTION_ENUM, BW_OPTION_NUMBER, BW_OPTION_INTEGER, BW_OPTION_BOOLEAN, BW_OPTION_NUMBERS, BW_OPTION_ENUMS } bw_option_kind;
enum { BW_API_OPTION_COUNT = %d };
typedef struct {
    const char *name;
    bw_option_kind kind;
    const char *const *values; /* of an enumeration or a list of such, NULL-terminated */
    double minimum, maximum;
    bool above_minimum, below_maximum; /* the bound itself is excluded */
    size_t length;                     /* of a list: how many at most; the bounds are those of its items */
    const char *default_json;
} bw_api_option;
extern const bw_api_option bw_api_options[BW_API_OPTION_COUNT]; /* sorted by name */

extern const char bw_api_capabilities[]; /* a JSON object: stages, options, formats */

extern const char bw_api_document[]; /* openapi.json */
extern const size_t bw_api_document_size;

#endif""" % (len(doc["x-blockwright-stages"]), len(list(option_rows(doc)))))
    return "\n".join(out) + "\n"


def names_array(label, names):
    return "static const char *const %s[] = {%s};" % (label, ", ".join([quote(n) for n in names] + ["NULL"]))


def source(doc, include):
    out = ["/* Generated by api/generate.py from api/openapi.yaml. Do not edit. */", '#include "%s"' % include, ""]
    out += [names_array("query_" + op, names) for op, names in queries(doc)]
    out.append("const char *const bw_scope_names[BW_SCOPE_COUNT] = {%s};" % ", ".join(map(quote, scopes(doc))))
    out.append("const bw_endpoint bw_endpoints[BW_OP_COUNT] = {")
    out += ["    {%s, %s, %s, query_%s, %s, %s}," % (quote(i), quote(m), quote(p), i, s, j) for i, m, p, s, j in endpoints(doc)]
    out += ["};", "const bw_problem_type bw_problem_types[BW_PROBLEM_COUNT] = {"]
    for p in doc["x-blockwright-problems"]:
        out.append("    {%s, %s, %s, %s, %d}," % (quote(p["code"]), quote("/problems/" + p["code"]), quote(p["title"]),
                                                quote(p["class"]) if "class" in p else "NULL", p["status"]))
    states = doc["components"]["schemas"]["JobState"]["enum"]
    out += ["};", "const char *const bw_job_state_names[BW_JOB_COUNT] = {%s};" % ", ".join(map(quote, states))]
    out += [names_array("stage_" + s["name"], s["options"]) for s in doc["x-blockwright-stages"]]
    out.append("const bw_api_stage bw_api_stages[BW_API_STAGE_COUNT] = {")
    out += ["    {%s, %d, stage_%s}," % (quote(s["name"]), s["version"], s["name"]) for s in doc["x-blockwright-stages"]]
    out.append("};")
    rows = list(option_rows(doc))
    out += [names_array("values_" + r[0], r[2]) for r in rows]
    out.append("const bw_api_option bw_api_options[BW_API_OPTION_COUNT] = {")
    for name, kind, _, low, above, high, below, length, default in rows:
        out.append("    {%s, BW_OPTION_%s, values_%s, %r, %r, %s, %s, %d, %s}," % (
            quote(name), kind, name, float(low), float(high), str(above).lower(), str(below).lower(), length, quote(default)))
    out.append("};")
    out.append("const char bw_api_capabilities[] =")
    out += ["    " + quote(line) for line in json.dumps(capabilities(doc), indent=0, ensure_ascii=True).splitlines()]
    out.append("    ;")
    text = json.dumps(doc, indent=1, sort_keys=False, ensure_ascii=True) + "\n"
    out.append("const char bw_api_document[] =")
    out += ["    " + quote(line + "\n") for line in text.splitlines()]
    out += ["    ;", "const size_t bw_api_document_size = sizeof bw_api_document - 1;"]
    return "\n".join(out) + "\n"


def main():
    if len(sys.argv) != 4:
        die("usage: generate.py openapi.yaml OUT.h OUT.c")
    with open(sys.argv[1], encoding="utf-8") as stream:
        doc = yaml.safe_load(stream)
    check(doc)
    complete(doc)
    with open(sys.argv[2], "w", encoding="utf-8") as stream:
        stream.write(header(doc))
    with open(sys.argv[3], "w", encoding="utf-8") as stream:
        stream.write(source(doc, sys.argv[2].rsplit("/", 1)[-1]))


if __name__ == "__main__":
    main()
