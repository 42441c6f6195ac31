// The irregular edges of a hex mesh (as bwh.mjs decodes it): those inside that other than four hexes meet at, and those on the boundary that other than two do. Knows no page.

const MOST_AROUND = 256; // hexes around an edge; in a mesh whose hexes are no cuboids a walk around may not come back

// Corners of the edges of a hex: [axis, corner at its low end].
const edgesOfHex = [0, 1, 2].flatMap(axis => [0, 1, 2, 3, 4, 5, 6, 7].filter(c => !(c >> axis & 1)).map(c => [axis, c]));

function cornerOf(hexes, h, vertex) {
  for (let c = 0; c < 8; c++) if (hexes[8 * h + c] === vertex) return c;
  return -1;
}

// Face i (0 or 1) of the two faces of a hex at the edge between two of its vertices; -1 if they are no edge of it.
function faceAt(hexes, h, v, w, i) {
  const c = cornerOf(hexes, h, v), d = cornerOf(hexes, h, w), bit = c ^ d;
  if (c < 0 || d < 0 || (bit !== 1 && bit !== 2 && bit !== 4)) return -1;
  const b = i ? (bit === 4 ? 1 : 2) : (bit === 1 ? 1 : 0); // the axis across that face
  return 2 * b + (c >> b & 1);
}

// Goes around the edge v, w from hex h through one of its faces there, and collects every hex until it is back at h (true) or at the boundary (false).
function walk({ hexes }, mate, h, v, w, face, around) {
  for (let x = mate[6 * h + face]; x >= 0 && around.length < MOST_AROUND;) {
    const at = Math.floor(x / 6), one = at === h ? -1 : faceAt(hexes, at, v, w, 0);
    if (one < 0) return true;
    around.push(at);
    x = mate[6 * at + (one === x % 6 ? faceAt(hexes, at, v, w, 1) : one)];
  }
  return false;
}

// Puts the hexes around the edge v, w of hex h into `around`; whether it is inside.
function goAround(mesh, mate, h, v, w, around) {
  around.length = 1, around[0] = h;
  const inside = walk(mesh, mate, h, v, w, faceAt(mesh.hexes, h, v, w, 0), around);
  if (!inside) walk(mesh, mate, h, v, w, faceAt(mesh.hexes, h, v, w, 1), around);
  return inside;
}

/**
 * The irregular edges: [{v, w, valence, inside, blocks: different ones around it}]. Blocks are cuboids, so that each has it on an edge of a block around it, and only
 * there they are looked for; everywhere in hexes that are listed without a place in a block. O(hexes on edges of blocks).
 */
export function irregularEdges(mesh, mate) {
  const found = [], known = new Set(), around = [], { hexes, ijk, block } = mesh;
  const look = (h, v, w) => {
    if (v === w) return;
    const inside = goAround(mesh, mate, h, v, w, around), key = Math.min(v, w) * mesh.vertexCount + Math.max(v, w);
    if (around.length === (inside ? 4 : 2) || known.has(key)) return;
    known.add(key);
    found.push({ v, w, valence: around.length, inside, blocks: [...new Set(around.map(at => block[at]))] });
  };
  for (const { n, first, count } of mesh.parts) {
    const listed = !n[1];
    for (let h = first; h < first + count; h++)
      for (const [axis, c] of edgesOfHex) {
        const atEdge = listed || [0, 1, 2].every(b => b === axis || ijk[3 * h + b] === (c >> b & 1 ? n[b] - 1 : 0));
        if (atEdge) look(h, hexes[8 * h + c], hexes[8 * h + (c | 1 << axis)]);
      }
  }
  return found;
}
