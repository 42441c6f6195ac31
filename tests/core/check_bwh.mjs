// node check_bwh.mjs FOLDER: decodes every NAME.bwh there, compares it with NAME.json (hex_files.h), then cuts and damages it: each fault must be a BwhError with
// the code that bwh.c gives. Exit status 0 if all is as it should be.
import { readFileSync, readdirSync } from 'node:fs';
import { BwhError, decode, ring } from '../../clients/decode/bwh.mjs';

function expect(condition, what) {
  if (!condition) throw new Error(what);
}

// Hexes as strings of the bits of their corners' coordinates, with block; a set of them says all but the numbering, and shared corners are checked apart.
const bits = new DataView(new ArrayBuffer(8));
const hexText = (x) => (bits.setFloat64(0, x), bits.getBigUint64(0).toString(16));

function compare(mesh, truth) {
  expect(mesh.vertexCount === truth.points.length && mesh.hexCount === truth.hexes.length, 'counts');
  const corner = new Map(), number = new Map();
  const signature = (points, block, ijk) => `${block} ${ijk}: ${points.map(p => p.map(hexText).join(',')).join(' ')}`;
  const listed = new Set(mesh.parts.filter(p => !p.n[1]).map(p => p.block));
  truth.hexes.forEach((hex, h) => {
    const ijk = listed.has(truth.block[h]) ? [-1, -1, -1] : truth.ijk[h];
    corner.set(signature(hex.map(v => truth.points[v]), truth.block[h], ijk), hex);
  });
  expect(corner.size === truth.hexes.length, 'truth has equal hexes');
  for (let h = 0; h < mesh.hexCount; h++) {
    const hex = ring.map(c => mesh.hexes[8 * h + c]), points = hex.map(v => Array.from(mesh.positions.subarray(3 * v, 3 * v + 3)));
    const wanted = corner.get(signature(points, mesh.block[h], Array.from(mesh.ijk.subarray(3 * h, 3 * h + 3))));
    expect(wanted, `hex ${h} is not one of those written`);
    hex.forEach((v, i) => {
      if (!number.has(v)) number.set(v, wanted[i]);
      expect(number.get(v) === wanted[i], `corner ${i} of hex ${h} is another vertex`);
      expect(mesh.held[v] === truth.held[wanted[i]], `held of vertex ${v}`);
    });
  }
  expect(new Set(number.values()).size === truth.points.length, 'vertices are one to one');
}

function comparePoints(mesh, truth) {
  const got = Array.from({ length: mesh.vertexCount }, (_, v) => Array.from(mesh.positions.subarray(3 * v, 3 * v + 3)).map(hexText).join(' '));
  const wanted = truth.points.map(p => p.map(hexText).join(' '));
  expect(got.sort().join('\n') === wanted.sort().join('\n'), 'positions');
}

async function codeOf(bytes, options) {
  try {
    await decode(bytes, options);
    return 'ok';
  } catch (error) {
    if (!(error instanceof BwhError)) throw error;
    return error.code;
  }
}

async function damage(bytes) {
  const partCount = new DataView(bytes.buffer, bytes.byteOffset).getUint32(12, true), front = 64 + 16 * partCount + 24 * 27;
  for (let cut = 0; cut < bytes.length; cut += cut < front ? 1 : 97)
    expect(await codeOf(bytes.subarray(0, cut)) === (cut < 8 ? 'not-bwh' : 'truncated'), `cut at ${cut}`);
  for (let at = 0; at < bytes.length; at += at < front ? 1 : 97) {
    const copy = bytes.slice();
    copy[at] ^= 0x10;
    const code = await codeOf(copy);
    if (at >= 12 && at < 16) expect(code === 'truncated' || code === 'checksum', `${code} at ${at}`);
    else expect(code === (at < 8 ? 'not-bwh' : at < 12 ? 'version' : at >= 36 && at < 40 ? 'damaged' : at >= 40 && at < 48 ? 'truncated' : 'checksum'), `${code} at ${at}`);
  }
  expect(await codeOf(bytes, { maxBytes: 1000 }) === 'limit', 'limit');
}

// ---- lies with right checksums: what fuzz_bwh.c found worth keeping, and random changes; all must decode or be refused with a code

function crc32(bytes) {
  let c = -1;
  for (const b of bytes) {
    c ^= b;
    for (let k = 0; k < 8; k++) c = c & 1 ? 0xedb88320 ^ (c >>> 1) : c >>> 1;
  }
  return ~c >>> 0;
}

// As in fuzz_bwh.c: checksums of streams, size of the file, checksum of what is before the streams.
function seal(bytes) {
  if (bytes.length < 64) return;
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  view.setBigUint64(40, BigInt(bytes.length), true);
  const front = 64 + 16 * view.getUint32(12, true) + 24 * 27;
  if (front > bytes.length) return;
  for (let row = front - 24 * 27, at = front; row < front; row += 24) {
    const stored = Number(view.getBigUint64(row + 16, true));
    if (stored > bytes.length - at) break;
    view.setUint32(row + 4, crc32(bytes.subarray(at, at + stored)), true);
    at += stored;
  }
  view.setUint32(48, 0, true);
  view.setUint32(48, crc32(bytes.subarray(0, front)), true);
}

async function lies(bytes) {
  const codes = {};
  const tell = async (copy) => {
    const code = await codeOf(copy, { maxBytes: 1 << 24 });
    codes[code] = (codes[code] ?? 0) + 1;
  };
  const corpus = new URL('../fuzz/corpus/bwh/', import.meta.url);
  for (const file of readdirSync(corpus)) {
    const [flag, ...rest] = readFileSync(new URL(file, corpus));
    const copy = Uint8Array.from(rest);
    if (flag & 1) seal(copy);
    await tell(copy);
  }
  let random = 1;
  const below = (n) => (random = (Math.imul(random, 1664525) + 1013904223) >>> 0, Math.floor(random / 2 ** 32 * n));
  for (let i = 0; i < 400; i++) {
    const copy = bytes.slice();
    for (let k = below(3); k >= 0; k--) copy[i % 2 ? 8 + below(60) : below(copy.length)] = below(256);
    seal(copy);
    await tell(copy);
  }
  expect(codes.ok > 5 && codes.damaged > 50, `too little was tried: ${JSON.stringify(codes)}`);
  console.log('with right checksums:', JSON.stringify(codes));
}

const folder = process.argv[2];
let done = 0;
for (const file of readdirSync(folder).filter(f => f.endsWith('.bwh')).sort()) {
  const bytes = new Uint8Array(readFileSync(`${folder}/${file}`));
  const text = readFileSync(`${folder}/${file.replace(/bwh$/, 'json')}`, 'utf8');
  const before = bytes.slice(), mesh = await decode(Buffer.from(bytes.buffer, bytes.byteOffset, bytes.length)); // a Buffer, which differs from other arrays
  expect(before.every((b, i) => b === bytes[i]), 'what is decoded stays as it is');
  if (file === 'doubles.bwh') comparePoints(mesh, JSON.parse(text)); // its positions are no shapes: many are equal
  else compare(mesh, JSON.parse(text));
  if (file === 'tee.bwh') await damage(bytes), await lies(bytes);
  console.log(`${file}: ${mesh.hexCount} hexes as written`);
  done++;
}
expect(done > 5, 'no files');
