// Decoder of hexmesh.bwh, Blockwright's compact form of a hex mesh (api/bwh.md). For browsers and Node 18 or newer, without dependencies: streams are
// inflated by DecompressionStream.
//
//     import { decode, ring } from './bwh.mjs';
//     const mesh = await decode(new Uint8Array(await (await fetch('hexmesh.bwh')).arrayBuffer()));
//     mesh.hexes[8 * h + ring[i]]
//
// Corners of a hex are numbered by bits: bit k set is the high end of axis k; a positive hex has axes 0, 1, 2 right-handed. VTK and others want the order
// `ring` instead.

/** What is wrong with a file; `code` is one of not-bwh, version, truncated, checksum, damaged, limit. */
export class BwhError extends Error {
  constructor(code, text) {
    super(text);
    this.name = 'BwhError';
    this.code = code;
  }
}

export const ring = [0, 1, 3, 2, 4, 5, 7, 6];

const VERSION = 1, HEADER = 64, PART = 16, STREAM = 24, STREAMS = 27, GLUE = 0, CORNERS = 1, HELD = 2, COORDINATES = 3;
const DEFLATE_MOST = 1032, INT32_MAX = 2147483647;

const damaged = () => new BwhError('damaged', 'the file is damaged: it contradicts itself');
const truncated = () => new BwhError('truncated', 'the file is shorter or longer than it says');

// ---- checksums

const crcTable = Array.from({ length: 8 }, () => new Uint32Array(256));
for (let i = 0; i < 256; i++) {
  let c = i;
  for (let k = 0; k < 8; k++) c = c & 1 ? 0xedb88320 ^ (c >>> 1) : c >>> 1;
  crcTable[0][i] = c;
}
for (let i = 0; i < 256; i++)
  for (let t = 1; t < 8; t++) crcTable[t][i] = crcTable[0][crcTable[t - 1][i] & 255] ^ (crcTable[t - 1][i] >>> 8);

function crc32(bytes) {
  const [t0, t1, t2, t3, t4, t5, t6, t7] = crcTable;
  let c = -1, i = 0;
  for (; i + 8 <= bytes.length; i += 8) {
    c ^= bytes[i] | bytes[i + 1] << 8 | bytes[i + 2] << 16 | bytes[i + 3] << 24;
    c = t7[c & 255] ^ t6[c >>> 8 & 255] ^ t5[c >>> 16 & 255] ^ t4[c >>> 24] ^ t3[bytes[i + 4]] ^ t2[bytes[i + 5]] ^ t1[bytes[i + 6]] ^ t0[bytes[i + 7]];
  }
  for (; i < bytes.length; i++) c = t0[(c ^ bytes[i]) & 255] ^ (c >>> 8);
  return ~c >>> 0;
}

// ---- header, parts, directory

// Hexes of a part, and its grid points inside and outside, or corners listed.
function countPart({ block, n }) {
  if (!n[0] || n[0] > INT32_MAX || !n[1] !== !n[2] || block < -1) throw damaged();
  if (!n[1]) return { hexes: n[0], inside: 0, outside: 0, corners: 8 * n[0] };
  const hexes = n[0] * n[1] * n[2]; // exact up to 2^53, and larger beyond
  if (hexes > INT32_MAX || block < 0) throw damaged();
  const inside = (n[0] - 1) * (n[1] - 1) * (n[2] - 1);
  return { hexes, inside, outside: (n[0] + 1) * (n[1] + 1) * (n[2] + 1) - inside, corners: 0 };
}

function readParts(view, count, file) {
  let fresh = 0;
  for (let i = 0; i < count; i++) {
    const at = HEADER + PART * i;
    const part = { block: view.getInt32(at, true), n: [4, 8, 12].map(o => view.getUint32(at + o, true)), first: file.listed };
    const found = countPart(part);
    part.count = found.hexes;
    file.listed += found.hexes, fresh += found.inside, file.glueCount += found.outside, file.cornerCount += found.corners;
    if (file.listed > INT32_MAX || fresh > file.vertexCount) throw damaged();
    file.parts.push(part);
  }
  if (file.listed !== file.hexCount) throw damaged();
}

function readDirectory(view, bytes, at, file) {
  let data = at + STREAM * STREAMS;
  for (let s = 0; s < STREAMS; s++, at += STREAM) {
    const method = view.getUint32(at, true), crc = view.getUint32(at + 4, true);
    const size = Number(view.getBigUint64(at + 8, true)), stored = Number(view.getBigUint64(at + 16, true));
    if (stored > bytes.length - data) throw truncated();
    const wanted = s === GLUE ? 4 * file.glueCount : s === CORNERS ? 4 * file.cornerCount : file.vertexCount;
    if (size !== wanted || method > 1 || (method === 0 ? stored !== size : Math.floor(size / DEFLATE_MOST) > stored)) throw damaged();
    file.streams.push({ method, crc, size, data: bytes.subarray(data, data + stored) });
    data += stored;
  }
  if (data !== bytes.length) throw truncated();
}

function readFront(bytes, maxBytes) {
  const magic = [0x89, 0x42, 0x57, 0x48, 13, 10, 26, 10];
  if (bytes.length < 8 || magic.some((b, i) => bytes[i] !== b)) throw new BwhError('not-bwh', 'this is no hexmesh.bwh');
  if (bytes.length < 12) throw truncated();
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  if (view.getUint32(8, true) !== VERSION) throw new BwhError('version', `version ${view.getUint32(8, true)} of the format; this reads ${VERSION}`);
  if (bytes.length < HEADER || view.getBigUint64(40, true) !== BigInt(bytes.length)) throw truncated();
  const partCount = view.getUint32(12, true), front = HEADER + PART * partCount + STREAM * STREAMS;
  if (view.getUint32(36, true) !== STREAMS) throw damaged();
  if (front > bytes.length) throw truncated();
  const head = Uint8Array.from(bytes.subarray(0, front)); // slice() of a Node Buffer is no copy
  head.fill(0, 48, 52);
  if (crc32(head) !== view.getUint32(48, true)) throw new BwhError('checksum', 'the file is damaged: a checksum is wrong');
  const vertexCount = Number(view.getBigUint64(16, true)), hexCount = Number(view.getBigUint64(24, true));
  if (vertexCount > INT32_MAX || hexCount > INT32_MAX) throw damaged();
  if (vertexCount * 25 + hexCount * 48 > maxBytes) throw new BwhError('limit', 'the mesh would take more memory than allowed');
  const file = { vertexCount, hexCount, subdivide: view.getUint32(32, true), listed: 0, glueCount: 0, cornerCount: 0, parts: [], streams: [] };
  readParts(view, partCount, file);
  readDirectory(view, bytes, HEADER + PART * partCount, file);
  return file;
}

// ---- streams

async function inflate({ data, size }) {
  const out = new Uint8Array(size);
  const reader = new Blob([data]).stream().pipeThrough(new DecompressionStream('deflate')).getReader();
  let at = 0;
  try {
    for (let chunk; !(chunk = await reader.read()).done; at += chunk.value.length) out.set(chunk.value, at); // RangeError beyond size
  } catch {
    reader.cancel().catch(() => {});
    throw damaged();
  }
  if (at !== size) throw damaged();
  return out;
}

async function readStream(stream) {
  if (crc32(stream.data) !== stream.crc) throw new BwhError('checksum', 'the file is damaged: a checksum is wrong');
  return stream.method ? inflate(stream) : stream.data;
}

// ---- the mesh

const f64 = new Float64Array(1), u32 = new Uint32Array(f64.buffer);
f64[0] = 1;
const LOW = u32[1] ? 0 : 1, HIGH = 1 - LOW;

class Decoder {
  constructor(file, streams) {
    Object.assign(this, file);
    this.glue = streams[GLUE], this.corners = streams[CORNERS], this.planes = streams.slice(COORDINATES);
    this.glueAt = 0, this.cornerAt = 0, this.vertices = 0, this.last = -1;
    this.positions = new Float64Array(3 * this.vertexCount);
    this.held = Uint8Array.from(streams[HELD]);
    this.hexes = new Int32Array(8 * this.hexCount);
    this.block = new Int32Array(this.hexCount);
    this.ijk = new Int32Array(3 * this.hexCount);
    this.near = new Int32Array(8);
    if (this.held.some(x => x > 3)) throw damaged();
  }

  // The next vertex; near[m] is the neighbour at the low end of the axes in m, for all m in axes. Sums in the writer's order.
  takeVertex(axes) {
    const { near, positions: p, planes } = this, at = this.vertices;
    if (at === this.vertexCount) throw damaged();
    for (let k = 0; k < 3; k++) {
      let guess = 0;
      if (axes === 0) guess = at ? p[3 * at - 3 + k] : 0;
      else if (axes === 1 || axes === 2 || axes === 4) guess = p[3 * near[axes] + k];
      else if (axes === 3) guess = p[3 * near[1] + k] + p[3 * near[2] + k] - p[3 * near[3] + k];
      else if (axes === 5) guess = p[3 * near[1] + k] + p[3 * near[4] + k] - p[3 * near[5] + k];
      else if (axes === 6) guess = p[3 * near[2] + k] + p[3 * near[4] + k] - p[3 * near[6] + k];
      else guess = p[3 * near[1] + k] + p[3 * near[2] + k] + p[3 * near[4] + k] - p[3 * near[3] + k] - p[3 * near[5] + k] - p[3 * near[6] + k] + p[3 * near[7] + k];
      f64[0] = Number.isFinite(guess) ? guess : 0;
      let low = u32[LOW], high = u32[HIGH]; // doubles in their order as unsigned integers
      if (high >>> 31) low = ~low >>> 0, high = ~high;
      else high ^= 0x80000000;
      const b = 8 * k;
      const codeHigh = planes[b][at] << 24 | planes[b + 1][at] << 16 | planes[b + 2][at] << 8 | planes[b + 3][at];
      const codeLow = planes[b + 4][at] << 24 | planes[b + 5][at] << 16 | planes[b + 6][at] << 8 | planes[b + 7][at];
      const flip = -(codeLow & 1);
      const sum = low + (((codeLow >>> 1 | codeHigh << 31) ^ flip) >>> 0);
      low = sum >>> 0;
      high = high + ((codeHigh >>> 1) ^ flip) + (sum > 0xffffffff ? 1 : 0) | 0;
      if (high >>> 31) high ^= 0x80000000;
      else low = ~low, high = ~high;
      if ((high & 0x7ff00000) === 0x7ff00000) throw damaged();
      u32[LOW] = low, u32[HIGH] = high;
      p[3 * at + k] = f64[0];
    }
    this.vertices++;
  }

  numberAt(stream, count, i) {
    return (stream[i] << 24 | stream[count + i] << 16 | stream[2 * count + i] << 8 | stream[3 * count + i]) >>> 0;
  }

  // What number a point on the outside would have if numbers went on as they do beside it.
  guess(grid, step, n, x, at) {
    const inside = [0, 1, 2].filter(k => x[k] > 0 && x[k] < n[k]);
    let to = this.last + 1;
    if (inside.length === 2 && x[inside[0]] >= 2 && x[inside[1]] >= 2) {
      const a = step[inside[0]], b = step[inside[1]];
      to = grid[at - a] + grid[at - b] - grid[at - a - b];
    } else {
      const k = inside.find(axis => x[axis] >= 3);
      if (k !== undefined) to = 2 * grid[at - step[k]] - grid[at - 2 * step[k]];
    }
    return Math.min(Math.max(to, 0), this.vertices - 1);
  }

  // A grid point on the outside: its number, or -1 if it is a new vertex.
  takeGlue(grid, step, n, x, at) {
    const code = this.numberAt(this.glue, this.glueCount, this.glueAt++) - 1;
    if (code < 0) return -1;
    const half = Math.floor(code / 2), to = this.guess(grid, step, n, x, at) + (code % 2 ? -half - 1 : half);
    if (to < 0 || to >= this.vertices) throw damaged();
    return this.last = to;
  }

  readBlock(part) {
    const n = part.n, row = n[0] + 1, layer = row * (n[1] + 1), step = [1, row, layer], grid = new Int32Array(layer * (n[2] + 1)), near = this.near, x = [0, 0, 0];
    let at = 0;
    this.last = -1;
    for (x[2] = 0; x[2] <= n[2]; x[2]++)
      for (x[1] = 0; x[1] <= n[1]; x[1]++)
        for (x[0] = 0; x[0] <= n[0]; x[0]++, at++) {
          const outside = !x[0] || !x[1] || !x[2] || x[0] === n[0] || x[1] === n[1] || x[2] === n[2];
          const known = outside ? this.takeGlue(grid, step, n, x, at) : -1;
          grid[at] = known < 0 ? this.vertices : known;
          if (known >= 0) continue;
          const axes = (x[0] ? 1 : 0) | (x[1] ? 2 : 0) | (x[2] ? 4 : 0);
          for (let m = 1; m < 8; m++)
            if ((m & axes) === m) near[m] = grid[at - (m & 1) - (m & 2 ? row : 0) - (m & 4 ? layer : 0)];
          this.takeVertex(axes);
        }
    this.putHexes(part, grid, row, layer);
  }

  putHexes({ block, n, first }, grid, row, layer) {
    let h = first;
    for (let z = 0; z < n[2]; z++)
      for (let y = 0; y < n[1]; y++)
        for (let x = 0; x < n[0]; x++, h++) {
          const at = x + row * y + layer * z;
          for (let c = 0; c < 8; c++) this.hexes[8 * h + c] = grid[at + (c & 1) + (c & 2 ? row : 0) + (c & 4 ? layer : 0)];
          this.block[h] = block;
          this.ijk[3 * h] = x, this.ijk[3 * h + 1] = y, this.ijk[3 * h + 2] = z;
        }
  }

  readListed({ block, first, count }) {
    const { hexes, near } = this;
    for (let h = first; h < first + count; h++) {
      for (let c = 0; c < 8; c++) {
        const back = this.numberAt(this.corners, this.cornerCount, this.cornerAt++);
        if (back > this.vertices) throw damaged();
        hexes[8 * h + c] = this.vertices - back;
        if (back) continue;
        for (let m = 1; m < 8; m++)
          if ((m & c) === m) near[m] = hexes[8 * h + (c ^ m)];
        this.takeVertex(c);
      }
      this.block[h] = block;
      this.ijk.fill(-1, 3 * h, 3 * h + 3);
    }
  }
}

/**
 * Decodes a file (Uint8Array). maxBytes: for all arrays of the mesh together; a file of nothing but zeros may unfold to 13 000 times its size, so
 * decode what strangers send with a limit. Throws BwhError for anything that is no such file.
 *
 * Gives {vertexCount, hexCount, subdivide, positions: Float64Array (3 per vertex), held: Uint8Array (on 0 a point, 1 a curve, 2 the surface, 3 nothing),
 * hexes: Int32Array (8 per hex), block: Int32Array (-1: not known), ijk: Int32Array (3 per hex, -1 where hexes are listed one by one),
 * parts: [{block, n, first, count}]}.
 */
export async function decode(bytes, { maxBytes = Infinity } = {}) {
  const file = readFront(bytes, maxBytes);
  const d = new Decoder(file, await Promise.all(file.streams.map(readStream)));
  for (const part of file.parts) part.n[1] ? d.readBlock(part) : d.readListed(part);
  if (d.vertices !== d.vertexCount) throw damaged();
  const { vertexCount, hexCount, subdivide, positions, held, hexes, block, ijk, parts } = d;
  return { vertexCount, hexCount, subdivide, positions, held, hexes, block, ijk, parts };
}
