// Numbers and reports as the page tells them: node text_test.mjs. Exit 1 at the first that is not as it should be.
import assert from 'node:assert/strict';
import { kindFound, sectionsOf } from '../../../clients/web/page/report.mjs';
import { bytes, count, counted, percent, real, seconds } from '../../../clients/web/page/text.mjs';

const told = {
  [count(1234567)]: '1\u202f234\u202f567', [counted(1, 'block')]: '1 block', [counted(0, 'block')]: '0 blocks', [counted(2, 'hex', 'hexes')]: '2 hexes',
  [real(0)]: '0', [real(0.1)]: '0.1', [real(-0.25)]: '-0.25', [real(100.04)]: '100', [real(1200.4)]: '1200', [real(1.0504)]: '1.05', [real(123456.7)]: '123\u202f457',
  [real(0.00001638)]: '1.638e-5', [real(2e-7)]: '2e-7', [real(1e300)]: '1e+300', [real(undefined)]: '-', [real(NaN)]: '-', [percent(0.0386)]: '3.86 %',
  [bytes(999)]: '999 B', [bytes(1000)]: '1.0 kB', [bytes(999960)]: '1.0 MB', [bytes(53827)]: '53.8 kB',
  [seconds(0.00003)]: 'under 1 ms', [seconds(0.25)]: '0.25 s', [seconds(20.06)]: '20.1 s', [seconds(3725)]: '62 min 5 s',
};
for (const [is, should] of Object.entries(told)) assert.equal(is, should);

// A report of a job that was to stop early has the sections of the stages that ran, and no others.
const input = { kind: 'tet', tets: 1, vertices: 4, bytes: 10, feature_edges: 1 };
assert.equal(kindFound({ input }), 'tet mesh');
assert.equal(kindFound(null), '');
const [only, ...others] = sectionsOf({ input, stages: [] });
assert.deepEqual(only.rows, [['Kind', 'tet mesh'], ['Size', '1 tet, 4 vertices, 10 B'], ['Features', '1 edge']]);
assert.equal(others.length, 0);
