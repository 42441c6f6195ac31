// Everything that takes long, off the page's thread: fetching, decoding, neighbours, quality, skins.
//
//     to it    {load: {url, headers} | {file}, run}   from it   {step, run} ...  {mesh: {...}, run}
//              {cut: {by, at, below, apart}, run}        {skin: {...}, run}
//                                              or        {failed: text, run}
//
// A mesh comes with its irregular edges as instances to draw, one for each block around an edge; a skin with the way each of its faces goes when blocks are pulled apart.
//
// One after the other, in the order in which they come; `run` tells the page what is still wanted.
import { decode } from './bwh.mjs';
import { irregularEdges } from './edges.mjs';
import { boxOf, chooseHexes, cornersOf, directionsOf, findMates, frameOf, histogramOf, scaledJacobians, skinOf } from './skin.mjs';

const MOST_BYTES = 2 ** 31; // of the arrays of a mesh: about 20 million hexes
const MOST_QUADS = 2e6;

let mesh, mate, quality, box, ways;

async function fetchBytes(url, headers) {
  const answer = await fetch(url, { headers });
  if (!answer.ok) throw new Error((await answer.json().catch(() => ({}))).detail || `${url}: ${answer.status} ${answer.statusText}`);
  return answer.arrayBuffer();
}

// Irregular edges: ends in -1..1 and ways of blocks, an instance for each block around an edge, and how many edges there are of each valence inside and on the boundary.
function linesOf(edges) {
  const instances = edges.flatMap(e => e.blocks.map(b => ({ ...e, way: ways.get(b) }))), { middle, size } = frameOf(box);
  const ends = new Float32Array(6 * instances.length), away = new Float32Array(3 * instances.length);
  instances.forEach(({ v, w, way }, i) => {
    away.set(way, 3 * i);
    for (let k = 0; k < 3; k++) ends[6 * i + k] = (mesh.positions[3 * v + k] - middle[k]) / size, ends[6 * i + 3 + k] = (mesh.positions[3 * w + k] - middle[k]) / size;
  });
  const valences = { inside: {}, boundary: {} };
  for (const { valence, inside } of edges) {
    const counts = inside ? valences.inside : valences.boundary;
    counts[valence] = (counts[valence] || 0) + 1;
  }
  return { ends, away, valence: instances.map(e => e.valence), inside: instances.map(e => e.inside), valences };
}

async function load({ url, headers, file }, run) {
  postMessage({ step: 'Fetching', run });
  const bytes = new Uint8Array(url ? await fetchBytes(url, headers) : await file.arrayBuffer());
  postMessage({ step: 'Decoding', run });
  mesh = await decode(bytes, { maxBytes: MOST_BYTES });
  postMessage({ step: 'Finding neighbours', run });
  mate = findMates(mesh);
  postMessage({ step: 'Measuring', run });
  quality = scaledJacobians(mesh);
  box = boxOf(mesh);
  ways = directionsOf(mesh, box);
  const lines = linesOf(irregularEdges(mesh, mate));
  const layers = [0, 0, 0];
  for (let i = 0; i < mesh.ijk.length; i++) layers[i % 3] = Math.max(layers[i % 3], mesh.ijk[i] + 1);
  let least = 1, sum = 0, notPositive = 0;
  for (const q of quality) least = Math.min(least, q), sum += q, notPositive += q > 0 ? 0 : 1;
  const blocks = new Set(mesh.parts.map(part => part.block)).size;
  postMessage({ run, mesh: { vertices: mesh.vertexCount, hexes: mesh.hexCount, blocks, layers, least, mean: sum / mesh.hexCount, notPositive, histogram: histogramOf(quality), lines } });
}

function cutOpen(cut, run) {
  const shown = chooseHexes(mesh, quality, box, cut), { skin, count } = skinOf(mate, shown, MOST_QUADS, cut.apart ? mesh.block : null);
  const corners = cornersOf(mesh, box, skin), q = Float32Array.from(skin, x => quality[Math.floor(x / 6)]);
  const block = Int32Array.from(skin, x => mesh.block[Math.floor(x / 6)]);
  const away = new Float32Array(3 * skin.length);
  block.forEach((b, i) => away.set(ways.get(b), 3 * i));
  const hexes = shown.reduce((sum, x) => sum + x, 0);
  postMessage({ run, skin: { corners, away, quality: q, block, hexes, left: count - skin.length } }, [corners.buffer, away.buffer, q.buffer, block.buffer]);
}

async function answer({ load: what, cut, run }) {
  try {
    if (what) await load(what, run);
    if (cut) cutOpen(cut, run);
  } catch (error) {
    postMessage({ failed: error.message, run });
  }
}

let last = Promise.resolve();
onmessage = ({ data }) => {
  last = last.then(() => answer(data));
};
