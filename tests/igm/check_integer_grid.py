#!/usr/bin/env python3
"""Checks an integer-grid map in a .hexex file with exact fractions: check_integer_grid.py MAP.hexex [INPUT.hexex]

Reads the file by itself, knowing nothing of the program that wrote it, and says what it found in one line. Exit code 1 if anything is wrong:
every tet positive; every inner facet's transition one of the 24 rotations and a whole shift, for all three corners; every boundary facet constant in an axis at a whole
value; the angle around every inner edge a full turn, else the edge is aligned at whole values (about 90 degrees times a whole number); with INPUT: the same surface area's
vertices are there (those of the input come first, at the same places) and the same number of parts.
"""
import itertools
import math
import sys
from fractions import Fraction


def read(path):
    with open(path) as file:
        words = iter(file.read().split())
    points = [tuple(float(next(words)) for _ in range(3)) for _ in range(int(next(words)))]
    tets = []
    for _ in range(int(next(words))):
        corners = [int(next(words)) for _ in range(4)]
        tets.append((corners, [[Fraction(next(words)) for _ in range(3)] for _ in range(4)]))
    return points, tets


def rotations():
    for axes in itertools.permutations(range(3)):
        for signs in itertools.product((1, -1), repeat=3):
            matrix = [[signs[i] if axes[i] == k else 0 for k in range(3)] for i in range(3)]
            if det(matrix) == 1:
                yield matrix


def det(m):
    return (m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
            + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]))


def minus(a, b):
    return [x - y for x, y in zip(a, b)]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def check_tets(tets):
    return [f"tet {n} is not positive" for n, (_, u) in enumerate(tets) if det([minus(u[i], u[0]) for i in (1, 2, 3)]) <= 0]


def check_facets(tets):
    """Faults, and the vertex pairs on the boundary."""
    faults, boundary, sides, turn = [], set(), {}, list(rotations())
    for n, (corners, _) in enumerate(tets):
        for i in range(4):
            sides.setdefault(tuple(sorted(c for k, c in enumerate(corners) if k != i)), []).append(n)
    for facet, at in sides.items():
        values = [[tets[n][1][tets[n][0].index(v)] for v in facet] for n in at]
        if len(at) == 1:
            boundary.update(itertools.combinations(facet, 2))
            if not any(len({u[k] for u in values[0]}) == 1 and values[0][0][k].denominator == 1 for k in range(3)):
                faults.append(f"boundary facet {facet} is not on the grid")
        elif len(at) > 2 or not any(fits(m, *values) for m in turn):
            faults.append(f"facet {facet} has no whole transition")
    return faults, boundary


def fits(matrix, a, b):
    shift = minus(b[0], [dot(row, a[0]) for row in matrix])
    return all(s.denominator == 1 for s in shift) and all([dot(row, u) for row in matrix] == minus(w, shift) for u, w in zip(a[1:], b[1:]))


def check_edges(tets, boundary):
    faults, edges, singular = [], {}, 0
    for n, (corners, _) in enumerate(tets):
        for a, b in itertools.combinations(range(4), 2):
            edges.setdefault(tuple(sorted((corners[a], corners[b]))), []).append((n, a, b))
    for edge, uses in edges.items():
        turns = sum(angle(tets[n][1], a, b) for n, a, b in uses) / (math.pi / 2)
        if abs(turns - (2 if edge in boundary else 4)) < 1e-3:
            continue
        singular += 1
        for n, a, b in uses:
            u = tets[n][1]
            same = [k for k in range(3) if u[a][k] == u[b][k]]
            if len(same) != 2 or any(u[a][k].denominator != 1 for k in same) or abs(turns - round(turns)) > 1e-3:
                faults.append(f"singular edge {edge} is not on the grid")
                break
    return faults, singular


def angle(u, a, b):
    c, d = (k for k in range(4) if k not in (a, b))
    e, x, y = ([float(z) for z in minus(u[k], u[a])] for k in (b, c, d))
    n, m = cross(e, x), cross(e, y)
    return math.atan2(abs(dot(e, cross(n, m))) / math.sqrt(dot(e, e)), dot(n, m))


def parts(tets):
    root = {}

    def find(v):
        while root.setdefault(v, v) != v:
            root[v] = root[root[v]]
            v = root[v]
        return v

    for corners, _ in tets:
        for v in corners[1:]:
            root[find(v)] = find(corners[0])
    return sum(find(v) == v for v in list(root))


def main():
    points, tets = read(sys.argv[1])
    faults = check_tets(tets)
    torn, boundary = check_facets(tets)
    tilted, singular = check_edges(tets, boundary)
    faults += torn + tilted
    if len(sys.argv) > 2:
        before, input_tets = read(sys.argv[2])
        if points[:len(before)] != before:
            faults.append("vertices of the input have moved in space")
        if parts(tets) != parts(input_tets):
            faults.append("there are other parts than in the input")
    for fault in faults[:10]:
        print(fault)
    print(f"{len(tets)} tets, {singular} singular edges, {len(faults)} faults")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
