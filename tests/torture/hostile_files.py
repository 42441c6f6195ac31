"""Files that are to do harm to who reads them: the fuzzers' corpus, and the examples of all formats, damaged on purpose."""
import base64
import glob
import gzip
import os
import re
import struct
import zlib

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
MESHES = ("hexex", "vtk", "vtu", "msh", "medit", "ovm", "run")
OTHERS = ("bwh", "container", "state", "number", "report", "options", "worker_proto")  # no meshes: to be refused all the same
COUNTS = (b"-1", b"0", b"2147483647", b"2147483648", b"4294967296", b"99999999999999999999", b"1000000000")
NUMBERS = (b"nan", b"-nan", b"inf", b"1e999", b"-1e308", b"1e-999", b"0x1p3", b"1" * 5000, b"1e99999999999")


class File:
    """name, content, the file of parameters or None, options of the job."""

    def __init__(self, name, content, parameters=None, options=None):
        self.name, self.content, self.parameters, self.options = name, content, parameters, options or {}


def read(path):
    with open(path, "rb") as f:
        return f.read()


def corpus_file(kind, path):
    data, name = read(path), kind + "/" + os.path.basename(path)
    if kind == "medit":  # as fuzz_medit parts them
        mesh, mark, side = data.rpartition(b"\xff")
        return File(name, mesh if mark else data, side if mark else data)
    if kind == "run":  # as fuzz_run: the first byte is the options
        first = data[0] if data else 0
        options = {"complex": "bc" if first & 1 else "mc", "reduce": ("none", "keep-singular", "full")[(first >> 1 & 3) % 3], "repair": bool(first >> 7)}
        return File(name, data[1:], None, options)
    return File(name, data)


def corpus(kinds):
    folder = os.path.join(ROOT, "tests", "fuzz", "corpus")
    return [corpus_file(kind, path) for kind in kinds for path in sorted(glob.glob(os.path.join(folder, kind, "*")))]


# ---- damage ----

def replace_token(rng, data, pattern, words):
    found = list(re.finditer(pattern, data))
    if not found:
        return data + rng.choice(words)
    one = rng.choice(found)
    return data[:one.start()] + rng.choice(words) + data[one.end():]


def flip(rng, data):
    out = bytearray(data)
    for _ in range(rng.randrange(1, 8)):
        out[rng.randrange(len(out))] = rng.randrange(256)
    return bytes(out)


DAMAGES = (
    ("truncated", lambda rng, d: d[:rng.randrange(len(d))]),
    ("count", lambda rng, d: replace_token(rng, d, rb"\b\d+\b", COUNTS)),
    ("number", lambda rng, d: replace_token(rng, d, rb"-?\d+(\.\d+)?([eE][-+]?\d+)?", NUMBERS)),
    ("flipped", flip),
    ("doubled", lambda rng, d: d + d),
    ("nul", lambda rng, d: replace_token(rng, d, rb"\s", (b"\0", b"\0" * 70000, b"\r", b"\v"))),
    ("long line", lambda rng, d: replace_token(rng, d, rb"\s", (b" " * 3000000, b"7" * 3000000))),
    ("coded", lambda rng, d: gzip.compress(d) if rng.random() < 0.5 else gzip.compress(d)[:10] + d),
    ("spliced", lambda rng, d: d[:rng.randrange(len(d))] + d[rng.randrange(len(d)):]),
)


def vtu(points, cells, inner, attributes=""):
    return (b'<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64"%s>\n<UnstructuredGrid>'
            b'<Piece NumberOfPoints="%d" NumberOfCells="%d">%s</Piece></UnstructuredGrid></VTKFile>\n' % (attributes.encode(), points, cells, inner))


def compressed_array(blocks, block, packed):
    header = struct.pack("<QQQ", blocks, block, 0) + struct.pack("<Q", len(packed)) * min(blocks, 1)
    return (b'<Points><DataArray type="Float64" Name="Points" NumberOfComponents="3" format="binary">%s%s</DataArray></Points>'
            % (base64.b64encode(header), base64.b64encode(packed)))


def handmade():
    """What no small change of an example comes to."""
    zlib_vtu = ' compressor="vtkZLibDataCompressor"'
    bomb = zlib.compress(bytes(1 << 28), 9)
    deep = b"<Piece>" * 100000
    return [
        File("empty", b""), File("one byte", b"\n"), File("zeros", bytes(1 << 20)), File("ones", b"\xff" * (1 << 20)), File("digits", b"1 " * (1 << 20)),
        File("gzip bomb", gzip.compress(bytes(1 << 26))), File("zstd magic", b"\x28\xb5\x2f\xfd" + bytes(1000)),
        File("vtu, deep", vtu(8, 1, deep)), File("vtu, deep and closed", vtu(8, 1, deep + b"</Piece>" * 100000)),
        File("vtu, entities", b'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY x "yyyyyyyyyy">' + b"".join(
            b'<!ENTITY x%d "%s">' % (i, b"&x%d;" % (i - 1) * 10 if i else b"&x;" * 10) for i in range(20)) + b"]>" + vtu(8, 1, b"&x19;")),
        File("vtu, file entity", b'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]>' + vtu(8, 1, b"&x;")),
        File("vtu, attributes", vtu(8, 1, b"<Points" + b"".join(b' a%d="1"' % i for i in range(50000)) + b"></Points>")),
        File("vtu, zlib bomb", vtu((1 << 28) // 24, 1, compressed_array(1, 1 << 28, bomb), zlib_vtu)),
        File("vtu, zlib bomb of few points", vtu(8, 1, compressed_array(1, 192, bomb), zlib_vtu)),
        File("vtu, blocks without end", vtu(8, 1, compressed_array(1 << 60, 1 << 60, bomb[:100]), zlib_vtu)),
        File("vtu, points without end", vtu(1 << 62, 1 << 62, b"")),
        File("vtk, counts", b"# vtk DataFile Version 3.0\nx\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS 3000000000 double\n"),
        File("medit, counts", b"MeshVersionFormatted 2\nDimension 3\nVertices\n2000000000\n"),
        File("ovm, counts", b"OVM ASCII\nVertices\n4000000000\n"),
        File("msh, counts", b"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n18446744073709551615 18446744073709551615 1 1\n"),
        File("hexex, counts", b"2000000000\n"),
        File("name", b"\x1b[31m\n../../etc/passwd\r\nlevel=error event=forged\n" * 100),
    ]


def mutations(rng, count):
    folder = os.path.join(ROOT, "api", "examples", "formats")
    examples = [(n, read(os.path.join(folder, n))) for n in sorted(os.listdir(folder)) if n.startswith(("cube.", "hexes.")) and n != "cube.parameters"]
    side, files = read(os.path.join(folder, "cube.parameters")), []
    for i in range(count):
        name, data = examples[i % len(examples)]
        what, damage = DAMAGES[i // len(examples) % len(DAMAGES)]
        parameters = side if name == "cube.mesh" else None
        if parameters and rng.random() < 0.4:
            parameters = damage(rng, parameters)
        else:
            data = damage(rng, data)
        files.append(File("%s %s %d" % (name, what, i), data, parameters))
    return files
