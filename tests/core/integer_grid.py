"""Independent check of an integer-grid map in .hexex form, in exact fractions.

usage: integer_grid.py FILE

Every tet is positive; boundary facets are constant in an axis, at an integer; across every other facet the parameters are related by a rotation of the
octahedral group and an integral translation. Prints counts; exit status 1 if anything is not so.
"""
import sys
from fractions import Fraction
from itertools import permutations, product


def det(a, b, c):
    return (a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
            + a[2] * (b[0] * c[1] - b[1] * c[0]))


def minus(a, b):
    return [x - y for x, y in zip(a, b)]


def read(path):
    lines = open(path).read().split("\n")
    vertices = int(lines[0])
    tets = []
    for line in lines[vertices + 2:vertices + 2 + int(lines[vertices + 1])]:
        word = line.split()
        tets.append(([int(x) for x in word[:4]],
                     [[Fraction(word[4 + 3 * i + k]) for k in range(3)] for i in range(4)]))
    return tets


ROTATIONS = [(axis, sign) for axis in permutations(range(3)) for sign in product((1, -1), repeat=3)
             if det(*[[sign[i] if j == axis[i] else 0 for j in range(3)] for i in range(3)]) == 1]


def related(a, b):
    for axis, sign in ROTATIONS:
        shift = [b[0][i] - sign[i] * a[0][axis[i]] for i in range(3)]
        if all(s.denominator == 1 for s in shift) and all(
                b[c][i] == sign[i] * a[c][axis[i]] + shift[i] for c in range(3) for i in range(3)):
            return True
    return False


def main():
    tets = read(sys.argv[1])
    inverted = boundary = crooked = seams = torn = 0
    facets = {}
    for vertex, at in tets:
        inverted += det(minus(at[1], at[0]), minus(at[2], at[0]), minus(at[3], at[0])) <= 0
        for i in range(4):
            corners = sorted((j for j in range(4) if j != i), key=lambda j: vertex[j])
            facets.setdefault(tuple(vertex[j] for j in corners), []).append([at[j] for j in corners])
    for sides in facets.values():
        if len(sides) == 1:
            boundary += 1
            a = sides[0]
            crooked += not any(a[0][k] == a[1][k] == a[2][k] and a[0][k].denominator == 1 for k in range(3))
        elif len(sides) > 2:
            torn += 1
        elif sides[0] != sides[1]:
            seams += 1
            torn += not related(*sides)
    print(f"{len(tets)} tets, {inverted} not positive; {boundary} facets of the boundary, {crooked} not aligned; "
          f"{seams} seams, {torn} not integral")
    return 1 if inverted or crooked or torn or not tets else 0


if __name__ == "__main__":
    sys.exit(main())
