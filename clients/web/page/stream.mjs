// Streams of what happens, as the daemon tells them: server-sent events. (EventSource shows no access token.)
import { credentials } from './dom.mjs';

const fieldsOf = block => {
  const event = { event: 'message', data: '' };
  for (const line of block.split('\n')) {
    const [, name, value] = /^(\w+): ?(.*)$/.exec(line) || [];
    if (name === 'data') event.data += (event.data && '\n') + value;
    else if (name) event[name] = value;
  }
  return event;
};

/** The answer, or null: there is none, or it is no stream. */
async function open(path, last, signal) {
  const headers = { ...credentials(), Accept: 'text/event-stream', ...(last && { 'Last-Event-ID': last }) };
  const answer = await fetch(new URL(path, document.baseURI), { cache: 'no-store', headers, signal }).catch(() => null);
  return answer?.status === 200 && answer.headers.get('Content-Type')?.startsWith('text/event-stream') ? answer : null;
}

/** The events of an answer until it ends or is cut. */
async function* eventsOf(answer) {
  const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader(), more = () => reader.read().catch(() => ({ done: true }));
  for (let text = '', piece; !(piece = await more()).done;) {
    const blocks = (text + piece.value).split('\n\n');
    text = blocks.pop();
    yield* blocks.map(fieldsOf);
  }
}

/** One stream, followed by start() until it is over or stop(); started again it goes on after the last event seen. */
export class Stream {
  /** opened(resumed) once the daemon has answered, resumed: with what came after the last event seen; hear(event, data) for every event; over(ended) when there is no more: the daemon has said that
   * it ends, or (false) it was cut or there is none. */
  constructor(path, { opened = () => {}, hear, over }) {
    Object.assign(this, { path, opened, hear, over, last: '', runs: false, cut: new AbortController() });
  }

  async start() {
    const { signal } = this.cut;
    if (this.runs || signal.aborted) return;
    this.runs = true;
    let ended = false;
    const answer = await open(this.path, this.last, signal);
    if (answer && !signal.aborted) this.opened(this.last !== '');
    for await (const { id, event, data } of answer ? eventsOf(answer) : []) {
      if (signal.aborted) return;
      if (id) this.last = id;
      if (event === 'end') ended = true;
      else if (data) this.hear(event, JSON.parse(data));
    }
    if (signal.aborted) return;
    this.runs = false;
    this.over(ended);
  }

  /** Lets go of what there is, if anything, and starts again. */
  renew() {
    this.cut.abort();
    this.cut = new AbortController(), this.runs = false;
    this.start();
  }

  stop() { this.cut.abort(); }
}
