// The page of a daemon that wants an access token, in a real browser: node access_test.mjs CHROMIUM FOLDER URL TOKEN JOB. Exit 1 at the first thing that is not as it should be.
import assert from 'node:assert/strict';
import { Browser } from './browser.mjs';

const [program, folder, url, token, job] = process.argv.slice(2);
const browser = await Browser.open(program, `${folder}/profile`, url);
const link = `document.querySelector('#list a[href="#${job}"]')`;

// The page is loaded anew when a token is entered, perhaps while it is asked.
async function until(expression) {
  for (;;) {
    try {
      return await browser.until(expression);
    } catch (error) {
      if (!/navigated|context/.test(error.message)) throw error;
    }
  }
}

async function enter(text) {
  await browser.evaluate(`($('token').value = ${JSON.stringify(text)}, setTimeout(() => $('access').requestSubmit()), 0)`.replaceAll('$(', 'document.getElementById('));
  await until(`sessionStorage.getItem('blockwright-token') === ${JSON.stringify(text)} && document.readyState === 'complete'`);
}

try {
  await until(`document.getElementById('access')?.checkVisibility()`);
  assert.match(await browser.evaluate(`document.getElementById('listTrouble')?.textContent`), /access token/);
  await enter('bwt_wrong');
  await until(`document.getElementById('access')?.checkVisibility() && /not valid/.test(document.getElementById('listTrouble')?.textContent)`);
  await enter(token);
  await until(link);
  assert.equal(await browser.evaluate(`document.getElementById('access')?.checkVisibility()`), false);
  await browser.evaluate(`${link}.click()`);
  await until(`document.getElementById('name')?.textContent === 'NAME-OF-ALICE'`);
  const log = await browser.evaluate(`new Promise(resolve => {
    const create = URL.createObjectURL;
    HTMLAnchorElement.prototype.click = () => {};
    URL.createObjectURL = blob => (blob.text().then(resolve), create(blob));
    document.getElementById('log').dispatchEvent(new MouseEvent('click', { cancelable: true, bubbles: true }));
  })`);
  assert.match(log, /LOG-OF-ALICE/);
  assert.equal(await browser.evaluate(`location.href.includes('bwt_') || document.cookie !== '' || localStorage.length > 0`), false);
  console.log('the page asks for a token, keeps it to itself, and shows it for lists, jobs and logs');
} finally {
  await browser.close?.();
  browser.process.kill();
}
