// node example.mjs hexmesh.bwh: what is in the file, block by block. An example of bwh.mjs.
import { readFile } from 'node:fs/promises';
import { BwhError, decode } from './bwh.mjs';

try {
  const mesh = await decode(await readFile(process.argv[2]));
  console.log(`${mesh.vertexCount} vertices, ${mesh.hexCount} hexes, ${mesh.parts.length} parts`);
  for (const { block, n, count } of mesh.parts)
    console.log(n[1] ? `block ${block}: ${n.join(' x ')}` : `${count} hexes one by one${block < 0 ? '' : `, of block ${block}`}`);
} catch (error) {
  console.error(error instanceof BwhError ? `${error.code}: ${error.message}` : error.message);
  process.exitCode = 3;
}
