// The page: what is shown, and how. document.body.dataset.state is empty, working, ready or failed, for style and tests.
import { blockColour, qualityColour, Scene } from './draw.mjs';

const $ = id => document.getElementById(id);
const worker = new Worker(new URL('./worker.mjs', import.meta.url), { type: 'module' });
let scene, mesh = null, skin = null, fresh = false, run = 0, waiting = false, changed = false;

function tell(state, text) {
  document.body.dataset.state = state;
  $('status').textContent = text;
}

// Nothing is shown any more, and what a worker still has to say of it is not listened to.
function forget() {
  mesh = skin = null, waiting = changed = false, run++;
  if (!scene) return;
  scene.setCorners(new Float32Array(0));
  redraw();
}

function fail(text) {
  forget();
  tell('failed', text);
  $('jobs').hidden = false;
}

const count = n => n.toLocaleString('en').replaceAll(',', '\u202f');

// However many events there are between two frames, it is drawn once.
let frame = 0;
const redraw = () => {
  frame ||= requestAnimationFrame(() => {
    frame = 0;
    scene.draw();
  });
};

// ---- colours and the histogram

const STEPS = 200;
const palette = Array.from({ length: STEPS + 1 }, (_, i) => qualityColour(i / STEPS)); // the first for all that are not positive

function colourQuads() {
  const byBlock = $('colour').value === 'block', n = skin.block.length, out = new Uint8Array(4 * n), known = new Map();
  for (let i = 0; i < n; i++) {
    let colour;
    if (byBlock) known.set(skin.block[i], colour = known.get(skin.block[i]) || blockColour(skin.block[i]));
    else colour = palette[skin.quality[i] > 0 ? Math.min(STEPS, Math.ceil(skin.quality[i] * STEPS)) : 0];
    out[4 * i] = colour[0], out[4 * i + 1] = colour[1], out[4 * i + 2] = colour[2], out[4 * i + 3] = 255;
  }
  scene.setColours(out);
}

// Heights are square roots, so that few bad hexes among many good ones are seen.
function drawHistogram() {
  const most = Math.sqrt(Math.max(...mesh.histogram)) || 1, svg = $('histogram'), n = mesh.histogram.length;
  svg.replaceChildren(...mesh.histogram.map((hexes, i) => {
    const low = -1 + 2 * i / n, bar = document.createElementNS(svg.namespaceURI, 'rect'), title = document.createElementNS(svg.namespaceURI, 'title');
    const height = hexes ? Math.max(1, 60 * Math.sqrt(hexes) / most) : 0;
    for (const [name, value] of Object.entries({ x: 10 * i, y: 60 - height, width: 9, height, fill: `rgb(${qualityColour(low + 1 / n).map(Math.round).join()})` }))
      bar.setAttribute(name, value);
    title.textContent = `${low.toFixed(1)} to ${(low + 2 / n).toFixed(1)}: ${hexes}`;
    bar.append(title);
    return bar;
  }));
}

function describe() {
  const place = mesh.notPositive ? `, ${count(mesh.notPositive)} not positive` : '';
  $('counts').textContent = `${count(mesh.hexes)} hexes, ${count(mesh.vertices)} vertices, ${count(mesh.blocks)} blocks`;
  $('quality').textContent = `Scaled Jacobian ${mesh.least.toFixed(3)} at least, ${mesh.mean.toFixed(3)} in the mean${place}`;
  drawHistogram();
}

// ---- cutting open: one request at a time, the latest wish after it

function cutOf() {
  const by = $('by').value, layers = mesh.layers['ijk'.indexOf(by)], at = Number($('at').value);
  return { by, at: by && layers !== undefined ? Math.round(at * layers) : 1 - at, below: Number($('below').value) };
}

// What the sliders stand for, in words.
function tellCut({ by, at, below }) {
  $('at').disabled = !by;
  $('atText').textContent = !by ? '' : 'ijk'.includes(by) ? `first ${at} hidden` : `${Math.round(100 * at)} % shown`;
  $('belowText').textContent = below > 1 ? 'all' : below.toFixed(2);
}

function ask() {
  if (!mesh) return;
  changed = waiting;
  if (waiting) return;
  waiting = true;
  const cut = cutOf();
  tellCut(cut);
  worker.postMessage({ cut, run: ++run });
}

function show(answer) {
  waiting = false;
  skin = answer;
  scene.setCorners(skin.corners);
  if (fresh) scene.fit(skin.corners);
  fresh = false;
  colourQuads();
  redraw();
  const left = skin.left ? `; ${count(skin.left)} more faces than can be drawn: cut away less` : '';
  tell('ready', `${count(skin.hexes)} of ${count(mesh.hexes)} hexes, ${count(scene.count)} faces${left}`);
  if (changed) ask();
}

worker.onmessage = ({ data }) => {
  if (data.run !== run) return; // of what is not wanted any more
  if (data.step) tell('working', `${data.step} \u2026`);
  if (data.failed) fail(data.failed);
  if (data.mesh) {
    mesh = data.mesh;
    describe();
    ask();
  }
  if (data.skin) show(data.skin);
};
worker.onerror = event => fail(event.message || 'the page\u2019s worker could not be started');

// ---- what to show

function load(what) {
  forget();
  fresh = true;
  for (const id of ['by', 'at', 'below']) $(id).value = $(id).dataset.first;
  tell('working', 'Loading \u2026');
  worker.postMessage({ load: what, run });
}

async function listJobs() {
  const answer = await fetch('v1/jobs?state=successful&limit=50').catch(() => null);
  if (!answer || !answer.ok) return;
  for (const job of (await answer.json()).jobs) {
    const item = document.createElement('li'), link = document.createElement('a');
    link.href = `#${job.id}`;
    link.textContent = job.name || job.id;
    item.append(link, ` ${new Date(job.created).toLocaleString()}`);
    $('list').append(item);
  }
}

function follow() {
  const id = location.hash.slice(1);
  $('jobs').hidden = id !== '';
  if (/^[0-9a-f]{24}$/.test(id)) load({ url: new URL(`v1/jobs/${id}/results/hexmesh.bwh`, document.baseURI).href });
  else if (id) fail('The address names no job: #, then the job\u2019s id');
  else forget(), tell('empty', 'Choose a job, or open a file');
}

function still() {
  scene.draw(); // in the same turn as toBlob: the drawing is not kept longer
  scene.canvas.toBlob(blob => {
    const link = document.createElement('a');
    link.href = URL.createObjectURL(blob);
    link.download = 'hexmesh.png';
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  }, 'image/png');
}

// ---- the mouse, and the keys

function watchCanvas(canvas) {
  canvas.addEventListener('pointerdown', event => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener('pointermove', event => {
    if (!event.buttons) return;
    if (event.buttons === 1 && !event.shiftKey) {
      scene.yaw += event.movementX * 0.008;
      scene.pitch = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, scene.pitch + event.movementY * 0.008));
    } else {
      scene.shift[0] += 2 * event.movementX / canvas.clientWidth, scene.shift[1] -= 2 * event.movementY / canvas.clientHeight;
    }
    redraw();
  });
  canvas.addEventListener('wheel', event => {
    event.preventDefault();
    scene.zoom *= Math.exp(-event.deltaY * 0.001);
    redraw();
  }, { passive: false });
  canvas.addEventListener('contextmenu', event => event.preventDefault());
  canvas.addEventListener('keydown', event => {
    const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
    const zoom = { '+': 1.1, '-': 1 / 1.1 }[event.key];
    if (step) scene.yaw += step[0], scene.pitch += step[1];
    if (zoom) scene.zoom *= zoom;
    if (step || zoom) event.preventDefault(), redraw();
  });
}

function start() {
  try {
    scene = new Scene($('canvas'));
  } catch (error) {
    fail(error.message);
    return;
  }
  watchCanvas(scene.canvas);
  new ResizeObserver(() => scene.draw()).observe(scene.canvas);
  for (const id of ['by', 'at', 'below']) $(id).addEventListener('input', ask);
  $('colour').addEventListener('input', () => skin && (colourQuads(), redraw()));
  $('edges').addEventListener('input', () => (scene.edges = $('edges').checked, redraw()));
  $('still').addEventListener('click', still);
  $('file').addEventListener('change', () => {
    const [file] = $('file').files;
    if (!file) return;
    $('file').value = ''; // so that the same file can be chosen again
    $('jobs').hidden = true;
    load({ file });
  });
  addEventListener('hashchange', follow);
  listJobs();
  follow();
}

start();
