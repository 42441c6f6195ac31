// The list of jobs: asked for once, and then told by the daemon's stream of all jobs' events, row by row. Only while there is no stream it is asked for again and again.
import { $, call, el } from './dom.mjs';
import { ended, stateOf } from './job.mjs';
import { Stream } from './stream.mjs';

const ROWS = 50;
const OFTEN = 2000;             // milliseconds until all of it is asked for again while there is no stream
const SELDOM = 60000;           // while there is one: it does not tell of jobs that were removed
const SOON = 100, FEW = 3;      // new jobs of so long are asked for together; up to so many one by one, more as a new list
const AGAIN = 1000, AGAIN_MOST = 30000; // until the stream is asked for again; doubled each time
const MISSED_MOST = 60000;      // after so long without a stream what happened is not told one by one

const rest = job => (job.state === 'running' && !job.cancelling ? `running, stage ${Math.min(job.stage_index + 1, job.stage_count)} of ${job.stage_count}` : stateOf(job));

function describe(item, job) {
  const { id, name, created } = job, line = ` ${rest(job)}, ${new Date(created).toLocaleString()}`, text = `${name || id}\n${line}`;
  if (item.dataset.text === text) return; // who is on the link stays there
  item.dataset.text = text;
  item.replaceChildren(el('a', { href: `#${id}` }, name || id), line);
}

export class JobList {
  constructor() {
    Object.assign(this, { shown: false, stream: null, rows: new Map(), fresh: [], early: new Set(), timer: 0, again: 0, soon: 0 });
    document.addEventListener('visibilitychange', () => this.turn());
  }

  /** Is the list to be seen now? */
  show(shown) {
    this.shown = shown;
    this.turn();
  }

  turn() {
    const wanted = this.shown && !document.hidden;
    if (wanted && !this.stream) this.begin();
    if (!wanted && this.stream) this.end();
  }

  begin() {
    this.pause = AGAIN, this.polls = this.silent = false, this.cut = 0;
    this.stream = new Stream('v1/events', { opened: resumed => this.opened(resumed), hear: (_, data) => this.hear(data), over: () => this.over() });
    this.stream.start();
  }

  end() {
    for (const timer of [this.timer, this.again, this.soon]) clearTimeout(timer);
    this.stream.stop();
    this.stream = null, this.fresh = [], this.soon = 0;
    this.early.clear();
  }

  // ---- the stream

  opened(resumed) {
    this.polls = false, this.pause = AGAIN;
    if (!resumed) this.ask();
    else this.complain(''), this.askIn(SELDOM);
  }

  over() {
    if (!this.polls) this.polls = true, this.cut = Date.now(), this.ask();
    this.again = setTimeout(() => this.take(Math.min(2 * this.pause, AGAIN_MOST)), this.pause);
  }

  /** Asks for the stream again; if in vain, once more after `pause`. */
  take(pause) {
    clearTimeout(this.again);
    this.pause = pause;
    if (Date.now() - this.cut > MISSED_MOST) this.stream.last = '';
    this.stream.renew();
  }

  hear(data) {
    const row = this.rows.get(data.job);
    for (const early of this.early) early.push(data); // an answer that is under way may be of before
    if (!row && data.change === 'queued' && !this.fresh.includes(data.job)) this.fresh.push(data.job), this.soon ||= setTimeout(() => this.add(), SOON);
    if (!row) return; // an old one, below the last row
    const { state, stages_done, stage_count } = data, cancelling = !ended(data) && (data.change === 'cancelling' || row.job.cancelling);
    Object.assign(row.job, { state, stage_count, stage_index: stages_done, cancelling });
    describe(row.item, row.job);
  }

  // ---- rows

  put(job) {
    const row = this.rows.get(job.id) || { item: el('li') };
    row.job = job;
    row.item.dataset.id = job.id;
    this.rows.set(job.id, row);
    describe(row.item, job);
    return row.item;
  }

  /** New jobs come in on top, where they belong by age. */
  async add() {
    const { stream, fresh } = this;
    this.fresh = [], this.soon = 0;
    if (fresh.length > FEW) return this.ask();
    for (const id of fresh.filter(one => !this.rows.has(one))) {
      const early = this.expect(), job = await call('GET', `v1/jobs/${id}`).catch(error => error);
      if (stream !== this.stream) return;
      this.early.delete(early);
      if (job instanceof Error) this.askIn(OFTEN); // it has gone, or this is no time to ask
      if (job instanceof Error || this.rows.has(id)) continue;
      const item = this.put(job), before = [...$('list').children].find(other => this.rows.get(other.dataset.id).job.created <= job.created);
      $('list').insertBefore(item, before || null);
      while ($('list').childElementCount > ROWS) this.rows.delete($('list').lastChild.dataset.id), $('list').lastChild.remove();
      early.forEach(data => this.hear(data));
    }
    $('none').hidden = this.rows.size > 0;
  }

  /** All of them: rows that are as they were are left alone. */
  async ask() {
    const { stream } = this, early = this.expect();
    this.askIn(this.polls ? OFTEN : SELDOM);
    const answer = await call('GET', `v1/jobs?limit=${ROWS}`).catch(error => error);
    if (stream !== this.stream) return;
    this.early.delete(early);
    this.complain(answer instanceof Error ? answer.message : '');
    const back = this.silent && !(answer instanceof Error);
    this.silent = answer instanceof Error;
    if (answer instanceof Error) return this.askIn(OFTEN);
    if (back) this.take(AGAIN); // whatever became of it meanwhile
    const items = answer.jobs.map(job => this.put(job)), there = new Set(items);
    for (const [id, { item }] of this.rows) if (!there.has(item)) this.rows.delete(id);
    if (items.length !== $('list').childElementCount || items.some((item, i) => item !== $('list').children[i])) $('list').replaceChildren(...items);
    $('none').hidden = items.length > 0;
    early.forEach(data => this.hear(data));
  }

  askIn(pause) {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.ask(), pause);
  }

  /** Where to keep what is heard until an answer has come, to be heard then once more. */
  expect() {
    const early = [];
    this.early.add(early);
    return early;
  }

  complain(text) { $('listTrouble').textContent = text; }
}
