// What clients/web/page/skin.mjs finds in files of hex meshes, one line per file: node skin_test.mjs FILE.bwh ...
import { readFile } from 'node:fs/promises';
import { decode } from '../../../clients/decode/bwh.mjs';
import { irregularEdges } from '../../../clients/web/page/edges.mjs';
import { boxOf, chooseHexes, cornersOf, findMates, histogramOf, scaledJacobians, skinOf } from '../../../clients/web/page/skin.mjs';

const VALENCES = 12; // of report.json: the last for that many or more

for (const file of process.argv.slice(2)) {
  const mesh = await decode(await readFile(file)), mate = findMates(mesh), quality = scaledJacobians(mesh), box = boxOf(mesh);
  const faces = cut => skinOf(mate, chooseHexes(mesh, quality, box, { by: '', at: 0, below: Infinity, ...cut }), Infinity).skin;
  // A mate's mate is the face itself, and both have the same vertices.
  for (let x = 0; x < mate.length; x++) if (mate[x] >= 0 && mate[mate[x]] !== x) throw new Error(`${file}: face ${x} and its mate disagree`);
  const all = faces({}), corners = cornersOf(mesh, box, all);
  if (!corners.every(x => Math.abs(x) <= 1)) throw new Error(`${file}: a corner is outside of -1..1`);
  // Hexes hidden and hexes kept have the same faces between them.
  const half = chooseHexes(mesh, quality, box, { by: 'x', at: 0.5, below: Infinity }), rest = half.map(x => 1 - x);
  const between = [half, rest].map(shown => skinOf(mate, shown, Infinity).skin.filter(x => mate[x] >= 0).map(x => Math.min(x, mate[x])).sort());
  if (between[0].join() !== between[1].join()) throw new Error(`${file}: the two sides of a cut differ`);
  if (faces({ below: -Infinity }).length || faces({ by: 'x', at: -1 }).length) throw new Error(`${file}: faces of nothing`);
  // Blocks apart: both sides of the faces between them are seen as well.
  const everything = new Uint8Array(mesh.hexCount).fill(1), apart = skinOf(mate, everything, Infinity, mesh.block).skin;
  const walls = mate.reduce((sum, y, x) => sum + (y >= 0 && mesh.block[Math.floor(x / 6)] !== mesh.block[Math.floor(y / 6)] ? 1 : 0), 0);
  if (apart.length !== all.length + walls || new Set(apart).size !== apart.length) throw new Error(`${file}: ${apart.length} faces of blocks apart`);
  const edges = irregularEdges(mesh, mate), valences = inside => Array.from({ length: VALENCES }, (_, n) => edges.filter(e => e.inside === inside && Math.min(e.valence, VALENCES - 1) === n).length);
  if (edges.some(e => !e.blocks.length || e.blocks.length > e.valence)) throw new Error(`${file}: blocks around an edge`);
  const counts = 'ijk'.split('').map(by => chooseHexes(mesh, quality, box, { by, at: 1, below: Infinity }).reduce((a, b) => a + b));
  console.log([all.length, ...counts, Math.min(...quality), ...histogramOf(quality), ...valences(true), ...valences(false)].join(' '));
}
