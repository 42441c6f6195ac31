#!/usr/bin/python3
"""usage: hex_readers.py meshio|vtk|gmsh|cgns|cgnscheck|ovm FOLDER

Reads every NAME.<format> of the folder with a program that is not ours, and compares it with NAME.json (hex_files.h): positions to the last bit, corners in
order, blocks, ijk, surfaces, edges; every hex positive. Prints what was read. Exit status 0 all right, 1 a difference, 77 the program is not installed.
"""
import glob
import json
import os
import shutil
import struct
import subprocess
import sys
import tempfile


class Truth:
    def __init__(self, path):
        self.__dict__.update(json.load(open(path)))
        self.by_block = sorted(range(len(self.hexes)), key=lambda h: (self.block[h] if self.block[h] >= 0 else 1 << 40, h))
        self.by_reference = sorted(range(len(self.hexes)), key=lambda h: (self.block[h], h))
        self.no_block = max(self.block) + 1  # what stands for "no block" where tags must be positive


def expect(condition, what):
    if not condition:
        raise AssertionError(what)


def same(name, got, wanted):
    got, wanted = plain(got), plain(wanted)
    if got != wanted:
        at = next((i for i, (a, b) in enumerate(zip(got, wanted)) if a != b), min(len(got), len(wanted)))
        raise AssertionError(f"{name} differ at {at}: {got[at:at + 1]} instead of {wanted[at:at + 1]} ({len(got)} and {len(wanted)})")


def plain(value):
    """Lists of Python numbers."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    return [plain(x) if isinstance(x, (list, tuple)) or hasattr(x, "tolist") else x for x in value]


CORNERS = ((0, 1, 3, 4), (1, 2, 0, 5), (2, 3, 1, 6), (3, 0, 2, 7), (4, 7, 5, 0), (5, 4, 6, 1), (6, 5, 7, 2), (7, 6, 4, 3))


def scaled_jacobian(points, ring):
    least = 2
    for at, *to in CORNERS:
        e = [[b - a for a, b in zip(points[ring[at]], points[ring[t]])] for t in to]
        n = [sum(x * x for x in v) ** .5 for v in e]
        det = (e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) - e[0][1] * (e[1][0] * e[2][2] - e[1][2] * e[2][0])
               + e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0]))
        least = min(least, det / (n[0] * n[1] * n[2]))
    return least


def positive(points, hexes):
    for h, ring in enumerate(hexes):
        expect(scaled_jacobian(points, ring) > 0, f"hex {h} is not positive")


def arrays(truth, points, block, ijk, jacobian, held):
    same("block", block, truth.block)
    same("ijk", ijk, truth.ijk)
    same("held", held, truth.held)
    for h, value in enumerate(jacobian):
        expect(abs(value - scaled_jacobian(points, truth.hexes[h])) < 1e-12, f"scaled_jacobian of hex {h}")


# ---- meshio

def cells_of(mesh, kind):
    return [row for c in mesh.cells if c.type == kind for row in plain(c.data)]


def data_of(mesh, kind, name):
    return [x for c, d in zip(mesh.cells, mesh.cell_data[name]) if c.type == kind for x in plain(d)]


def flat(column):
    return [x[0] if isinstance(x, list) else x for x in column]


def meshio_medit(mesh, truth):
    same("hexes", cells_of(mesh, "hexahedron"), truth.hexes)
    same("references", data_of(mesh, "hexahedron", "medit:ref"), [b + 1 for b in truth.block])
    same("quads", cells_of(mesh, "quad"), truth.quads)
    same("surfaces", data_of(mesh, "quad", "medit:ref"), [s + 1 for s in truth.surface])
    same("edges", cells_of(mesh, "line"), [e[:2] for e in truth.edges])
    same("held", mesh.point_data["medit:ref"], truth.held)


def meshio_vtk(mesh, truth):
    same("hexes", cells_of(mesh, "hexahedron"), truth.hexes)
    data = {name: data_of(mesh, "hexahedron", name) for name in ("block", "ijk", "scaled_jacobian")}
    block, jacobian, held = (flat(x) for x in (data["block"], data["scaled_jacobian"], plain(mesh.point_data["held"])))
    arrays(truth, truth.points, block, data["ijk"], jacobian, held)


def meshio_msh(mesh, truth):
    block = [truth.block[h] if truth.block[h] >= 0 else truth.no_block for h in truth.by_block]
    same("hexes", cells_of(mesh, "hexahedron"), [truth.hexes[h] for h in truth.by_block])
    for name in ("gmsh:physical", "gmsh:geometrical"):
        same(name, data_of(mesh, "hexahedron", name), [b + 1 for b in block])
    order = sorted(range(len(truth.quads)), key=lambda q: (truth.surface[q], q))
    same("quads", cells_of(mesh, "quad"), [truth.quads[q] for q in order])
    same("surfaces", data_of(mesh, "quad", "gmsh:physical"), [truth.surface[q] + 1 for q in order])
    same("edges", sorted(map(tuple, cells_of(mesh, "line"))), sorted(tuple(e[:2]) for e in truth.edges))
    same("points", sorted(x[0] for x in cells_of(mesh, "vertex")), [v for v, held in enumerate(truth.held) if held == 0])
    for name, (tag, dimension) in mesh.field_data.items():
        if dimension == 3:
            expect(name == f"block {tag - 1}" or name == "no block" and tag == truth.no_block + 1, f"name of a volume: {name}")
        if dimension == 2:
            expect(name == f"surface {tag - 1}", f"name of a surface: {name}")


def meshio_inp(mesh, truth):
    same("hexes", cells_of(mesh, "hexahedron"), truth.hexes)
    sets = {name: [i for part in parts if part is not None for i in plain(part)] for name, parts in mesh.cell_sets.items()}
    for block in set(truth.block):
        name = f"BLOCK_{block}" if block >= 0 else "BLOCK_NONE"
        same(name, sets[name], [h for h, b in enumerate(truth.block) if b == block])
    for surface in set(truth.surface):
        nodes = {v for q, s in zip(truth.quads, truth.surface) if s == surface for v in q}
        same(f"nodes of surface {surface}", sorted(plain(mesh.point_sets[f"SURFACE_{surface}"])), sorted(nodes))


def abaqus_surfaces(path, truth):
    """meshio passes over surfaces: pairs of an element and the number of a face of C3D8."""
    corner = {"S1": (0, 1, 2, 3), "S2": (4, 7, 6, 5), "S3": (0, 4, 5, 1), "S4": (1, 5, 6, 2), "S5": (2, 6, 7, 3), "S6": (3, 7, 4, 0)}
    surfaces, current = {}, None
    for line in open(path):
        if line.startswith("*"):
            current = int(line.rsplit("_", 1)[1]) if line.startswith("*SURFACE") else None
        elif current is not None:
            element, face = line.split(",")
            surfaces.setdefault(current, []).append(sorted(truth.hexes[int(element) - 1][c] for c in corner[face.strip()]))
    for surface in set(truth.surface):
        quads = [sorted(q) for q, s in zip(truth.quads, truth.surface) if s == surface]
        same(f"surface {surface}", sorted(surfaces[surface]), sorted(quads))


def run_meshio(path, truth):
    import meshio
    extension = path.rsplit(".", 1)[1]
    judge = {"mesh": meshio_medit, "vtk": meshio_vtk, "vtu": meshio_vtk, "msh": meshio_msh, "inp": meshio_inp}.get(extension)
    if not judge:
        return False
    mesh = meshio.read(path)
    same("points", mesh.points, truth.points)
    positive(plain(mesh.points), cells_of(mesh, "hexahedron"))
    judge(mesh, truth)
    if extension == "inp":
        abaqus_surfaces(path, truth)
    return True


# ---- VTK

def run_vtk(path, truth):
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOLegacy import vtkUnstructuredGridReader
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader
    make = {"vtk": vtkUnstructuredGridReader, "vtu": vtkXMLUnstructuredGridReader}.get(path.rsplit(".", 1)[1])
    if not make:
        return False
    reader = make()
    reader.SetFileName(path)
    reader.Update()
    expect(reader.GetErrorCode() == 0, "VTK reports an error")
    grid = reader.GetOutput()
    points = plain(vtk_to_numpy(grid.GetPoints().GetData()))
    same("points", points, truth.points)
    hexes = []
    for h in range(grid.GetNumberOfCells()):
        cell = grid.GetCell(h)
        expect(cell.GetCellType() == 12, "a cell is no hexahedron")
        hexes.append([cell.GetPointId(i) for i in range(8)])
    same("hexes", hexes, truth.hexes)
    positive(points, hexes)
    data = {name: plain(vtk_to_numpy(grid.GetCellData().GetArray(name))) for name in ("block", "ijk", "scaled_jacobian")}
    arrays(truth, points, data["block"], data["ijk"], data["scaled_jacobian"], vtk_to_numpy(grid.GetPointData().GetArray("held")))
    return True


# ---- Gmsh: converts to its binary version 2, which keeps every bit

def msh2(data):
    at = data.index(b"$Nodes\n") + 7
    end = data.index(b"\n", at)
    count, at = int(data[at:end]), end + 1
    points, number = [], {}
    for i in range(count):
        tag, *xyz = struct.unpack_from("<i3d", data, at)
        number[tag] = i
        points.append((tag, xyz))
        at += 28
    at = data.index(b"$Elements\n", at) + 10
    end = data.index(b"\n", at)
    count, at = int(data[at:end]), end + 1
    size, elements = {15: 1, 1: 2, 3: 4, 5: 8}, []
    while len(elements) < count:
        kind, following, tags = struct.unpack_from("<3i", data, at)
        at += 12
        for _ in range(following):
            row = struct.unpack_from(f"<{1 + tags + size[kind]}i", data, at)
            at += 4 * len(row)
            elements.append((kind, row[0], row[1:1 + tags], row[1 + tags:]))
    return points, elements


def run_gmsh(path, truth):
    extension = path.rsplit(".", 1)[1]
    if extension not in ("msh", "mesh"):
        return False
    with tempfile.TemporaryDirectory() as folder:
        out = os.path.join(folder, "out.msh")
        every = ["-save_all"] if extension == "mesh" else []  # of a file without physical groups it saves nothing else
        done = subprocess.run(["gmsh", path, *every, "-save", "-format", "msh2", "-bin", "-o", out, "-v", "2"], capture_output=True, text=True)
        expect(done.returncode == 0 and "Error" not in done.stderr + done.stdout, done.stderr + done.stdout)
        points, elements = msh2(open(out, "rb").read())
    at = dict(points)  # Gmsh may number nodes anew, so positions are compared wherever a node is used
    same("points", sorted(at.values()), sorted(truth.points))
    hexes = [e for e in elements if e[0] == 5]
    order = truth.by_block if extension == "msh" else truth.by_reference  # it groups elements by volume, and numbers them anew
    same("hexes", [[at[v] for v in e[3]] for e in hexes], [[truth.points[v] for v in truth.hexes[h]] for h in order])
    positive(at, [e[3] for e in hexes])
    if extension == "msh":
        block = [truth.block[h] if truth.block[h] >= 0 else truth.no_block for h in order]
        same("volumes", [e[2][1] for e in hexes], [b + 1 for b in block])
        same("groups", [e[2][0] for e in hexes], [b + 1 for b in block])
        quads = [e for e in elements if e[0] == 3]
        order = sorted(range(len(truth.quads)), key=lambda q: (truth.surface[q], q))
        same("quads", [[at[v] for v in e[3]] for e in quads], [[truth.points[v] for v in truth.quads[q]] for q in order])
        same("surfaces", [e[2][1] for e in quads], [truth.surface[q] + 1 for q in order])
    return True


# ---- CGNS: VTK's reader, and the tool that checks files against the standard

def run_cgns(path, truth):
    if not path.endswith(".cgns"):
        return False
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOCGNSReader import vtkCGNSReader
    reader = vtkCGNSReader()
    reader.SetFileName(path)
    reader.UpdateInformation()
    reader.EnableAllBases()
    reader.Update()
    expect(reader.GetErrorCode() == 0 and reader.GetOutput().GetNumberOfBlocks() == 1, "VTK reports an error")
    base = reader.GetOutput().GetBlock(0)
    shapes = {}  # of every block: corners of its hexes by place
    for hex, block, ijk in zip(truth.hexes, truth.block, truth.ijk):
        shapes.setdefault(block, {})[tuple(ijk)] = [truth.points[v] for v in hex]
    if min(truth.block) < 0:
        expect(base.GetNumberOfBlocks() == 1, "one zone")
        grid = base.GetBlock(0)
        points = plain(vtk_to_numpy(grid.GetPoints().GetData()))
        same("points", points, truth.points)
        hexes = [[grid.GetCell(c).GetPointId(i) for i in range(8)] for c in range(grid.GetNumberOfCells()) if grid.GetCellType(c) == 12]
        same("hexes", hexes, truth.hexes)
        positive(points, hexes)
        return True
    expect(base.GetNumberOfBlocks() == len(shapes), "number of zones")
    for zone, block in enumerate(sorted(shapes)):
        grid, shape = base.GetBlock(zone), shapes[block]
        points, n = plain(vtk_to_numpy(grid.GetPoints().GetData())), grid.GetDimensions()
        expect(len(shape) == (n[0] - 1) * (n[1] - 1) * (n[2] - 1), f"size of block {block}")
        for (i, j, k), corners in shape.items():
            at = [i + a + n[0] * (j + b + n[1] * (k + c)) for c in (0, 1) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
            same(f"hex {i} {j} {k} of block {block}", [points[p] for p in at], corners)
            expect(scaled_jacobian(points, at) > 0, "a hex is not positive")
    return True


def run_cgnscheck(path, truth):
    if not path.endswith(".cgns"):
        return False
    done = subprocess.run(["cgnscheck", path], capture_output=True, text=True)
    faults = [line for line in done.stdout.split("\n") if line.startswith(("ERROR", "WARNING"))]
    expect(done.returncode == 0 and not faults, "; ".join(faults) or done.stderr)
    return True


# ---- OpenVolumeMesh: what its kernel for hexahedral meshes asks of a file

def run_ovm(path, truth):
    if not path.endswith(".ovm"):
        return False
    lines = iter(open(path).read().split("\n"))

    def section(title, number):
        expect(next(lines) == title, f"{title} expected")
        return [[number(x) for x in next(lines).split()] for _ in range(int(next(lines)))]

    expect(next(lines) == "OVM ASCII", "header")
    same("points", section("Vertices", float), truth.points)
    edges, faces, cells = section("Edges", int), section("Faces", int), section("Polyhedra", int)
    expect(len({tuple(sorted(e)) for e in edges}) == len(edges), "an edge is there twice")
    halfedge = [e[::1 - 2 * side] for e in edges for side in (0, 1)]
    halffaces, used = [], set()
    for f, (n, *walk) in enumerate(faces):
        expect(n == 4 and len(walk) == 4, "a face is no quad")
        for a, b in zip(walk, walk[1:] + walk[:1]):
            expect(halfedge[a][1] == halfedge[b][0], f"face {f} is no closed walk")
        halffaces += [[halfedge[a][0] for a in walk], [halfedge[a ^ 1][0] for a in reversed(walk)]]
    for h, (n, *six) in enumerate(cells):
        expect(n == 6 and len(six) == 6, "a cell has not six faces")
        expect(not used & set(six), f"a halfface of cell {h} is in two cells")
        used |= set(six)
        quads = [halffaces[x] for x in six]
        expect(len({v for q in quads for v in q}) == 8, f"cell {h} has not eight vertices")
        for axis in range(3):
            expect(not set(quads[2 * axis]) & set(quads[2 * axis + 1]), f"halffaces of axis {axis} of cell {h} are not opposite")
        sides = [(a, b) for q in quads for a, b in zip(q, q[1:] + q[:1])]
        expect(len(set(sides)) == 24 and all((b, a) in sides for a, b in sides), f"halffaces of cell {h} do not close")
        low = [set(quads[2 * axis]) for axis in range(3)]
        corner = [next(iter(set.intersection(*(low[k] if not c >> k & 1 else set(quads[2 * k + 1]) for k in range(3))))) for c in range(8)]
        same(f"corners of cell {h}", [corner[c] for c in (0, 1, 3, 2, 4, 5, 7, 6)], truth.hexes[h])
        p = [truth.points[v] for v in quads[0][:3]] + [truth.points[corner[1]]]
        u, v, w = ([p[j][k] - p[i][k] for k in range(3)] for i, j in ((0, 1), (1, 2), (0, 3)))
        normal = (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
        expect(sum(a * b for a, b in zip(normal, w)) > 0, f"halffaces of cell {h} do not look inwards")
    expect(next(lines) == 'CProp int "block"', "property block")
    same("block", [int(next(lines)) for _ in cells], truth.block)
    expect(next(lines) == 'VProp int "held"', "property held")
    same("held", [int(next(lines)) for _ in truth.points], truth.held)
    return True


READERS = {"meshio": (run_meshio, "meshio", None), "vtk": (run_vtk, "vtkmodules.vtkIOXML", None), "gmsh": (run_gmsh, None, "gmsh"),
           "cgns": (run_cgns, "vtkmodules.vtkIOCGNSReader", None), "cgnscheck": (run_cgnscheck, None, "cgnscheck"), "ovm": (run_ovm, None, None)}


def main():
    run, module, program = READERS[sys.argv[1]]
    if module:
        try:
            __import__(module)
        except ImportError:
            return 77
    if program and not shutil.which(program):
        return 77
    failed = read = 0
    for truth_path in sorted(glob.glob(os.path.join(sys.argv[2], "*.json"))):
        truth = Truth(truth_path)
        for path in sorted(glob.glob(truth_path[:-4] + "*")):
            try:
                if run(path, truth):
                    read += 1
                    print(f"{sys.argv[1]}: {os.path.basename(path)}: {len(truth.hexes)} hexes as written")
            except Exception as error:  # the readers raise whatever they like
                failed += 1
                print(f"{os.path.basename(path)}: {type(error).__name__}: {error}", file=sys.stderr)
    return 1 if failed or not read else 0


sys.exit(main())
