#!/usr/bin/env python3
"""Draws the blocks of a traced.hexex as an SVG picture, pulled apart a little. Needs nothing but Python.

    python3 deploy/draw.py traced.hexex picture.svg [--gap 0.25] [--angles 35 -60] [--width 900]

Blocks are the pieces that the wall list cuts the tet mesh into. Their skins are drawn back to front (painter's algorithm),
each block moved away from the middle of the part. Lines are the walls' and the boundary's edges: where the skin of a block
bends, or where two walls meet in it.
"""
import argparse
import math
import sys

FACETS = ((1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1))  # outward for a tet of positive volume
COLOURS = ("#7aa6d8", "#e0a458", "#8cbf88", "#c98bb9", "#d8c36a", "#7fc4bf", "#d98880", "#a3a0d6", "#b5c87a", "#caa27e")


def read(path):
    """Positions, tets and walls (sorted vertex triples) of a .hexex file."""
    with open(path, encoding="ascii") as file:
        position = [tuple(map(float, file.readline().split())) for _ in range(int(file.readline()))]
        tets = [tuple(map(int, file.readline().split(maxsplit=4)[:4])) for _ in range(int(file.readline()))]
        head = file.readline().split()
        count = int(head[0]) if len(head) == 1 else 0
        walls = {tuple(sorted(map(int, file.readline().split()[:3]))) for _ in range(count)}
    return position, tets, walls


def volume(p, tet):
    a, b, c, d = (p[v] for v in tet)
    return dot(cross(sub(b, a), sub(c, a)), sub(d, a))


def sub(a, b):
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def blocks_and_skins(position, tets, walls):
    """Block of every tet, and the skin facets as (block, outward triple)."""
    sides = {}
    for t, tet in enumerate(tets):
        for f in FACETS:
            sides.setdefault(tuple(sorted(tet[i] for i in f)), []).append((t, tuple(tet[i] for i in f)))
    root = list(range(len(tets)))

    def find(t):
        while root[t] != t:
            root[t] = root[root[t]]
            t = root[t]
        return t

    for key, pair in sides.items():
        if len(pair) == 2 and key not in walls:
            root[find(pair[0][0])] = find(pair[1][0])
    number = {}
    block = [number.setdefault(find(t), len(number)) for t in range(len(tets))]
    mirrored = sum(volume(position, tet) < 0 for tet in tets) * 2 > len(tets)
    skin = []
    for key, pair in sides.items():
        if len(pair) == 1 or key in walls:
            skin.extend((block[t], f[::-1] if mirrored else f) for t, f in pair)
    return block, len(number), skin


def creases(position, block_count, skin):
    """Edges of the skins at which a block bends by more than 40 degrees, as (block, edge)."""
    faces = {}
    for b, f in skin:
        n = cross(sub(position[f[1]], position[f[0]]), sub(position[f[2]], position[f[0]]))
        size = math.sqrt(dot(n, n)) or 1.0
        for i in range(3):
            faces.setdefault((b, tuple(sorted((f[i], f[(i + 1) % 3])))), []).append(tuple(x / size for x in n))
    limit = math.cos(math.radians(40))
    return {key for key, n in faces.items() if len(n) != 2 or dot(n[0], n[1]) < limit}


def camera(turn, tilt):
    """Rotation to (right, up, towards the viewer)."""
    a, b = math.radians(turn), math.radians(tilt)
    ca, sa, cb, sb = math.cos(a), math.sin(a), math.cos(b), math.sin(b)
    return lambda p: (ca * p[0] - sa * p[1], cb * (sa * p[0] + ca * p[1]) - sb * p[2], sb * (sa * p[0] + ca * p[1]) + cb * p[2])


def shift_of_blocks(position, tets, block, count, gap):
    middle = [sum(p[i] for p in position) / len(position) for i in range(3)]
    centre = [[0.0, 0.0, 0.0, 0] for _ in range(count)]
    for t, tet in enumerate(tets):
        c = centre[block[t]]
        for v in tet:
            for i in range(3):
                c[i] += position[v][i]
            c[3] += 1
    return [tuple(gap * (c[i] / c[3] - middle[i]) for i in range(3)) for c in centre]


def shade(colour, light):
    return "#" + "".join(f"{min(255, int(int(colour[i:i + 2], 16) * light)):02x}" for i in (1, 3, 5))


def draw(position, skin, edges, shift, view, width):
    shapes = []
    for b, f in skin:
        p = [view(tuple(position[v][i] + shift[b][i] for i in range(3))) for v in f]
        n = cross(sub(p[1], p[0]), sub(p[2], p[0]))
        if n[2] <= 0:
            continue
        light = 0.62 + 0.4 * max(0.0, dot(n, (0.35, 0.5, 0.79)) / math.sqrt(dot(n, n)))
        lines = [(p[i], p[(i + 1) % 3]) for i in range(3) if (b, tuple(sorted((f[i], f[(i + 1) % 3])))) in edges]
        shapes.append((sum(q[2] for q in p) / 3, p, shade(COLOURS[b % len(COLOURS)], light), lines))
    shapes.sort(key=lambda s: s[0])
    xs = [q[0] for s in shapes for q in s[1]]
    ys = [q[1] for s in shapes for q in s[1]]
    scale = (width - 20) / (max(xs) - min(xs))
    height = (max(ys) - min(ys)) * scale + 20

    def at(q):
        return f"{(q[0] - min_x) * scale + 10:.1f} {(max_y - q[1]) * scale + 10:.1f}"

    min_x, max_y = min(xs), max(ys)
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height:.0f}" width="{width}" height="{height:.0f}">',
           '<style>path{shape-rendering:crispEdges}.e{fill:none;stroke:#26303a;stroke-width:1.3;stroke-linecap:round;'
           'shape-rendering:geometricPrecision}</style><rect width="100%" height="100%" fill="#fff"/>']
    fill, path = None, []

    def flush():
        if path:
            out.append(f'<path d="{"".join(path)}" fill="{fill}"/>')
            path.clear()

    for _, p, colour, lines in shapes:  # neighbours of one colour become one path
        if colour != fill:
            flush()
            fill = colour
        path.append(f"M{at(p[0])}L{at(p[1])}L{at(p[2])}Z")
        if lines:
            flush()
            out.append(f'<path class="e" d="{"".join(f"M{at(a)}L{at(b)}" for a, b in lines)}"/>')
    flush()
    out.append("</svg>\n")
    return "\n".join(out)


def main():
    parser = argparse.ArgumentParser(description="Draws the blocks of a traced.hexex as SVG.")
    parser.add_argument("input")
    parser.add_argument("output")
    parser.add_argument("--gap", type=float, default=0.25, help="how far blocks move apart, relative to their distance")
    parser.add_argument("--angles", type=float, nargs=2, default=(35, -60), help="turn and tilt in degrees")
    parser.add_argument("--width", type=int, default=900)
    given = parser.parse_args()
    position, tets, walls = read(given.input)
    block, count, skin = blocks_and_skins(position, tets, walls)
    shift = shift_of_blocks(position, tets, block, count, given.gap)
    text = draw(position, skin, creases(position, count, skin), shift, camera(*given.angles), given.width)
    with open(given.output, "w", encoding="ascii") as file:
        file.write(text)
    print(f"{count} blocks drawn")
    return 0


if __name__ == "__main__":
    sys.exit(main())
