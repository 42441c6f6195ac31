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

// Bytes before the streams.
const frontOf = (bytes) => bytes[36] === 2 ? 112 : 64;

async function damage(bytes) {
  const front = frontOf(bytes);
  for (let cut = 0; cut < bytes.length; cut += cut < front ? 1 : 97)
    expect(await codeOf(bytes.subarray(0, cut)) === (cut < 8 ? 'not-bwh' : 'truncated'), `cut at ${cut}`);
  for (let at = 0; at < bytes.length; at += at < front ? 1 : 97) {
    const copy = bytes.slice();
    copy[at] ^= 0x10;
    const code = await codeOf(copy);
    if (at >= 48 && at < 56) expect(code === 'truncated' || code === 'checksum', `${code} at ${at}`);
    else expect(code === (at < 8 ? 'not-bwh' : at < 12 ? 'version' : at >= 40 && at < 48 ? 'truncated' : 'checksum'), `${code} at ${at}`);
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

// As in fuzz_bwh.c: size of the file, checksums.
function seal(bytes) {
  const front = frontOf(bytes);
  if (bytes.length < front) return;
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  view.setBigUint64(40, BigInt(bytes.length), true);
  view.setUint32(56, crc32(bytes.subarray(front)), true);
  view.setUint32(60, 0, true);
  view.setUint32(60, crc32(bytes.subarray(0, front)), true);
}

// As bwh.c judges the files that fuzz_bwh.c found: judged.txt has the code of each, and checksums of positions and hexes.
async function judge(folder) {
  const corpus = new URL('../fuzz/corpus/bwh/', import.meta.url);
  const crc = (array) => crc32(new Uint8Array(array.buffer)).toString(16).padStart(8, '0');
  for (const line of readFileSync(`${folder}/judged.txt`, 'utf8').trim().split('\n')) {
    const name = line.split(' ')[0], [flag, ...rest] = readFileSync(new URL(name, corpus)), copy = Uint8Array.from(rest);
    if (flag & 1) seal(copy);
    let got = `${name} ${await codeOf(copy, { maxBytes: 1 << 24 })}`;
    const mesh = got.endsWith(' ok') ? await decode(copy) : { positions: new Float64Array(0), hexes: new Int32Array(0) };
    got += ` ${crc(mesh.positions)} ${crc(mesh.hexes)}`;
    expect(got === line, `bwh.c says ${line}, bwh.mjs ${got}`);
  }
}

async function lies(bytes, codes) {
  const tell = async (copy) => {
    const code = await codeOf(copy, { maxBytes: 1 << 24 });
    codes[code] = (codes[code] ?? 0) + 1;
  };
  let random = 1;
  const below = (n) => (random = (Math.imul(random, 1664525) + 1013904223) >>> 0, Math.floor(random / 2 ** 32 * n));
  for (let i = 0; i < 2000; i++) {
    let copy = bytes.slice();
    for (let k = below(3); k >= 0; k--) copy[i % 3 === 0 ? 8 + below(frontOf(bytes) - 8) : below(copy.length)] = below(256);
    if (i % 5 === 0) copy = copy.subarray(0, below(copy.length)).slice();
    seal(copy);
    await tell(copy);
  }
  return codes;
}

const folder = process.argv[2];
const codes = {};
let done = 0;
for (const file of readdirSync(folder).filter(f => f.endsWith('.bwh')).sort()) {
  const bytes = new Uint8Array(readFileSync(`${folder}/${file}`));
  const text = readFileSync(`${folder}/${file.replace(/bwh$/, 'json')}`, 'utf8');
  const before = bytes.slice(), mesh = await decode(Buffer.from(bytes.buffer, bytes.byteOffset, bytes.length)); // a Buffer, which differs from other arrays
  expect(before.every((b, i) => b === bytes[i]), 'what is decoded stays as it is');
  if (file === 'doubles.bwh') comparePoints(mesh, JSON.parse(text)); // its positions are no shapes: many are equal
  else compare(mesh, JSON.parse(text));
  if (['tee.bwh', 'lattice-12.bwh', 'digits.bwh', 'listed.bwh'].includes(file)) await damage(bytes), await lies(bytes, codes);
  console.log(`${file}: ${mesh.hexCount} hexes as written`);
  done++;
}
expect(done > 5, 'no files');
await judge(folder);
console.log('with right checksums:', JSON.stringify(codes));
expect(codes.ok > 5 && codes.damaged > 50, 'too little was tried');
