// What all parts of the page use: its elements, its state, and the daemon's interface.

export const $ = id => document.getElementById(id);

/** A new element: el('a', {href: '#'}, 'text', another). What is null or false is left out. */
export function el(tag, members = {}, ...children) {
  const element = Object.assign(document.createElement(tag), members);
  element.append(...children.filter(child => child || child === 0));
  return element;
}

/** state: empty, waiting (for a job to end), working, ready or failed, in document.body.dataset.state for style and tests; and its line of text. */
export function tell(state, text) {
  document.body.dataset.state = state;
  $('status').textContent = text;
}

// ---- the access token, if the daemon wants one: kept until the tab is closed, for this page only

const TOKEN = 'blockwright-token';
const token = () => sessionStorage.getItem(TOKEN);

/** The headers of a request that the daemon is to know us by. */
export const credentials = () => (token() ? { Authorization: `Bearer ${token()}` } : {});

export function useToken(text) {
  sessionStorage.setItem(TOKEN, text.trim());
  location.reload();
}

/** For a click on a link to a file of the daemon: links show no token, so it is fetched and then saved. */
export async function save(event, name, failed) {
  const { href } = event.currentTarget;
  if (!token()) return;
  event.preventDefault();
  const answer = await fetch(href, { headers: credentials() }).catch(() => null);
  if (!answer?.ok) return failed(`${name}: ${answer ? answer.status : 'the daemon does not answer'}`);
  const url = URL.createObjectURL(await answer.blob());
  el('a', { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 10000);
}

/** A request to the daemon that was refused: `status` is that of HTTP, 0 if it did not answer. */
export class Refused extends Error {
  constructor(status, text) {
    super(text);
    this.status = status;
  }
}

/** The JSON that the daemon answers with; throws Refused with the detail of its problem document. `path` is relative to the page. */
export async function call(method, path) {
  let answer, body = null;
  try {
    answer = await fetch(new URL(path, document.baseURI), { method, cache: 'no-store', headers: credentials() });
    body = await answer.json();
  } catch {
    if (!answer) throw new Refused(0, 'the daemon does not answer');
  }
  if (answer.ok && body) return body;
  if (answer.status === 401) $('access').hidden = false;
  throw new Refused(answer.status, body?.detail || body?.title || `${method} ${path}: ${answer.status} ${answer.statusText}`);
}
