// The page in a real browser: node page_test.mjs CHROMIUM FOLDER URL JOB DAMAGED.bwh LARGE.bwh. Prints what it saw; exit 1 at the first thing that is not as it should be.
import assert from 'node:assert/strict';
import { Browser } from './browser.mjs';

const [program, folder, url, job, damaged, large] = process.argv.slice(2);
const settled = `document.body.dataset.state !== 'working'`, state = `document.body.dataset.state`, status = `document.getElementById('status').textContent`;
const browser = await Browser.open(program, `${folder}/profile`, url);

const set = (id, value) => browser.evaluate(`(${id}.value = ${JSON.stringify(value)}, ${id}.dispatchEvent(new Event('input')), 0)`);
const faces = async () => Number(/([\d\u202f]+) faces/.exec(await browser.evaluate(status))[1].replaceAll('\u202f', ''));
const hexes = async () => Number(/^([\d\u202f]+) of/.exec(await browser.evaluate(status))[1].replaceAll('\u202f', ''));
const until = expression => browser.until(expression);

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

const tests = {
  async 'the page lists the job, and its link shows the mesh'() {
    await until(`document.querySelector('#list a')`);
    assert.equal(await browser.evaluate(`document.querySelector('#list a').getAttribute('href')`), `#${job}`);
    assert.equal(await browser.evaluate(state), 'empty');
    await browser.evaluate(`document.querySelector('#list a').click()`);
    await until(`${state} === 'ready'`);
    assert.equal(await hexes(), 27);
    assert.equal(await faces(), 54);
    assert.match(await browser.evaluate(`counts.textContent`), /^27 hexes, 64 vertices, 1 blocks?$/);
    assert.equal(await browser.evaluate(`histogram.children.length`), 20);
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
    await set('by', 'k'), await set('at', '0.67');
    await until(`${status}.startsWith('9 of 27')`);
    assert.equal(await faces(), 30);
    await set('by', '');
    await until(`${status}.startsWith('27 of 27')`);
    await set('below', '0.5');
    await until(`${status}.startsWith('0 of 27')`);
    assert.equal(await faces(), 0);
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
    browser.errors.length = 0; // the browser's own line about the 404
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
