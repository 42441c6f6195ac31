// Decoder of hexmesh.bwh, Blockwright's compact form of a hex mesh (api/bwh.md). For browsers and Node 18 or newer, without dependencies.
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

const VERSION = 2, HEADER = 64, LATTICE_SIZE = 48, MOST_DIGITS = 15, LEAST_BITS = 1, MOST_BITS = 24, MODEL_MOST = 127, INT32_MAX = 2147483647;
const DOUBLES = 0, DECIMAL = 1, LATTICE = 2;
// No byte of a range-coded stream stands for more: a decision costs 0.0024 bits at least, a vertex takes 21 of them, a part 15, a point on the outside or a corner one.
const VERTICES_MOST = 192, PARTS_MOST = 256, POINTS_MOST = 4096;

// Models of the shape, and of the places.
const LISTED = 0, BLOCK = 1, SIZE = BLOCK + 128, KNOWN = SIZE + 3 * 128, GUESSED = KNOWN + 4 * 27, LINKED = GUESSED + 4 * 27, LINK = LINKED + 1, STEP = LINK + 8,
  CHOICE = STEP + 128, BACK = CHOICE + 64, HELD = BACK + 128, SHAPE_MODELS = HELD + 4 * 125 * 4;
const HIGH = 0, LOW = 4 * 17 * 8, SIGN = LOW + 4 * 65 * 5 * 16, NEXT = SIGN + 4 * 27, PLACE_MODELS = NEXT + 65;
const BY_NUMBER = 0, BY_FACE = 1, BY_LINE = 2, BY_LINK = 3; // how a point on the outside was guessed at
const LINKS = 8; // vertices on walls that one knows to be next to it
const CORNER_NEW = 0, CORNER_AS_BEFORE = 1, CORNER_OF_LAST = 2, CORNER_BACK = 5;

const damaged = () => new BwhError('damaged', 'the file is damaged: it contradicts itself');
const truncated = () => new BwhError('truncated', 'the file is shorter or longer than it says');

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

// ---- entropy coding

const rate = Uint32Array.from({ length: MODEL_MOST + 1 }, (_, n) => Math.floor(131072 / (2 * n + 3)));

class Coder {
  constructor(data, models) {
    this.data = data, this.at = 0, this.range = 0xffffffff, this.code = 0;
    this.zero = new Uint16Array(models).fill(1 << 15);
    this.seen = new Uint8Array(models);
    for (let i = 0; i < 5; i++) this.code = (this.code << 8 | this.byte()) >>> 0;
  }

  byte() {
    if (this.at === this.data.length) throw damaged();
    return this.data[this.at++];
  }

  normalize() {
    while (this.range < 0x1000000) {
      this.range = this.range << 8 >>> 0;
      this.code = (this.code << 8 | this.byte()) >>> 0;
    }
  }

  bit(model) {
    const zero = this.zero[model], seen = this.seen[model], bound = (this.range >>> 12) * (zero >>> 4);
    let bit = 0;
    if (this.code < bound) {
      this.range = bound;
      this.zero[model] = zero + ((65536 - zero) * rate[seen] >>> 16);
    } else {
      bit = 1;
      this.code -= bound, this.range -= bound;
      this.zero[model] = zero - (zero * rate[seen] >>> 16);
    }
    if (seen < MODEL_MOST) this.seen[model] = seen + 1;
    if (this.range < 0x1000000) this.normalize();
    return bit;
  }

  tree(model, depth) {
    let node = 1;
    for (let i = 0; i < depth; i++) node = 2 * node + this.bit(model + node);
    return node - (1 << depth);
  }

  // Up to 40 bits: nothing has more.
  number(model) {
    const bits = this.tree(model, 7);
    if (bits > 40) throw damaged();
    let value = bits ? 1 : 0;
    for (let i = 1; i < bits; i++) {
      this.range >>>= 1;
      const bit = this.code >= this.range ? 1 : 0;
      if (bit) this.code -= this.range;
      value = 2 * value + bit;
      this.normalize();
    }
    return value;
  }
}

class Bits {
  constructor(data) {
    this.data = data, this.at = 0, this.hold = 0, this.have = 0;
  }

  // 0..32 bits, the lowest first.
  take(count) {
    if (count > 16) {
      const low = this.take(16);
      return low + this.take(count - 16) * 65536;
    }
    for (; this.have < count; this.have += 8) {
      if (this.at === this.data.length) throw damaged();
      this.hold |= this.data[this.at++] << this.have;
    }
    const value = this.hold & ((1 << count) - 1);
    this.hold >>>= count, this.have -= count;
    return value;
  }
}

const unfold = (z) => z % 2 ? -Math.floor(z / 2) - 1 : z / 2;

// ---- header, parts

function readFront(bytes, maxBytes) {
  const magic = [0x89, 0x42, 0x57, 0x48, 13, 10, 26, 10];
  if (bytes.length < 8 || magic.some((b, i) => bytes[i] !== b)) throw new BwhError('not-bwh', 'this is no hexmesh.bwh');
  if (bytes.length < 12) throw truncated();
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  if (view.getUint32(8, true) !== VERSION) throw new BwhError('version', `version ${view.getUint32(8, true)} of the format; this reads ${VERSION}`);
  if (bytes.length < HEADER || view.getBigUint64(40, true) !== BigInt(bytes.length)) throw truncated();
  const kind = bytes[36], parameter = bytes[37], front = HEADER + (kind === LATTICE ? LATTICE_SIZE : 0);
  const shapeSize = view.getUint32(48, true), placesSize = view.getUint32(52, true);
  if (front + shapeSize + placesSize > bytes.length) throw truncated();
  const head = Uint8Array.from(bytes.subarray(0, front)); // slice() of a Node Buffer is no copy
  head.fill(0, 60, 64);
  if (crc32(head) !== view.getUint32(60, true) || crc32(bytes.subarray(front)) !== view.getUint32(56, true)) throw new BwhError('checksum', 'the file is damaged: a checksum is wrong');
  const most = [63, MOST_DIGITS, MOST_BITS][kind];
  if (most === undefined || parameter > most || (kind === LATTICE && parameter < LEAST_BITS) || bytes[38] || bytes[39]) throw damaged();
  const lattice = kind === LATTICE ? [0, 8, 16, 24, 32, 40].map(o => view.getFloat64(HEADER + o, true)) : [];
  if (!lattice.every((x, i) => Number.isFinite(x) && (i < 3 || x > 0))) throw damaged();
  const partCount = view.getUint32(12, true), vertexCount = Number(view.getBigUint64(16, true)), hexCount = Number(view.getBigUint64(24, true));
  if (vertexCount > INT32_MAX || hexCount > INT32_MAX || partCount > hexCount) throw damaged();
  if (vertexCount > placesSize * VERTICES_MOST || partCount > shapeSize * PARTS_MOST) throw damaged();
  if (vertexCount * 25 + hexCount * 48 + partCount * 32 > maxBytes) throw new BwhError('limit', 'the mesh would take more memory than allowed');
  const at = front + shapeSize;
  return {
    vertexCount, hexCount, partCount, subdivide: view.getUint32(32, true), kind, parameter, lattice,
    shape: new Coder(bytes.subarray(front, at), SHAPE_MODELS), places: new Coder(bytes.subarray(at, at + placesSize), PLACE_MODELS), plain: new Bits(bytes.subarray(at + placesSize)),
  };
}

// Hexes of a part, and its grid points inside and outside, or corners listed.
function countPart({ block, n }) {
  if (!n[1]) return { hexes: n[0], inside: 0, outside: 8 * n[0] };
  const hexes = n[0] * n[1] * n[2]; // exact up to 2^53, and larger beyond
  if (hexes > INT32_MAX || block < 0) throw damaged();
  const inside = (n[0] - 1) * (n[1] - 1) * (n[2] - 1);
  return { hexes, inside, outside: (n[0] + 1) * (n[1] + 1) * (n[2] + 1) - inside };
}

function readParts({ shape, partCount, vertexCount, hexCount }) {
  const parts = [];
  let block = -1, sum = 0, fresh = 0, points = 0;
  for (let i = 0; i < partCount; i++) {
    const listed = shape.bit(LISTED), n = [0, 0, 0];
    block += 1 + unfold(shape.number(BLOCK));
    if (block < -1 || block > INT32_MAX) throw damaged();
    for (let k = 0; k < (listed ? 1 : 3); k++) {
      n[k] = shape.number(SIZE + 128 * k);
      if (!n[k] || n[k] > INT32_MAX) throw damaged();
    }
    const part = { block, n, first: sum }, { hexes, inside, outside } = countPart(part);
    part.count = hexes;
    sum += hexes, fresh += inside, points += outside;
    if (sum > hexCount || fresh > vertexCount) throw damaged();
    parts.push(part);
  }
  if (sum !== hexCount || points > shape.data.length * POINTS_MOST) throw damaged();
  return parts;
}

// ---- the mesh

const f64 = new Float64Array(1), u32 = new Uint32Array(f64.buffer);
f64[0] = 1;
const WORD_LOW = u32[1] ? 0 : 1, WORD_HIGH = 1 - WORD_LOW;
const STEPS = [1, 3, 9]; // in near: near[i + 3 j + 9 k] is i, j, k steps back along the axes, -1 if it is not there

class Decoder {
  constructor(file) {
    Object.assign(this, file);
    this.parts = readParts(file);
    this.vertices = 0, this.last = -1, this.first = 0;
    this.positions = new Float64Array(3 * this.vertexCount);
    this.held = new Uint8Array(this.vertexCount);
    this.hexes = new Int32Array(8 * this.hexCount);
    this.block = new Int32Array(this.hexCount);
    this.ijk = new Int32Array(3 * this.hexCount);
    this.bits = new Uint8Array(3 * this.vertexCount); // of what was not foreseen, and its sign
    this.sign = new Uint8Array(3 * this.vertexCount);
    this.near = new Int32Array(27);
    this.seen = new Int32Array(this.vertexCount); // the last grid that has a vertex outside, from 1
    this.grids = 0;
    this.row = new Int32Array(this.vertexCount).fill(-1); // of link, -1: none
    this.link = new Int32Array(LINKS * 256).fill(-1); // vertices next to one on the outside of grids that are done
    this.rows = 0;
  }

  // ---- coordinates

  fromLine(s, k) {
    const { near, positions: p } = this, one = p[3 * near[s] + k];
    return near[2 * s] < 0 ? one : one + one - p[3 * near[2 * s] + k];
  }

  fromParallelogram(s, t, k) {
    const { near, positions: p } = this, farS = near[2 * s] >= 0, farT = near[2 * t] >= 0;
    const ps = p[3 * near[s] + k], pt = p[3 * near[t] + k], pst = p[3 * near[s + t] + k], corner = ps + pt - pst;
    let error = 0;
    if (farS) {
      const e = ps - p[3 * near[2 * s] + k] - pst + p[3 * near[2 * s + t] + k];
      error = e + e;
    }
    if (farT) {
      const e = pt - pst - p[3 * near[2 * t] + k] + p[3 * near[s + 2 * t] + k];
      error = error + e + e;
    }
    if (farS && farT) error = error - (pst - p[3 * near[2 * s + t] + k] - p[3 * near[s + 2 * t] + k] + p[3 * near[2 * s + 2 * t] + k]);
    return Math.abs(error) < 1e-300 ? corner : corner + 0.25 * error;
  }

  foresee(axes, k) {
    const { near, positions: p } = this;
    let x;
    switch (axes) {
      case 0: x = this.vertices ? p[3 * this.vertices - 3 + k] : 0; break;
      case 1: x = this.fromLine(1, k); break;
      case 2: x = this.fromLine(3, k); break;
      case 4: x = this.fromLine(9, k); break;
      case 3: x = this.fromParallelogram(1, 3, k); break;
      case 5: x = this.fromParallelogram(1, 9, k); break;
      case 6: x = this.fromParallelogram(3, 9, k); break;
      default: x = p[3 * near[1] + k] + p[3 * near[3] + k] + p[3 * near[9] + k] - p[3 * near[4] + k] - p[3 * near[10] + k] - p[3 * near[12] + k] + p[3 * near[13] + k];
    }
    return Number.isFinite(x) ? x : 0;
  }

  // What was not foreseen: its magnitude is sizeHigh 2^32 + sizeLow. true if it is negative.
  takeRest(group, expected, signs, to) {
    const c = this.places;
    const high = Math.min(c.tree(HIGH + (group * 17 + (expected >>> 2)) * 8, 3), 4); // no writer has more
    const bits = Math.min(16 * high + c.tree(LOW + ((group * 65 + expected) * 5 + high) * 16, 4), 64);
    this.bits[to] = bits, this.sign[to] = 0;
    this.sizeHigh = 0, this.sizeLow = bits === 1 ? 1 : 0;
    if (!bits) return false;
    const negative = c.bit(SIGN + group * 27 + signs);
    this.sign[to] = negative ? 2 : 1;
    if (bits > 1) {
      const top = 2 + c.bit(NEXT + bits), below = bits - 2, low = this.plain.take(Math.min(below, 32));
      if (below < 32) {
        const size = top * 2 ** below + low;
        this.sizeLow = size >>> 0, this.sizeHigh = Math.floor(size / 4294967296);
      } else {
        this.sizeLow = low, this.sizeHigh = top * 2 ** (below - 32) + this.plain.take(below - 32);
      }
    }
    return negative === 1;
  }

  // Doubles in their order as unsigned integers without low bits, moved by the rest.
  moveDouble(foreseen, negative) {
    const drop = this.parameter;
    f64[0] = foreseen;
    let low = u32[WORD_LOW], high = u32[WORD_HIGH];
    if (high >>> 31) low = ~low >>> 0, high = ~high >>> 0;
    else high = (high ^ 0x80000000) >>> 0;
    if (drop >= 32) low = high >>> (drop - 32), high = 0;
    else if (drop) low = (low >>> drop | high << (32 - drop)) >>> 0, high >>>= drop;
    if (negative) {
      const borrow = low < this.sizeLow ? 1 : 0;
      low = low - this.sizeLow >>> 0, high = high - this.sizeHigh - borrow >>> 0;
    } else {
      const sum = low + this.sizeLow;
      low = sum >>> 0, high = high + this.sizeHigh + (sum > 0xffffffff ? 1 : 0) >>> 0;
    }
    if (drop >= 32) high = low << (drop - 32) >>> 0, low = 0;
    else if (drop) high = (high << drop | low >>> (32 - drop)) >>> 0, low = low << drop >>> 0;
    if (high >>> 31) {
      high ^= 0x80000000;
    } else { // low bits of a negative number are dropped as zeros
      if (drop >= 32) low = 0xffffffff, high |= drop > 32 ? 2 ** (drop - 32) - 1 : 0;
      else if (drop) low |= 2 ** drop - 1;
      low = ~low, high = ~high;
    }
    u32[WORD_LOW] = low, u32[WORD_HIGH] = high;
    if (!Number.isFinite(f64[0])) throw damaged();
    return f64[0];
  }

  takeValue(axes, k) {
    const { near, bits, sign } = this, to = 3 * this.vertices + k;
    let group = 0, expected = 0, signs = 0;
    for (let a = 0; a < 3; a++)
      if (axes >> a & 1) {
        const u = 3 * near[STEPS[a]] + k;
        group++, expected += bits[u], signs = 3 * signs + sign[u];
      }
    const foreseen = this.foresee(axes, k), negative = this.takeRest(group, group ? Math.floor(expected / group) : 0, signs, to);
    if (this.kind === DOUBLES) {
      this.positions[to] = this.moveDouble(foreseen, negative);
      return;
    }
    const size = this.sizeHigh * 4294967296 + this.sizeLow;
    if (size > 2 ** 50) throw damaged();
    const value = Math.floor(foreseen + 0.5) + (negative ? -size : size);
    if (this.kind === LATTICE ? value < 0 || value >= 2 ** this.parameter : Math.abs(value) > 2 ** 44) throw damaged();
    this.positions[to] = value;
  }

  // The next vertex. ends: axes along which it is at an end of its block.
  takeVertex(axes, ends) {
    const { near, held } = this;
    if (this.vertices === this.vertexCount) throw damaged();
    let context = ends;
    for (let k = 0; k < 3; k++) context = 5 * context + (axes >> k & 1 ? held[near[STEPS[k]]] : 4);
    held[this.vertices] = this.shape.tree(HELD + 4 * context, 2);
    for (let k = 0; k < 3; k++) this.takeValue(axes, k);
    this.vertices++;
  }

  // From what was coded to coordinates.
  finishPositions() {
    const { positions: p, kind, lattice } = this;
    if (kind === DOUBLES) return;
    let scale = 1;
    for (let i = 0; i < this.parameter && kind === DECIMAL; i++) scale *= 10;
    for (let i = 0; i < p.length; i++) {
      p[i] = kind === DECIMAL ? p[i] / scale : lattice[i % 3] + p[i] * lattice[3 + i % 3];
      if (!Number.isFinite(p[i])) throw damaged();
    }
  }

  // ---- blocks

  addLink(from, to) {
    if (this.row[from] < 0) {
      if (LINKS * this.rows === this.link.length) {
        const more = new Int32Array(2 * this.link.length).fill(-1);
        more.set(this.link);
        this.link = more;
      }
      this.row[from] = this.rows++;
    }
    for (let i = LINKS * this.row[from], end = i + LINKS; i < end && this.link[i] !== to; i++)
      if (this.link[i] < 0) {
        this.link[i] = to;
        break;
      }
  }

  // The first vertex next to u that is not yet in the grid and is as it should be; -1: none.
  findLink(u, good) {
    const { row, link, seen, grids } = this;
    if (row[u] < 0) return -1;
    for (let i = LINKS * row[u], end = i + LINKS; i < end && link[i] >= 0; i++)
      if (seen[link[i]] !== grids && good(link[i])) return link[i];
    return -1;
  }

  areLinked(from, to) {
    const { row, link } = this;
    if (row[from] < 0) return false;
    for (let i = LINKS * row[from], end = i + LINKS; i < end && link[i] >= 0; i++)
      if (link[i] === to) return true;
    return false;
  }

  // Is there a vertex next to both t and v, besides u?
  shareFace(t, u, v) {
    const { row, link } = this;
    if (row[v] < 0) return false;
    for (let i = LINKS * row[v], end = i + LINKS; i < end && link[i] >= 0; i++)
      if (link[i] !== u && this.areLinked(t, link[i])) return true;
    return false;
  }

  // What number a point on the outside would have if numbers went on as they do beside it.
  nextNumber(grid, step, n, x, at) {
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

  // What a point on the outside may be; this.kindOfGuess says how that is known, this.beside is an older vertex next to it, -1: none.
  guess(grid, step, n, x, at) {
    const { first } = this, end = [0, 1, 2].map(k => x[k] === 0 || x[k] === n[k]);
    const older = [0, 1, 2].map(k => x[k] > 0 && (end[(k + 1) % 3] || end[(k + 2) % 3]) && grid[at - step[k]] < first);
    const k0 = older.indexOf(true);
    let to = -1;
    this.beside = k0 < 0 ? -1 : grid[at - step[k0]];
    this.kindOfGuess = BY_FACE;
    for (let c = 2; c >= 0 && to < 0; c--) {
      const a = c === 0 ? 1 : 0, b = c === 2 ? 1 : 2;
      if (!older[a] || !older[b] || !end[c]) continue;
      const v = grid[at - step[b]], w = grid[at - step[a] - step[b]];
      to = this.findLink(grid[at - step[a]], y => y !== w && this.areLinked(v, y));
    }
    if (to < 0) this.kindOfGuess = BY_LINE;
    for (let k = 0; k < 3 && to < 0; k++) {
      const u = grid[at - step[k]], t = grid[at - 2 * step[k]];
      if (older[k] && x[k] >= 2 && t < first) to = this.findLink(u, y => y !== t && !this.shareFace(t, u, y));
    }
    if (to < 0) this.kindOfGuess = BY_LINK;
    if (to < 0 && this.beside >= 0) to = this.findLink(this.beside, () => true);
    if (to < 0) this.kindOfGuess = BY_NUMBER, to = this.nextNumber(grid, step, n, x, at);
    return to;
  }

  // A vertex that was not guessed.
  takeOther() {
    const { beside, row, link, shape } = this;
    if (beside >= 0 && shape.bit(LINKED)) {
      const place = shape.tree(LINK, 3);
      return row[beside] < 0 ? -1 : link[LINKS * row[beside] + place];
    }
    return this.last + 1 + unfold(shape.number(STEP));
  }

  // A grid point on the outside: its number, or -1 if it is a new vertex.
  takeGlue(grid, step, n, x, at) {
    let to = this.guess(grid, step, n, x, at), context = this.kindOfGuess;
    for (let k = 0; k < 3; k++) context = 3 * context + (!x[k] ? 0 : grid[at - step[k]] >= this.first ? 1 : 2);
    if (!this.shape.bit(KNOWN + context)) return -1;
    if (!this.shape.bit(GUESSED + context)) to = this.takeOther();
    if (to < 0 || to >= this.vertices) throw damaged();
    return this.last = to;
  }

  readBlock(part) {
    const n = part.n, row = n[0] + 1, layer = row * (n[1] + 1), step = [1, row, layer], grid = new Int32Array(layer * (n[2] + 1)), near = this.near, x = [0, 0, 0];
    let at = 0;
    this.last = -1, this.first = this.vertices, this.grids++;
    for (x[2] = 0; x[2] <= n[2]; x[2]++)
      for (x[1] = 0; x[1] <= n[1]; x[1]++)
        for (x[0] = 0; x[0] <= n[0]; x[0]++, at++) {
          let ends = 0, axes = 0;
          for (let k = 0; k < 3; k++) ends += x[k] === 0 || x[k] === n[k] ? 1 : 0, axes |= x[k] ? 1 << k : 0;
          const known = ends ? this.takeGlue(grid, step, n, x, at) : -1;
          grid[at] = known < 0 ? this.vertices : known;
          if (ends && known >= 0) this.seen[known] = this.grids;
          if (known >= 0) continue;
          const most = axes === 7 ? 1 : 2, b0 = Math.min(x[0], most), b1 = Math.min(x[1], most), b2 = Math.min(x[2], most);
          if (axes !== 7) near.fill(-1);
          for (let c = 0; c <= b2; c++)
            for (let b = 0; b <= b1; b++)
              for (let a = 0; a <= b0; a++) near[a + 3 * b + 9 * c] = grid[at - a - b * row - c * layer];
          this.takeVertex(axes, ends);
          if (ends) this.seen[grid[at]] = this.grids;
        }
    this.addLinks(n, grid, step);
    this.putHexes(part, grid, row, layer);
  }

  // Edges of a grid on its outside.
  addLinks(n, grid, step) {
    const x = [0, 0, 0];
    let at = 0;
    for (x[2] = 0; x[2] <= n[2]; x[2]++)
      for (x[1] = 0; x[1] <= n[1]; x[1]++)
        for (x[0] = 0; x[0] <= n[0]; x[0]++, at++)
          for (let k = 0; k < 3; k++) {
            const i = (k + 1) % 3, j = (k + 2) % 3;
            if (!x[k] || (x[i] > 0 && x[i] < n[i] && x[j] > 0 && x[j] < n[j])) continue;
            this.addLink(grid[at - step[k]], grid[at]);
            this.addLink(grid[at], grid[at - step[k]]);
          }
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

  // ---- hexes one by one

  // A corner that is there. before: the hex before; back: how far back its corners were.
  takeCorner(choice, c, before, back) {
    let number = -1;
    if (choice === CORNER_AS_BEFORE) number = back[c] ? this.vertices - back[c] : -1;
    else if (choice < CORNER_BACK) number = before < 0 ? -1 : this.hexes[before + (c ^ 1 << (choice - CORNER_OF_LAST))];
    else if (choice === CORNER_BACK) number = this.vertices - this.shape.number(BACK);
    if (number < 0 || number >= this.vertices) throw damaged();
    return number;
  }

  takeHex(at, before, back, backNow) {
    const { hexes, near } = this;
    for (let c = 0; c < 8; c++) {
      const choice = this.shape.tree(CHOICE + 8 * c, 3);
      if (choice !== CORNER_NEW) {
        hexes[at + c] = this.takeCorner(choice, c, before, back);
        backNow[c] = this.vertices - hexes[at + c];
        continue;
      }
      near.fill(-1);
      for (let m = 1; m < 8; m++)
        if ((m & c) === m) near[(m & 1) + (m & 2 ? 3 : 0) + (m & 4 ? 9 : 0)] = hexes[at + (c ^ m)];
      hexes[at + c] = this.vertices, backNow[c] = 0;
      this.takeVertex(c, 3);
    }
  }

  readListed({ block, first, count }) {
    const back = [new Int32Array(8), new Int32Array(8)];
    for (let i = 0; i < count; i++) {
      const h = first + i;
      this.takeHex(8 * h, i ? 8 * h - 8 : -1, back[i & 1], back[~i & 1]);
      this.block[h] = block;
      this.ijk.fill(-1, 3 * h, 3 * h + 3);
    }
  }

  read() {
    for (const part of this.parts) part.n[1] ? this.readBlock(part) : this.readListed(part);
    const { shape, places, plain } = this;
    if (this.vertices !== this.vertexCount || shape.at !== shape.data.length || places.at !== places.data.length || plain.at !== plain.data.length || plain.hold) throw damaged();
    this.finishPositions();
  }
}

/**
 * Decodes a file (Uint8Array). maxBytes: for all arrays of the mesh together (decoding takes about as much again); some files unfold to thousands of times their size, so
 * decode what strangers send with a limit. Throws BwhError for anything that is no such file.
 *
 * Gives {vertexCount, hexCount, subdivide, step: largest step of the lattice that positions are on (0: lossless), positions: Float64Array (3 per vertex),
 * held: Uint8Array (on 0 a point, 1 a curve, 2 the surface, 3 nothing),
 * hexes: Int32Array (8 per hex), block: Int32Array (-1: not known), ijk: Int32Array (3 per hex, -1 where hexes are listed one by one),
 * parts: [{block, n, first, count}]}.
 */
export async function decode(bytes, { maxBytes = Infinity } = {}) {
  const d = new Decoder(readFront(bytes, maxBytes));
  d.read();
  const { vertexCount, hexCount, subdivide, positions, held, hexes, block, ijk, parts, lattice } = d;
  return { vertexCount, hexCount, subdivide, step: Math.max(0, ...lattice.slice(3)), positions, held, hexes, block, ijk, parts };
}
