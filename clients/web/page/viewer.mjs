// A hex mesh: what of it is shown and how, by the controls beside it, the mouse and keys.
import { $, credentials } from './dom.mjs';
import { blockColour, lineColour, qualityColour, Scene } from './draw.mjs';
import { count, counted, real } from './text.mjs';

const STEPS = 200;
const palette = Array.from({ length: STEPS + 1 }, (_, i) => qualityColour(i / STEPS)); // the first for all that are not positive

// What the sliders stand for, in words.
function tellCut({ by, at, below }) {
  $('at').disabled = !by;
  $('atText').textContent = !by ? '' : 'ijk'.includes(by) ? (at ? `first ${at === 1 ? 'layer' : `${at} layers`} hidden` : 'all shown') : `${Math.round(100 * at)} % shown`;
  $('belowText').textContent = below > 1 ? 'all' : below.toFixed(2);
}

// '4 of 3 hexes, 1 of 5', what is regular left out.
const valencesIn = counts => Object.entries(counts).map(([valence, edges]) => `${count(edges)} of ${counted(Number(valence), 'hex', 'hexes')}`).join(', ');

function describe(mesh) {
  const place = mesh.notPositive ? `, ${count(mesh.notPositive)} not positive` : '', { inside, boundary } = mesh.lines.valences;
  $('counts').textContent = `${counted(mesh.hexes, 'hex', 'hexes')}, ${counted(mesh.vertices, 'vertex', 'vertices')}, ${counted(mesh.blocks, 'block')}`;
  $('quality').textContent = `Scaled Jacobian ${mesh.least.toFixed(3)} at least, ${mesh.mean.toFixed(3)} in the mean${place}`;
  $('valences').textContent = `inside: ${valencesIn(inside) || 'none'}; on the boundary: ${valencesIn(boundary) || 'none'}`;
  drawHistogram(mesh.histogram);
}

// Heights are square roots, so that few bad hexes among many good ones are seen.
function drawHistogram(histogram) {
  const most = Math.sqrt(Math.max(...histogram)) || 1, svg = $('histogram'), n = histogram.length;
  svg.replaceChildren(...histogram.map((hexes, i) => {
    const low = -1 + 2 * i / n, bar = document.createElementNS(svg.namespaceURI, 'rect'), title = document.createElementNS(svg.namespaceURI, 'title');
    const height = hexes ? Math.max(1, 60 * Math.sqrt(hexes) / most) : 0;
    for (const [name, value] of Object.entries({ x: 10 * i, y: 60 - height, width: 9, height, fill: `rgb(${qualityColour(low + 1 / n).map(Math.round).join()})` }))
      bar.setAttribute(name, value);
    title.textContent = `${low.toFixed(1)} to ${(low + 2 / n).toFixed(1)}: ${hexes}`;
    bar.append(title);
    return bar;
  }));
}

export class MeshView {
  /** said(state, text) for every change; failed(text) when there is nothing to show after all. `trouble` is why no mesh can be shown at all, or ''. */
  constructor({ said, failed }) {
    Object.assign(this, { said, failed, trouble: '', mesh: null, skin: null, fresh: false, run: 0, waiting: false, changed: false, frame: 0, last: ['empty', ''] });
    try {
      this.scene = new Scene($('canvas'));
    } catch (error) {
      this.trouble = error.message;
      return;
    }
    this.worker = new Worker(new URL('./worker.mjs', import.meta.url), { type: 'module' });
    this.worker.onmessage = ({ data }) => this.receive(data);
    this.worker.onerror = event => this.fail(event.message || 'the page\u2019s worker could not be started');
    this.watchControls();
    this.watchCanvas($('canvas'));
    new ResizeObserver(() => this.scene.draw()).observe($('canvas'));
  }

  // ---- what to show

  /** what: {url} or {file}, a hexmesh.bwh. */
  load(what) {
    this.forget();
    if (this.trouble) return this.failed(this.trouble);
    this.fresh = true;
    for (const id of ['by', 'at', 'below', 'apart']) $(id).value = $(id).dataset.first;
    this.scene.apart = 0;
    this.say('working', 'Loading \u2026');
    this.worker.postMessage({ load: { ...what, headers: credentials() }, run: this.run });
  }

  /** Nothing is shown any more, and what the worker still has to say of it is not listened to. */
  forget() {
    this.mesh = this.skin = null, this.waiting = this.changed = false, this.run++;
    if (!this.scene) return;
    const none = new Float32Array(0);
    this.scene.setQuads(none, none), this.scene.setLines(none, none, new Uint8Array(0));
    this.redraw();
  }

  /** Says where it is; without arguments, once more. */
  say(...news) {
    if (news.length) this.last = news;
    this.said(...this.last);
  }

  fail(text) {
    this.forget();
    this.failed(text);
  }

  receive(data) {
    if (data.run !== this.run) return; // of what is not wanted any more
    if (data.step) this.say('working', `${data.step} \u2026`);
    if (data.failed) this.fail(data.failed);
    if (data.mesh) {
      this.mesh = data.mesh;
      describe(this.mesh);
      this.showLines();
      this.ask();
    }
    if (data.skin) this.show(data.skin);
  }

  // ---- cutting open: one request at a time, the latest wish after it

  cut() {
    const by = $('by').value, layers = this.mesh.layers['ijk'.indexOf(by)], at = Number($('at').value);
    return { by, at: by && layers !== undefined ? Math.round(at * layers) : 1 - at, below: Number($('below').value), apart: Number($('apart').value) > 0 };
  }

  ask() {
    if (!this.mesh) return;
    this.changed = this.waiting;
    if (this.waiting) return;
    this.waiting = true;
    this.asked = this.cut();
    tellCut(this.asked);
    this.worker.postMessage({ cut: this.asked, run: ++this.run });
  }

  show(answer) {
    this.waiting = false;
    this.skin = answer;
    this.scene.setQuads(answer.corners, answer.away);
    if (this.fresh) this.scene.fit(answer.corners);
    this.fresh = false;
    this.colourQuads();
    this.pullApart();
    const left = answer.left ? `; ${count(answer.left)} more faces than can be drawn: cut away less` : '';
    this.say('ready', `${count(answer.hexes)} of ${counted(this.mesh.hexes, 'hex', 'hexes')}, ${counted(answer.quality.length, 'face')}${left}`);
    if (this.changed) this.ask();
  }

  /** Blocks as far apart as the slider says, once the faces between them are there. */
  pullApart() {
    const apart = Number($('apart').value);
    $('apartText').textContent = apart ? real(apart) : 'no';
    if (!this.mesh) return;
    if (this.asked.apart !== apart > 0) this.ask();
    if (this.asked.apart && !this.waiting) this.scene.apart = apart;
    else if (!apart) this.scene.apart = 0;
    this.redraw();
  }

  // ---- drawing

  /** However many events there are between two frames, it is drawn once. */
  redraw() {
    this.frame ||= requestAnimationFrame(() => {
      this.frame = 0;
      this.scene.draw();
    });
  }

  colourQuads() {
    const { skin } = this, byBlock = $('colour').value === 'block', n = skin.block.length, out = new Uint8Array(4 * n), known = new Map();
    for (let i = 0; i < n; i++) {
      let colour;
      if (byBlock) known.set(skin.block[i], colour = known.get(skin.block[i]) || blockColour(skin.block[i]));
      else colour = palette[skin.quality[i] > 0 ? Math.min(STEPS, Math.ceil(skin.quality[i] * STEPS)) : 0];
      out[4 * i] = colour[0], out[4 * i + 1] = colour[1], out[4 * i + 2] = colour[2], out[4 * i + 3] = 255;
    }
    this.scene.setColours(out);
  }

  showLines() {
    const { ends, away, valence, inside } = this.mesh.lines, colours = new Uint8Array(4 * valence.length);
    valence.forEach((n, i) => colours.set(lineColour(n, inside[i]), 4 * i));
    this.scene.setLines(ends, away, colours);
  }

  still() {
    this.scene.draw(); // in the same turn as toBlob: the drawing is not kept longer
    this.scene.canvas.toBlob(blob => {
      const link = document.createElement('a');
      link.href = URL.createObjectURL(blob);
      link.download = 'hexmesh.png';
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    }, 'image/png');
  }

  // ---- controls, the mouse, and keys

  watchControls() {
    const { scene } = this, on = (id, act) => $(id).addEventListener(id === 'still' ? 'click' : 'input', act);
    for (const id of ['by', 'at', 'below']) on(id, () => this.ask());
    on('apart', () => this.pullApart());
    on('colour', () => this.skin && (this.colourQuads(), this.redraw()));
    on('edges', () => (scene.edges = $('edges').checked, this.redraw()));
    on('irregular', () => (scene.irregular = $('irregular').checked, this.redraw()));
    on('still', () => this.still());
    scene.edges = $('edges').checked, scene.irregular = $('irregular').checked; // a page that is gone back to has its controls as they were
  }

  watchCanvas(canvas) {
    const { scene } = this;
    canvas.addEventListener('pointerdown', event => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener('pointermove', event => {
      if (!event.buttons) return;
      if (event.buttons === 1 && !event.shiftKey) {
        scene.yaw += event.movementX * 0.008;
        scene.pitch = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, scene.pitch + event.movementY * 0.008));
      } else {
        scene.shift[0] += 2 * event.movementX / canvas.clientWidth, scene.shift[1] -= 2 * event.movementY / canvas.clientHeight;
      }
      this.redraw();
    });
    canvas.addEventListener('wheel', event => {
      event.preventDefault();
      scene.zoom *= Math.exp(-event.deltaY * 0.001);
      this.redraw();
    }, { passive: false });
    canvas.addEventListener('contextmenu', event => event.preventDefault());
    canvas.addEventListener('keydown', event => {
      const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
      const zoom = { '+': 1.1, '-': 1 / 1.1 }[event.key];
      if (step) scene.yaw += step[0], scene.pitch += step[1];
      if (zoom) scene.zoom *= zoom;
      if (step || zoom) event.preventDefault(), this.redraw();
    });
  }
}
