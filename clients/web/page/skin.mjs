// What is seen of a hex mesh (as bwh.mjs decodes it) when some of its hexes are hidden, and how good they are. Knows no page and no drawing: for the worker, and for
// Node in the tests.

/** Corners of a face 2 * axis + (0 low | 1 high), counter-clockwise seen from outside a positive hex. */
export const faceCorner = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/** Bins of the histogram over -1..1, those of report.json. */
export const BINS = 20;

// ---- neighbours

function lowest(hexes, x) {
  const c = faceCorner[x % 6], h = 8 * Math.floor(x / 6);
  return Math.min(hexes[h + c[0]], hexes[h + c[1]], hexes[h + c[2]], hexes[h + c[3]]);
}

// Faces in buckets by lowest vertex: {begin: [vertex + 1], face}.
function bucketFaces({ hexes, hexCount, vertexCount }) {
  const begin = new Uint32Array(vertexCount + 1), face = new Uint32Array(6 * hexCount);
  for (let x = 0; x < face.length; x++) begin[lowest(hexes, x)]++;
  for (let v = 0, sum = 0; v <= vertexCount; v++) sum = begin[v] += sum;
  for (let x = face.length; x-- > 0;) face[--begin[lowest(hexes, x)]] = x;
  return { begin, face };
}

// The vertex across from the lowest one, and the two beside it in order: the same for both hexes of a face.
function writeKey(hexes, x, key, at) {
  const c = faceCorner[x % 6], h = 8 * Math.floor(x / 6);
  let low = 0;
  for (let i = 1; i < 4; i++) if (hexes[h + c[i]] < hexes[h + c[low]]) low = i;
  const a = hexes[h + c[low + 1 & 3]], b = hexes[h + c[low + 3 & 3]];
  key[at] = hexes[h + c[low ^ 2]], key[at + 1] = Math.min(a, b), key[at + 2] = Math.max(a, b);
}

/** [6 * hex + face]: the same face of the hex beyond it, as 6 * hex + face; -1 on the boundary. */
export function findMates(mesh) {
  const { begin, face } = bucketFaces(mesh), mate = new Int32Array(face.length).fill(-1);
  let key = new Int32Array(192);
  for (let v = 0; v < mesh.vertexCount; v++) {
    const first = begin[v], count = begin[v + 1] - first;
    if (3 * count > key.length) key = new Int32Array(6 * count);
    for (let i = 0; i < count; i++) {
      const x = face[first + i], at = 3 * i;
      writeKey(mesh.hexes, x, key, at);
      for (let j = 0; j < i; j++) {
        const y = face[first + j];
        if (mate[y] >= 0 || key[3 * j] !== key[at] || key[3 * j + 1] !== key[at + 1] || key[3 * j + 2] !== key[at + 2]) continue;
        mate[x] = y, mate[y] = x;
        break;
      }
    }
  }
  return mate;
}

// ---- quality

/** Scaled Jacobian of every hex: the least over its corners of the determinant of unit vectors along the edges there. */
export function scaledJacobians({ hexes, hexCount, positions: p }) {
  const out = new Float64Array(hexCount), e = new Float64Array(9);
  for (let h = 0; h < hexCount; h++) {
    let least = Infinity;
    for (let c = 0; c < 8; c++) {
      let lengths = 1;
      for (let k = 0; k < 3; k++) {
        const a = 3 * hexes[8 * h + c], b = 3 * hexes[8 * h + (c ^ 1 << k)];
        for (let i = 0; i < 3; i++) e[3 * k + i] = p[b + i] - p[a + i];
        lengths *= Math.sqrt(e[3 * k] * e[3 * k] + e[3 * k + 1] * e[3 * k + 1] + e[3 * k + 2] * e[3 * k + 2]);
      }
      const d = e[0] * (e[4] * e[8] - e[5] * e[7]) - e[1] * (e[3] * e[8] - e[5] * e[6]) + e[2] * (e[3] * e[7] - e[4] * e[6]);
      const mirrored = (c ^ c >> 1 ^ c >> 2) & 1; // edges lead backwards along an odd number of axes
      least = Math.min(least, lengths > 0 ? (mirrored ? -d : d) / lengths : 0);
    }
    out[h] = least;
  }
  return out;
}

export function histogramOf(quality) {
  const bins = new Array(BINS).fill(0);
  for (const q of quality) bins[Math.max(0, Math.min(BINS - 1, Math.floor((q + 1) * BINS / 2) || 0))]++;
  return bins;
}

// ---- what is hidden

/** The box around all vertices: {low, high}, three numbers each. */
export function boxOf({ positions }) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < positions.length; i++) {
    const k = i % 3, x = positions[i];
    if (x < low[k]) low[k] = x;
    if (x > high[k]) high[k] = x;
  }
  return { low, high };
}

function centre({ hexes, positions }, h, axis) {
  let sum = 0;
  for (let c = 0; c < 8; c++) sum += positions[3 * hexes[8 * h + c] + axis];
  return sum / 8;
}

/**
 * Which hexes are shown, as 0 or 1. `cut` is {by, at, below}: by 'x', 'y' or 'z' hexes whose centre is farther than the fraction `at` of the box are hidden, by 'i',
 * 'j' or 'k' the first `at` layers of every block (hexes without a place in a block stay), by '' none; and those of a scaled Jacobian of `below` or better.
 */
export function chooseHexes(mesh, quality, box, { by, at, below }) {
  const shown = new Uint8Array(mesh.hexCount).fill(1), space = 'xyz'.indexOf(by), layer = 'ijk'.indexOf(by);
  if (by && space >= 0) {
    const most = box.low[space] + at * (box.high[space] - box.low[space]);
    for (let h = 0; h < mesh.hexCount; h++) shown[h] = centre(mesh, h, space) <= most ? 1 : 0;
  } else if (by && layer >= 0) {
    for (let h = 0; h < mesh.hexCount; h++) shown[h] = mesh.ijk[3 * h + layer] < at && mesh.ijk[3 * h + layer] >= 0 ? 0 : 1;
  }
  for (let h = 0; h < mesh.hexCount; h++) if (!(quality[h] < below)) shown[h] = 0;
  return shown;
}

/** The faces (6 * hex + face) between what is shown and what is not, at most `most` of them; with `block`, of every hex, also those between blocks, for these to be pulled apart. */
export function skinOf(mate, shown, most, block = null) {
  let count = 0;
  const hidden = (x, y) => !shown[y] || (block && block[x] !== block[y]);
  const seen = x => shown[Math.floor(x / 6)] && (mate[x] < 0 || hidden(Math.floor(x / 6), Math.floor(mate[x] / 6)));
  for (let x = 0; x < mate.length; x++) count += seen(x) ? 1 : 0;
  const skin = new Uint32Array(Math.min(count, most));
  for (let x = 0, n = 0; x < mate.length && n < skin.length; x++) if (seen(x)) skin[n++] = x;
  return { skin, count };
}

/** What moves and scales a box into -1..1: {middle, size}. */
export function frameOf({ low, high }) {
  return { middle: low.map((x, k) => (x + high[k]) / 2), size: Math.max(...low.map((x, k) => (high[k] - x) / 2)) || 1 };
}

/** Four corners of each face, three numbers each, moved and scaled into -1..1. */
export function cornersOf({ hexes, positions }, box, skin) {
  const out = new Float32Array(12 * skin.length), { middle, size } = frameOf(box);
  for (let i = 0; i < skin.length; i++) {
    const c = faceCorner[skin[i] % 6], h = 8 * Math.floor(skin[i] / 6);
    for (let j = 0; j < 4; j++)
      for (let k = 0; k < 3; k++) out[12 * i + 3 * j + k] = (positions[3 * hexes[h + c[j]] + k] - middle[k]) / size;
  }
  return out;
}

/** Which way each block goes when blocks are pulled apart: block -> [x, y, z], its middle in -1..1, the mean of its hexes' corners. Hexes of no block stay. */
export function directionsOf({ hexes, hexCount, positions, block }, box) {
  const sums = new Map(), { middle, size } = frameOf(box);
  for (let h = 0; h < hexCount; h++) {
    let s = sums.get(block[h]);
    if (!s) sums.set(block[h], s = [0, 0, 0, 0]);
    s[3] += 8;
    for (let c = 0; c < 8; c++) for (let k = 0; k < 3; k++) s[k] += positions[3 * hexes[8 * h + c] + k];
  }
  return new Map([...sums].map(([b, s]) => [b, b < 0 ? [0, 0, 0] : middle.map((m, k) => (s[k] / s[3] - m) / size)]));
}
