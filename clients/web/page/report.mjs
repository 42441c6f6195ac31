// A job's report.json as people read it, the same for tet and hex jobs: sections of rows and tables. No page, so Node runs it as well.
import { bytes, count, counted, percent, real, seconds } from './text.mjs';

const list = parts => parts.filter(part => part).join(', ');
const rows = (...all) => all.filter(row => row && row[1]);

/** 'hexahedral mesh' or 'tet mesh': what the job was found to be of, once its report tells; '' before. */
export const kindFound = report => ({ hex: 'hexahedral mesh', tet: 'tet mesh' })[report?.input?.kind] || '';

function input({ input: i }) {
  const what = i.kind === 'hex' ? list([counted(i.hexes, 'hex', 'hexes'), `${counted(i.tets, 'tet')} made of them`])
    : list([counted(i.tets, 'tet'), counted(i.vertices, 'vertex', 'vertices')]);
  const features = list([i.feature_vertices && counted(i.feature_vertices, 'vertex', 'vertices'), i.feature_edges && counted(i.feature_edges, 'edge'),
    i.feature_facets && counted(i.feature_facets, 'facet')]);
  return {
    rows: rows(['Kind', kindFound({ input: i })], ['Size', list([what, bytes(i.bytes)])],
      i.singular_edges !== undefined && ['Singular edges', `${count(i.singular_edges_interior)} inside, ${count(i.singular_edges_boundary)} on the boundary`],
      ['Features', features], i.mirrored && ['Mirrored', 'cells are listed left-handed']),
  };
}

function sanitize({ sanitize: s }) {
  const r = s.repaired;
  return {
    rows: rows(['Parameters', s.already_exact ? 'exact as they came' : `moved by ${real(s.displacement_max)} at most`],
      r && ['Repaired', `${counted(r.regions, 'region')} with ${counted(r.tets, 'inverted or degenerate tet')}; ${counted(r.vertices_moved, 'vertex', 'vertices')} moved`]),
  };
}

const complexNames = { mc: 'motorcycle complex', bc: 'base complex', serial: 'motorcycle complex, walls one after another' };

function complex({ complex: { kind, raw, reduced } }) {
  const line = (name, c) => c && [name, ...[c.blocks, c.patches, c.arcs, c.t_arcs, c.nodes, c.singular_arcs].map(count)];
  const from = reduced && reduced.from !== kind ? `, from the ${complexNames[reduced.from]}` : '';
  return {
    rows: rows(['Kind', complexNames[kind]], raw.torus_splits && ['Tori split', count(raw.torus_splits)],
      reduced && ['Reduced', `until no wall can be spared${reduced.mode === 'full' ? '' : ' but at singular arcs'}${from}; effort ${reduced.effort}, ` +
        `${counted(reduced.orders_tried, 'order')} tried (farthest first: ${counted(reduced.blocks_farthest_first, 'block')})`]),
    table: { head: ['', 'blocks', 'patches', 'arcs', 'T-arcs', 'nodes', 'singular arcs'], lines: [line('as traced', raw), line('reduced', reduced)].filter(l => l) },
  };
}

const cuts = { time: 'its time was over', memory: 'its memory was used up', finish: 'it was asked to settle for the best found' };
const costs = { blocks: 'number of blocks', bits: 'bits per vertex', 'bits-by-block': 'bits per vertex, block by block', cubes: 'longest side by shortest, over all blocks', weighted: 'a weighted sum' };

// Whether a component of the conflict graph was searched through.
const searched = c => (c.complete ? 'all' : c.bounded ? 'all that can be best' : c.leaves ? 'in part' : 'by chance');

function exploration({ exploration: e }) {
  return {
    rows: rows(['Method', list([e.method, `seed ${e.seed}`, /enumerate|auto/.test(e.method) && `beam ${count(e.beam)}, expanded ${e.expand === 'cheapest' ? 'cheapest first' : 'by chance'}`])],
      ['Cost', `${costs[e.cost] || e.cost}${e.cost === 'weighted' ? `: ${e.weights}` : ''}`],
      ['Proven', e.proven ? `no order of inserting sheets costs less than ${real(e.serial)}` : 'no; the best known'],
      ['Search', `${counted(e.evaluations, 'evaluation')} in ${seconds(e.seconds)}, the last gain at ${count(e.improved_at)}`],
      ['Ended early', e.cut !== 'no' && `${cuts[e.cut] || e.cut}; the result is the best found until then`],
      ['Conflicts', `${counted(e.sheets, 'sheet')} of ${counted(e.lines, 'singular line')}; ${counted(e.links, 'pair')} of which one can stop the other, in ` +
        `${counted(e.components, 'component')}; ${counted(e.variable_patches, 'patch', 'patches')} to decide on`]),
    table: {
      head: ['', 'cost', 'blocks'],
      lines: [['at first', real(e.start), count(e.start_blocks)], ['by inserting sheets', real(e.serial), count(e.serial_blocks)], ['best', real(e.best), count(e.best_blocks)]],
    },
    more: e.component.length ? {
      head: ['component', 'sheets', 'pairs', 'states', 'leaves', 'searched'],
      lines: e.component.map((c, i) => [count(i + 1), count(c.sheets), count(c.links), count(c.states), count(c.leaves), searched(c)]),
    } : null,
  };
}

function quantization({ quantization: q }) {
  const line = (name, l) => [name, real(l.scale), count(l.hexes), real(l.objective), real(l.bound), count(l.zero_arcs), count(l.negative_arcs), l.scale > 0 ? real(l.distortion, 3) : '-', l.status];
  const r = q.rounding, rounded = r && (r.valid ? counted(r.hexes, 'hex', 'hexes') : counted(r.conflicts, 'conflict'));
  const coarsest = r?.coarsest_valid ? `; at its coarsest (scale ${real(r.coarsest_scale)}) ${counted(r.coarsest_hexes, 'hex', 'hexes')}` : '';
  return {
    rows: rows(['Lengths', list([q.range, q.goal === 'hexes' && 'as few hexes as possible', counted(q.free_integers, 'free integer'), seconds(q.seconds)])],
      ['Optimal', q.gap > 0 ? `may be better by ${percent(q.gap)}` : q.status === 'optimal' && 'yes, proven'],
      q.target_hexes && ['Asked for', `${counted(q.target_hexes, 'hex', 'hexes')}, ${q.target_met ? 'which it is near' : 'as near as found'}`],
      ['Checked', q.verified && 'valid by a second method'], ['Given up', q.fallback !== 'none' && `for ${q.fallback} lengths`],
      r && ['Rounding', `${rounded} at scale ${real(r.scale)}${coarsest}`]),
    table: {
      head: ['', 'scale', 'hexes', 'objective', 'bound', 'zeros', 'negatives', 'distortion', 'status'],
      lines: [...q.sweep.map(l => line('table', l)), line('lengths', q)],
    },
  };
}

function map({ reparametrize: m }) {
  return {
    rows: rows(['Map', m.route === 'quality' ? `of the tets, distortion ${real(m.distortion_mean)} in the mean, ${real(m.distortion_max)} at most` : 'none; hexes block by block'],
      ['Not as asked for', m.reason], ['Time', seconds(m.seconds)]),
  };
}

function hexes({ extract: x, hex_quality: q }) {
  const s = q?.smoothing, from = { map: 'read off the map', blocks: 'filled in block by block', input: 'those of the input, with their blocks' };
  const finer = x && x.subdivide > x.subdivide_asked ? `${count(x.subdivide)} along an edge of a unit, or faces would coincide` : '';
  return {
    rows: rows(x && ['Hexes', list([count(x.hexes), counted(x.vertices, 'vertex', 'vertices'), from[x.from]])], ['Refined', finer],
      q && ['Scaled Jacobian', `${real(q.scaled_jacobian.min)} at least, ${real(q.scaled_jacobian.mean)} in the mean`],
      q?.nonpositive && ['Not positive', counted(q.nonpositive, 'hex', 'hexes')],
      q && ['Off the surface', `${real(q.hausdorff, 3)} at most, ${percent(q.hausdorff_relative)} of its size`], q && ['Volume', `${q.volume_difference < 0 ? '' : '+'}${percent(q.volume_difference)}`],
      s && ['Before smoothing', `scaled Jacobian ${real(s.min_before)} at least, ${real(s.mean_before)} in the mean`],
      s?.vertices_off_surface && ['Left the surface', `${counted(s.vertices_off_surface, 'vertex', 'vertices')}, by ${real(s.off_surface_max, 3)} at most`]),
  };
}

function baseComplex({ base_complex: b }) {
  const line = (name, c) => c && [name, ...[c.hexes, c.blocks, c.irregular_edges].map(count)];
  return {
    rows: [],
    table: {
      head: ['', 'hexes', 'blocks', 'irregular edges'],
      lines: [line('of the input', b.before), line('as the lengths promise', b.planned), line('of the hex mesh made', b.after)].filter(l => l),
    },
  };
}

function compression({ compression: c }) {
  const w = c.written, how = w && (w.bits ? `${counted(w.bits, 'bit')} a coordinate, off by ${real(w.error_max, 3)} at most` : 'lossless');
  return {
    rows: rows(['Estimate', `${real(c.estimate_pooled)} bits per vertex (E_g at ${counted(c.bits, 'bit')}; with entropies by block ${real(c.estimate_blocks)})`],
      w && ['hexmesh.bwh', `${real(w.bits_per_vertex)} bits per vertex, ${real(w.bits_per_vertex_places)} of them coordinates: ${bytes(w.bytes)}, ${how}`],
      ['Blocks', `${real(c.cube_ratio / Math.max(c.blocks, 1), 3)} times as long as wide in the mean`]),
  };
}

function blocks({ quality: q }) {
  const line = (name, range) => range && [name, ...[range.min, range.median, range.max].map(x => real(x))];
  return {
    rows: rows(['Volume', real(q.volume)], ['No integer-grid map', q.integer_grid_omitted]),
    table: {
      head: ['', 'least', 'median', 'most'],
      lines: [line('extent in the map', q.block_extent), line('longest by shortest extent', q.block_aspect), line('volume in space', q.block_volume)].filter(l => l),
    },
  };
}

function tspline({ tspline: t }) {
  return {
    rows: rows(['T-mesh', `${counted(t.cells, 'cell')} of ${counted(t.blocks, 'block')}: ${count(t.added_cells)} added around ${counted(t.extraordinary_arcs, 'extraordinary arc')}`],
      ['T-joints', count(t.t_joints)], ['Knots', t.knots === 'hexes' ? 'in hexes' : 'in units of the map']),
  };
}

function stages({ stages: all }) {
  return { rows: [], table: { head: ['', 'time', 'peak memory'], lines: all.map(s => [s.name, seconds(s.seconds), bytes(s.peak_bytes)]) } };
}

const parts = [['Input', input, 'input'], ['Parametrization', sanitize, 'sanitize'], ['Complex', complex, 'complex'], ['Exploration', exploration, 'exploration'],
  ['Quantization', quantization, 'quantization'], ['Map', map, 'reparametrize'], ['Hex mesh', hexes, 'extract', 'hex_quality'], ['Base complex', baseComplex, 'base_complex'],
  ['Compression', compression, 'compression'], ['Blocks', blocks, 'quality'], ['T-splines', tspline, 'tspline'], ['Stages', stages, 'stages']];

/** [{title, rows: [[label, text]], table: {head, lines} | undefined, more: the same}]: a section for each that the report has. */
export function sectionsOf(report) {
  return parts.filter(([, , ...keys]) => keys.some(key => report[key])).map(([title, make]) => ({ title, ...make(report) }))
    .filter(s => s.rows.length || s.table?.lines.length);
}
