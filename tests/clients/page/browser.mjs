// A headless Chromium, spoken to by its debugging protocol over two pipes: no package is needed.
import { spawn } from 'node:child_process';
import { writeFile } from 'node:fs/promises';

const flags = ['--headless=new', '--remote-debugging-pipe', '--no-sandbox', '--no-first-run', '--disable-extensions', '--disable-background-networking',
  '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--window-size=1200,800', '--hide-scrollbars'];

export class Browser {
  static async open(program, folder, url) {
    const b = new Browser();
    b.process = spawn(program, [...flags, `--user-data-dir=${folder}`, 'about:blank'], { stdio: ['ignore', 'ignore', 'ignore', 'pipe', 'pipe'] });
    b.waiting = new Map(), b.next = 1, b.rest = '', b.errors = [];
    b.process.stdio[4].setEncoding('utf8').on('data', text => b.receive(text));
    for (const pipe of [3, 4]) b.process.stdio[pipe].on('error', () => {}); // its end is told by 'exit'
    b.process.on('exit', () => b.waiting.forEach(({ reject }) => reject(new Error('the browser ended'))));
    const { targetInfos } = await b.send('Target.getTargets');
    ({ sessionId: b.session } = await b.send('Target.attachToTarget', { targetId: targetInfos.find(t => t.type === 'page').targetId, flatten: true }));
    for (const domain of ['Page', 'Runtime', 'Log', 'DOM', 'Network']) await b.send(`${domain}.enable`);
    await b.send('Page.navigate', { url });
    await b.until('location.protocol !== "about:" && document.readyState === "complete"');
    return b;
  }

  receive(text) {
    const parts = (this.rest + text).split('\0');
    this.rest = parts.pop();
    for (const message of parts.map(part => JSON.parse(part))) {
      const { id, error, result, method, params } = message;
      if (method === 'Runtime.exceptionThrown') this.errors.push(params.exceptionDetails.exception?.description || params.exceptionDetails.text);
      if (method === 'Log.entryAdded' && params.entry.level === 'error') this.errors.push(`${params.entry.text} ${params.entry.url || ''}`);
      if (!this.waiting.has(id)) continue;
      const { resolve, reject } = this.waiting.get(id);
      this.waiting.delete(id);
      if (error) reject(new Error(error.message));
      else resolve(result);
    }
  }

  send(method, params = {}) {
    const id = this.next++;
    this.process.stdio[3].write(JSON.stringify({ id, method, params, ...(this.session && { sessionId: this.session }) }) + '\0');
    return new Promise((resolve, reject) => this.waiting.set(id, { resolve, reject }));
  }

  async evaluate(expression) {
    const { result, exceptionDetails } = await this.send('Runtime.evaluate', { expression, awaitPromise: true, returnByValue: true });
    if (exceptionDetails) throw new Error(exceptionDetails.exception?.description || exceptionDetails.text);
    return result.value;
  }

  // Asks until the expression is true; how often the page answered that it is not yet. What never comes is given up at last.
  async until(expression) {
    for (let answers = 0; ; answers++) {
      if (await this.evaluate(expression)) return answers;
      if (answers === 5000) throw new Error(`never: ${expression}`);
      await new Promise(resolve => setTimeout(resolve, 20));
    }
  }

  async openFile(selector, path) {
    const { root } = await this.send('DOM.getDocument'), { nodeId } = await this.send('DOM.querySelector', { nodeId: root.nodeId, selector });
    await this.send('DOM.setFileInputFiles', { nodeId, files: [path] });
  }

  async drag(from, to) {
    const mouse = (type, [x, y]) => this.send('Input.dispatchMouseEvent', { type, x, y, button: 'left', buttons: 1, clickCount: 1 });
    await mouse('mousePressed', from), await mouse('mouseMoved', to), await mouse('mouseReleased', to);
  }

  async picture(path) {
    const { data } = await this.send('Page.captureScreenshot', { format: 'png' });
    await writeFile(path, Buffer.from(data, 'base64'));
  }

  async close() {
    const ended = new Promise(resolve => this.process.on('exit', resolve));
    this.send('Browser.close').catch(() => {});
    await ended;
  }
}
