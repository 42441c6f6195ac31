// What clients/web/page/skin.mjs finds in files of hex meshes, one line per file: node skin_test.mjs FILE.bwh ...
import { readFile } from 'node:fs/promises';
import { decode } from '../../../clients/decode/bwh.mjs';
import { boxOf, chooseHexes, cornersOf, findMates, histogramOf, scaledJacobians, skinOf } from '../../../clients/web/page/skin.mjs';

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
  const counts = 'ijk'.split('').map(by => chooseHexes(mesh, quality, box, { by, at: 1, below: Infinity }).reduce((a, b) => a + b));
  console.log([all.length, ...counts, Math.min(...quality), ...histogramOf(quality)].join(' '));
}
