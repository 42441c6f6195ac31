// Everything that takes long, off the page's thread: fetching, decoding, neighbours, quality, skins.
//
//     to it    {load: {url} | {file}, run}     from it   {step, run} ...  {mesh: {...}, run}
//              {cut: {by, at, below}, run}               {skin: {...}, run}
//                                              or        {failed: text, run}
//
// One after the other, in the order in which they come; `run` tells the page what is still wanted.
import { decode } from './bwh.mjs';
import { boxOf, chooseHexes, cornersOf, findMates, histogramOf, scaledJacobians, skinOf } from './skin.mjs';

const MOST_BYTES = 2 ** 31; // of the arrays of a mesh: about 20 million hexes
const MOST_QUADS = 2e6;

let mesh, mate, quality, box;

async function fetchBytes(url) {
  const answer = await fetch(url);
  if (!answer.ok) throw new Error((await answer.json().catch(() => ({}))).detail || `${url}: ${answer.status} ${answer.statusText}`);
  return answer.arrayBuffer();
}

async function load({ url, file }, run) {
  postMessage({ step: 'Fetching', run });
  const bytes = new Uint8Array(url ? await fetchBytes(url) : await file.arrayBuffer());
  postMessage({ step: 'Decoding', run });
  mesh = await decode(bytes, { maxBytes: MOST_BYTES });
  postMessage({ step: 'Finding neighbours', run });
  mate = findMates(mesh);
  postMessage({ step: 'Measuring', run });
  quality = scaledJacobians(mesh);
  box = boxOf(mesh);
  const layers = [0, 0, 0];
  for (let i = 0; i < mesh.ijk.length; i++) layers[i % 3] = Math.max(layers[i % 3], mesh.ijk[i] + 1);
  let least = 1, sum = 0, notPositive = 0;
  for (const q of quality) least = Math.min(least, q), sum += q, notPositive += q > 0 ? 0 : 1;
  const blocks = new Set(mesh.parts.map(part => part.block)).size;
  postMessage({ run, mesh: { vertices: mesh.vertexCount, hexes: mesh.hexCount, blocks, layers, least, mean: sum / mesh.hexCount, notPositive, histogram: histogramOf(quality) } });
}

function cutOpen(cut, run) {
  const shown = chooseHexes(mesh, quality, box, cut), { skin, count } = skinOf(mate, shown, MOST_QUADS);
  const corners = cornersOf(mesh, box, skin), q = Float32Array.from(skin, x => quality[Math.floor(x / 6)]);
  const block = Int32Array.from(skin, x => mesh.block[Math.floor(x / 6)]);
  const hexes = shown.reduce((sum, x) => sum + x, 0);
  postMessage({ run, skin: { corners, quality: q, block, hexes, left: count - skin.length } }, [corners.buffer, q.buffer, block.buffer]);
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
