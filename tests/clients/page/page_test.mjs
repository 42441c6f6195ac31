// The page in a real browser: node page_test.mjs CHROMIUM FOLDER URL DAMAGED.bwh LARGE.bwh JOB SEARCH SEARCH REFUSED. JOB is one of 27 hexes, SEARCH are two of hexahedra that search
// until somebody stops them, REFUSED is one of tets that was to be of hexes. Prints what it saw; exit 1 at the first thing that is not as it should be.
import assert from 'node:assert/strict';
import { Browser } from './browser.mjs';

const [program, folder, url, damaged, large, job, search, search2, refused] = process.argv.slice(2);
const settled = `document.body.dataset.state !== 'working'`, state = `document.body.dataset.state`, status = `document.getElementById('status').textContent`;
const browser = await Browser.open(program, `${folder}/profile`, url);

const set = (id, value) => browser.evaluate(`(${id}.value = ${JSON.stringify(value)}, ${id}.dispatchEvent(new Event('input')), 0)`);
const faces = async () => Number(/([\d\u202f]+) faces/.exec(await browser.evaluate(status))[1].replaceAll('\u202f', ''));
const hexes = async () => Number(/^([\d\u202f]+) of/.exec(await browser.evaluate(status))[1].replaceAll('\u202f', ''));
const until = expression => browser.until(expression);
const text = id => browser.evaluate(`document.getElementById('${id}').innerText`);
const seen = id => browser.evaluate(`document.getElementById('${id}').checkVisibility()`);
const go = hash => browser.evaluate(`(location.hash = '#${hash}', 0)`);
const ask = path => browser.evaluate(`fetch('v1/jobs/${path}').then(answer => answer.json())`);
const offline = on => browser.send('Network.emulateNetworkConditions', { offline: on, latency: 0, downloadThroughput: -1, uploadThroughput: -1 });

// A section of the report as it is read: {row or line: text}.
const section = title => browser.evaluate(`(() => {
  const part = [...document.querySelectorAll('#report section')].find(s => s.querySelector('h3').textContent === '${title}'), found = {};
  for (const dt of part?.querySelectorAll('dt') || []) found[dt.textContent] = dt.nextElementSibling.textContent;
  for (const line of part?.querySelectorAll('tbody tr') || []) found[line.cells[0].textContent] = [...line.cells].slice(1).map(cell => cell.textContent).join(' ');
  return part ? found : null;
})()`);

// The picture that the button saves, as numbers of pixels: {white, colours}.
const saved = () => browser.evaluate(`new Promise(resolve => {
  const create = URL.createObjectURL, click = HTMLAnchorElement.prototype.click;
  HTMLAnchorElement.prototype.click = () => {};
  URL.createObjectURL = blob => {
    URL.createObjectURL = create, HTMLAnchorElement.prototype.click = click;
    createImageBitmap(blob).then(image => {
      const canvas = new OffscreenCanvas(image.width, image.height), context = canvas.getContext('2d');
      context.drawImage(image, 0, 0);
      const pixels = new Uint32Array(context.getImageData(0, 0, image.width, image.height).data.buffer);
      let white = 0;
      for (const p of pixels) white += p === 0xffffffff;
      resolve({ type: blob.type, size: pixels.length, white, colours: new Set(pixels).size, sum: pixels.reduce((a, b) => (a * 31 + b) % 1000003, 0) });
    });
    return create(blob);
  };
  still.click();
})`);

// In the page: what is asked for (`paths`: paths; `headers`: of streams, with their path), which rows change (`changed`: ids), and whether streams are refused (`refuse`).
const watchList = () => browser.evaluate(`(() => {
  const ask = window.fetch;
  Object.assign(window, { paths: [], headers: [], changed: [], streams: [], refuse: false });
  window.fetch = async (url, options = {}) => {
    const path = String(url).slice(document.baseURI.split('#')[0].length), stream = path.endsWith('/events');
    if (!stream) paths.push(path);
    else if (refuse) return new Response('', { status: 429 });
    const wire = new AbortController();
    options.signal?.addEventListener('abort', () => wire.abort());
    const answer = await ask(url, { ...options, signal: wire.signal });
    if (stream) headers.push({ path, ...options.headers }), streams.push({ path, signal: options.signal, wire });
    return answer;
  };
  window.breakStreams = () => streams.forEach(s => s.wire.abort());
  window.heard = path => headers.some(h => h.path === path);
  window.cut = path => streams.filter(s => s.path === path).every(s => s.signal.aborted);
  new MutationObserver(records => {
    for (const { target, addedNodes } of records) {
      const rows = target.id === 'list' ? [...addedNodes] : [target.nodeType === 1 ? target.closest('li') : target.parentElement.closest('li')];
      for (const { dataset: { id } } of rows) if (!changed.includes(id)) changed.push(id);
    }
  }).observe(list, { childList: true, subtree: true, characterData: true });
})()`);

// Past the browser: a job like another one, under a name of its own, which waits, for the searches leave no room; and its end.
async function submit(like, name) {
  const { input, options } = await (await fetch(`${url}/v1/jobs/${like}`)).json();
  const answer = await fetch(`${url}/v1/jobs`, { method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify({ input, name, options }) });
  assert.equal(answer.status, 201);
  return (await answer.json()).id;
}

const settle = ms => new Promise(done => setTimeout(done, ms));
const cancel = async id => assert.equal((await fetch(`${url}/v1/jobs/${id}/cancel`, { method: 'POST' })).status, 200);
const first = pattern => `${pattern}.test(document.querySelector('#list li')?.innerText)`;

// A stream until it has said the words.
async function all(path, words) {
  const cut = new AbortController(), answer = await fetch(`${url}/${path}`, { signal: cut.signal });
  let text = '';
  for await (const piece of answer.body.pipeThrough(new TextDecoderStream())) if ((text += piece).includes(words)) break;
  cut.abort();
  return text;
}

const tests = {
  async 'the page lists all jobs with their states, and the link of one shows its mesh'() {
    const link = `document.querySelector('#list a[href="#${job}"]')`, line = id => browser.evaluate(`document.querySelector('#list a[href="#${id}"]').parentElement.innerText`);
    await until(link);
    assert.equal(await browser.evaluate(state), 'empty');
    assert.match(await line(job), /^cube\.hexex successful, /);
    assert.match(await line(refused), /^bearing\.hexex failed, /);
    await until(`/^hexmesh\\.mesh running, stage \\d of 8, /.test(document.querySelector('#list a[href="#${search}"]').parentElement.innerText)`);
    assert.equal(await seen('none'), false);
    await browser.evaluate(`${link}.click()`);
    await until(`${state} === 'ready'`);
    assert.equal(await hexes(), 27);
    assert.equal(await faces(), 54);
    assert.match(await browser.evaluate(`counts.textContent`), /^27 hexes, 64 vertices, 1 block$/);
    assert.equal(await browser.evaluate(`histogram.children.length`), 20);
  },
  async 'the list hears of jobs, and asks for nothing but a new one, and changes no other row'() {
    await watchList();
    await go('');
    await until(`paths.length > 0`);
    await settle(500);
    await browser.evaluate(`(paths.length = changed.length = 0)`);
    const before = await browser.evaluate(`[...document.querySelectorAll('#list li')].map(item => item.innerText)`), fresh = await submit(job, 'new <b>one</b>');
    await until(first(/^new <b>one<\/b> queued, /));
    await cancel(fresh);
    await until(first(/^new <b>one<\/b> cancelled, /));
    assert.deepEqual(await browser.evaluate(`paths`), [`v1/jobs/${fresh}`]);
    assert.deepEqual(await browser.evaluate(`changed`), [fresh]);
    assert.deepEqual(await browser.evaluate(`[...document.querySelectorAll('#list li')].slice(1).map(item => item.innerText)`), before);
  },
  async 'the list misses nothing while it is cut off, and says so'() {
    assert.ok(await browser.evaluate(`heard('v1/events')`));
    await offline(true);
    await browser.evaluate(`breakStreams()`);
    await until(`/does not answer/.test(listTrouble.textContent)`);
    const fresh = await submit(job, 'unheard of');
    await cancel(fresh);
    await browser.evaluate(`(paths.length = headers.length = 0)`);
    await offline(false);
    await until(`${first(/^unheard of cancelled, /)} && listTrouble.textContent === '' && heard('v1/events')`);
    const last = Number(await browser.evaluate(`headers.find(h => h.path === 'v1/events')['Last-Event-ID']`)), events = await all(`v1/events?after=${last}`, `"dismissed"`);
    assert.equal(events.match(/^id: /gm).length, events.split(fresh).length - 1); // from after the last that was heard: all are of the new job
    browser.errors.length = 0; // the browser's own lines about it
  },
  async 'the list asks again and again where it is not told, until it is'() {
    await browser.evaluate(`(window.refuse = true)`);
    await browser.evaluate(`(paths.length = 0, breakStreams())`);
    await until(`paths.filter(path => path === 'v1/jobs?limit=50').length > 4`);
    await cancel(await submit(job, 'polled for'));
    await until(first(/^polled for cancelled, /));
    await browser.evaluate(`(window.refuse = false, headers.length = 0)`);
    await until(`heard('v1/events')`);
    await settle(500);
    await browser.evaluate(`(paths.length = 0)`);
    await settle(3000);
    assert.deepEqual(await browser.evaluate(`paths`), []);
    await browser.picture(`${folder}/list.png`);
    browser.errors.length = 0;
  },
  async 'a stream is let go with the list, and taken up with it'() {
    await browser.evaluate(`(headers.length = 0)`);
    await go(job);
    await until(`${state} === 'ready'`);
    await until(`headers.some(h => h.path === 'v1/events') === false && cut('v1/events')`);
    await go('');
    await until(`heard('v1/events')`);
    await go(job);
    await until(`${state} === 'ready' && document.body.dataset.view === 'mesh'`);
  },
  async 'a saved picture shows it'() {
    const picture = await saved();
    console.log(JSON.stringify(picture));
    assert.equal(picture.type, 'image/png');
    assert.ok(picture.white > 0 && picture.white < 0.9 * picture.size && picture.colours > 20);
  },
  async 'colours, edges and turning change the picture'() {
    const before = await saved();
    await set('colour', 'block');
    const byBlock = await saved();
    await browser.evaluate(`edges.click()`);
    const plain = await saved();
    await browser.drag([700, 300], [800, 330]);
    const turned = await saved();
    assert.equal(new Set([before, byBlock, plain, turned].map(p => p.sum)).size, 4);
    assert.ok(plain.colours < byBlock.colours);
  },
  async 'cuts hide hexes by their centres and by layers'() {
    await set('by', 'x'), await set('at', '0.5');
    await until(`${status}.startsWith('18 of 27')`);
    assert.equal(await faces(), 42);
    await set('by', 'k');
    await until(`${status}.startsWith('9 of 27')`);
    assert.equal(await text('atText'), 'first 2 layers hidden');
    assert.equal(await faces(), 30);
    await set('at', '0.34');
    await until(`${status}.startsWith('18 of 27')`);
    assert.equal(await text('atText'), 'first layer hidden');
    await set('by', '');
    await until(`${status}.startsWith('27 of 27')`);
    await set('below', '0.5');
    await until(`${status}.startsWith('0 of 27')`);
    assert.equal(await faces(), 0);
  },
  async 'the report of a job of tets tells what its report.json does'() {
    await go(`${job}/report`);
    await until(`${state} === 'ready' && document.body.dataset.view === 'job'`);
    const report = await ask(`${job}/report`), raw = report.complex.raw, size = report.quantization;
    assert.match(await text('facts'), /^successful; created .*; tet mesh$/);
    assert.equal((await section('Input')).Kind, 'tet mesh');
    assert.equal((await section('Complex'))['as traced'], [raw.blocks, raw.patches, raw.arcs, raw.t_arcs, raw.nodes, raw.singular_arcs].join(' '));
    assert.ok((await section('Quantization')).lengths.startsWith(`${size.scale} ${size.hexes} `));
    assert.match((await section('Hex mesh'))['Scaled Jacobian'], /^1 at least, 1 in the mean$/);
    assert.equal(await section('Exploration'), null);
    assert.deepEqual(Object.keys(await section('Stages')), report.stages.map(stage => stage.name));
    assert.deepEqual(Object.keys(await section('Files')), (await ask(`${job}/results`)).results.map(file => file.name));
    assert.equal(await seen('live') || await seen('cancel') || await seen('finish'), false);
    await browser.evaluate(`toMesh.click()`); // the mesh is there still, with its cut
    await until(`document.body.dataset.view === 'mesh' && ${status}.startsWith('0 of 27')`);
  },
  async 'what the daemon says against a wish is told'() {
    await go(`${job}/report`);
    await until(`${state} === 'ready' && document.body.dataset.view === 'job'`);
    await browser.evaluate(`(window.confirm = () => true, cancel.click())`); // as if the job had ended a moment ago
    await until(`/^Not cancelled: .*already/.test(trouble.textContent)`);
    browser.errors.length = 0; // the browser's own line about the 409
  },
  async 'why a job failed is told'() {
    await go(refused);
    await until(`${state} === 'failed'`);
    assert.match(await text('report'), /Why it failed[^]*the input is a mesh of tets[^]*other-kind, stage sanitize/);
    assert.equal(await text('trouble'), '');
  },
  async 'a search shows the best found so far, and settles for it'() {
    await go(search);
    await until(`${state} === 'waiting' && notes.childElementCount > 0`);
    const questions = `performance.getEntriesByType('resource').filter(e => e.name.endsWith('/v1/jobs/${search}')).length`;
    await settle(300);
    const before = await browser.evaluate(questions);
    await settle(1500);
    assert.equal(await browser.evaluate(questions), before); // it hears of it, and does not ask
    const { note, stage, progress } = await ask(search);
    assert.equal(stage, 'reduce');
    assert.equal(await browser.evaluate(`notes.lastChild.textContent`), note);
    assert.match(note, /^best \d+, \d+ blocks$/);
    assert.match(await text('facts'), /^running, \d+ %; created .*, for a hexahedral mesh$/);
    assert.ok(Math.abs(await browser.evaluate(`document.getElementById('progress').value`) - progress) < 0.2);
    assert.ok(await seen('finish') && await seen('cancel') && await seen('finishHint'));
    await browser.picture(`${folder}/search.png`);
    await browser.evaluate(`finish.click()`);
    await until(`${state} === 'ready'`);
    assert.equal(await browser.evaluate(`document.body.dataset.view`), 'mesh');
    assert.equal((await ask(`${search}/report`)).exploration.cut, 'finish');
  },
  async 'blocks of a mesh come apart, and its irregular edges are those of the report'() {
    const { hex_quality: quality, input } = await ask(`${search}/report`), together = await faces(), before = await saved();
    assert.equal(await hexes(), input.hexes);
    await set('apart', '0.5');
    await until(`apartText.textContent === '0.5' && !${status}.includes('${together} faces')`);
    assert.ok(await faces() > together && await faces() < 6 * input.hexes);
    const apart = await saved();
    await browser.evaluate(`irregular.click()`);
    const lines = await saved();
    assert.equal(new Set([before, apart, lines].map(p => p.sum)).size, 3);
    assert.ok(lines.white < apart.white || lines.colours !== apart.colours);
    const list = (edges, regular) => edges.map((n, valence) => n && valence !== regular ? `${n} of ${valence} hex${valence === 1 ? '' : 'es'}` : '').filter(x => x).join(', ') || 'none';
    assert.equal(await text('valences'), `inside: ${list(quality.inner, 4)}; on the boundary: ${list(quality.boundary, 2)}`);
    await set('apart', '0');
    await until(`${status}.includes('${together} faces')`);
    await browser.evaluate(`irregular.click()`);
    assert.equal((await saved()).sum, before.sum);
  },
  async 'the report of a job of hexahedra is the same page'() {
    await go(`${search}/report`);
    await until(`${state} === 'ready' && document.body.dataset.view === 'job'`);
    const { exploration: e, base_complex: base, compression } = await ask(`${search}/report`);
    assert.match(await text('facts'), /^successful; created .*; hexahedral mesh$/);
    const found = await section('Exploration');
    assert.match(found['Ended early'], /settle for the best found/);
    assert.equal(found.best, `${e.best} ${e.best_blocks}`);
    assert.match(found.Search, / evaluations in /);
    if (base) assert.match((await section('Base complex'))['of the input'], new RegExp(`${base.before.blocks} ${base.before.irregular_edges}$`));
    assert.ok((await section('Compression')).Estimate.startsWith(`${Number(compression.estimate_pooled.toPrecision(4))} bits per vertex (E_g at ${compression.bits} bits`));
    assert.equal(await browser.evaluate(`document.querySelector('main').scrollWidth > document.querySelector('main').clientWidth`), false);
  },
  async 'a daemon that does not answer is asked again'() {
    await go(search2);
    await until(`${state} === 'waiting' && notes.childElementCount > 0`);
    await offline(true);
    await until(`/^the daemon does not answer; asking again$/.test(trouble.textContent)`);
    await browser.evaluate(`finish.click()`);
    await until(`/^Not asked to settle: the daemon does not answer$/.test(trouble.textContent)`);
    await offline(false);
    await until(`!finish.disabled`);
    assert.equal((await ask(search2)).state, 'running');
    browser.errors.length = 0; // the browser's own lines about it
  },
  async 'a job is cancelled once that is confirmed, and nothing of it is kept'() {
    await browser.evaluate(`(window.confirm = text => (window.asked = text, false), cancel.click())`);
    assert.match(await browser.evaluate(`window.asked`), /Nothing of it is kept/);
    assert.equal((await ask(search2)).cancelling, undefined);
    await browser.evaluate(`(window.confirm = () => true, cancel.click())`);
    await until(`${state} === 'ready' && /: cancelled$/.test(${status})`);
    assert.match(await text('facts'), /^cancelled;/);
    assert.equal(await seen('cancel') || await seen('best'), false);
    assert.equal((await ask(search2)).state, 'dismissed');
  },
  async 'a damaged file is told, and another can be opened'() {
    await browser.openFile('#file', damaged);
    await until(`${state} === 'failed'`);
    assert.match(await browser.evaluate(status), /damaged|shorter/);
    const picture = await saved(); // nothing of the mesh before
    assert.equal(picture.white, picture.size);
  },
  async 'a job that is not there is told'() {
    await browser.evaluate(`(location.hash = '#' + '0'.repeat(24), 0)`);
    await until(`${state} === 'failed' && /no job/.test(${status})`);
    assert.equal((await fetch(`${url}/v1/jobs/${search2}`, { method: 'DELETE' })).status, 204);
    await go(search2);
    await until(`${state} === 'failed' && /was deleted/.test(${status})`);
    browser.errors.length = 0; // the browser's own lines about the 404 and the 410
    await browser.evaluate(`(location.hash = '#nonsense', 0)`);
    await until(`${state} === 'failed' && /names no job/.test(${status})`);
  },
  async 'of two meshes asked for one after the other the second is shown'() {
    await browser.openFile('#file', large);
    await browser.evaluate(`(location.hash = '#${job}', 0)`);
    await until(`${state} === 'ready'`);
    assert.equal(await hexes(), 27);
    await set('by', 'x'), await set('at', '0.5');
    await until(`${status}.startsWith('18 of 27')`);
    assert.equal(await faces(), 42);
  },
  async 'a million hexes are shown, and the page answers meanwhile'() {
    await browser.openFile('#file', large);
    await until(`${state} === 'working'`);
    const answers = await until(settled);
    assert.equal(await browser.evaluate(state), 'ready');
    assert.equal(await hexes(), 1000000);
    assert.equal(await faces(), 60000);
    console.log(`the page answered ${answers} times meanwhile`);
    assert.ok(answers > 2);
    await set('by', 'y'), await set('at', '0.5');
    await until(`${status}.startsWith('500\u202f000 of')`);
    assert.equal(await faces(), 40000);
  },
};

let done = 0;
try {
  for (const [name, test] of Object.entries(tests)) {
    console.log(name);
    await test();
    assert.deepEqual(browser.errors, []);
    done++;
  }
} catch (error) {
  console.log(`not as it should be: ${error.stack}\n${await browser.evaluate(`${state} + ': ' + ${status}`).catch(String)}`);
  await browser.picture(`${folder}/page.png`).catch(() => {});
  process.exitCode = 1;
}
await browser.close();
console.log(`${done} of ${Object.keys(tests).length}`);
