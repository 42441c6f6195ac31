// One job: how far it is, the best that its search has found so far, the buttons to settle for that or to cancel; why it failed; its report and its files. The job is
// asked for when its stream of events says that something has changed, until it has ended.
import { $, call, el, Refused, save } from './dom.mjs';
import { kindFound, sectionsOf } from './report.mjs';
import { Stream } from './stream.mjs';
import { bytes, counted, seconds } from './text.mjs';

const SOON = 50, OFTEN = 500, SELDOM = 5000; // milliseconds until it is asked for: after news, when the stream of news was cut, while nobody looks or the daemon does not answer
const SEARCHES = 'reduce';        // the stage that searches when the option `explore` asks for it

export const ended = job => job.state !== 'queued' && job.state !== 'running';

/** State in a few words. */
export function stateOf(job) {
  if (job.cancelling) return 'is being cancelled';
  if (job.state === 'dismissed') return 'cancelled';
  return job.state === 'running' ? `running, ${Math.floor(100 * job.progress)} %` : job.state;
}

/** A search runs that can be asked to settle for what it has. */
const canFinish = job => job.state === 'running' && job.stage === SEARCHES && job.options.explore !== 'none' && !job.finishing && !job.cancelling;

// ---- the parts of the page

const tableOf = ({ head, lines }) => el('table', {}, el('thead', {}, el('tr', {}, ...head.map(text => el('th', {}, text)))),
  el('tbody', {}, ...lines.map(([name, ...cells]) => el('tr', {}, el('th', {}, name), ...cells.map(text => el('td', {}, text))))));

const rowsOf = rows => el('dl', {}, ...rows.flatMap(([label, text]) => [el('dt', {}, label), el('dd', {}, text)]));

const sectionOf = ({ title, rows, table, more }) => el('section', {}, el('h3', {}, title), rows.length ? rowsOf(rows) : null,
  ...[table, more].map(t => t && t.lines.length && tableOf(t)).filter(t => t));

// The tries so far, and the stage that is next.
function attemptsOf(job) {
  const lines = job.attempts.map(a => [a.stage, a.outcome ? (a.reused ? 'made before' : a.outcome) : 'running',
    a.finished && !a.reused ? seconds((new Date(a.finished) - new Date(a.started)) / 1000) : '']);
  if (!ended(job) && lines.at(-1)?.[1] !== 'running') lines.push([job.stage, 'waiting', '']);
  return { head: ['stage', '', 'time'], lines };
}

const placeOf = e => `${e.kind} ${e.id}${e.position ? ` at ${e.position.map(x => Number(x.toPrecision(6))).join(', ')}` : ''}`;

function failureOf(failure) {
  const places = (failure.elements || []).map(e => el('li', {}, placeOf(e))), more = (failure.element_count || 0) - places.length;
  return el('section', {}, el('h3', {}, 'Why it failed'), el('p', { className: 'trouble' }, failure.detail || failure.title),
    el('p', {}, `${failure.title} (${failure.type.split('/').at(-1)}${failure.stage ? `, stage ${failure.stage}` : ''})`),
    places.length ? el('ul', {}, ...places, more > 0 && el('li', {}, `and ${counted(more, 'more', 'more')}`)) : null);
}

const complain = text => ($('trouble').textContent = text);

const fileOf = f => el('tr', {}, el('th', {}, el('a', { href: f.href.slice(1), download: f.name, onclick: event => save(event, f.name, complain) }, f.name)), el('td', {}, bytes(f.bytes)));

const filesOf = results => el('section', {}, el('h3', {}, 'Files'), el('table', {}, el('tbody', {}, ...results.map(fileOf))));

// What the job is doing, for people.
function doing(job) {
  if (job.cancelling) return 'It is being cancelled.';
  if (job.finishing) return 'It settles for the best found, and goes on with that to its end.';
  if (job.state === 'queued') return 'It waits for its turn.';
  return job.state === 'running' ? `Stage ${job.stage}, ${job.stage_index + 1} of ${job.stage_count}.` : '';
}

// ---- following a job

export class JobPage {
  /** atEnd(job, results) when it has ended, results: the manifest, empty if it was not successful; lost(text) when there is no such job; moved(job) at every answer before. */
  constructor({ atEnd, lost, moved }) {
    Object.assign(this, { atEnd, lost, moved, id: '', run: 0 });
    $('log').addEventListener('click', event => save(event, `${this.id}.log.txt`, complain));
    $('finish').addEventListener('click', () => this.ask('finish'));
    $('cancel').addEventListener('click', () => {
      if (confirm('Cancel this job? Nothing of it is kept, nor is the best that was found so far.')) this.ask('cancel');
    });
    document.addEventListener('visibilitychange', () => !document.hidden && this.timer && this.poll());
  }

  follow(id) {
    this.stop();
    this.id = id, this.asked = false;
    this.stream = new Stream(`v1/jobs/${id}/events`, { hear: (event, data) => this.hear(event, data), over: finished => this.again(finished ? SOON : OFTEN) });
    for (const part of ['notes', 'attempts', 'report']) $(part).replaceChildren();
    for (const part of ['name', 'facts', 'doing', 'trouble']) $(part).textContent = '';
    $('live').hidden = true;
    $('log').href = `v1/jobs/${id}/log`;
    this.poll();
  }

  stop() {
    clearTimeout(this.timer);
    this.stream?.stop();
    this.timer = 0, this.run++, this.id = '';
  }

  async poll() {
    clearTimeout(this.timer);
    const run = ++this.run;
    try {
      const job = await call('GET', `v1/jobs/${this.id}`);
      if (run !== this.run) return;
      if (!this.asked) this.complain('');
      this.show(job);
      if (ended(job)) await this.finishUp(job, run);
      else this.stream.start(); // when it is over the job is asked for
    } catch (error) {
      if (run !== this.run) return;
      if (!(error instanceof Refused)) throw error;
      if (error.status === 404 || error.status === 410) this.lost(error.message); // 410: it was removed
      else {
        if (!this.asked) this.complain(`${error.message}; asking again`);
        this.again(SELDOM);
      }
    }
  }

  again(pause) {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.poll(), document.hidden ? SELDOM : pause);
  }

  /** Progress and notes are shown as they come; after a change of state or stage of the last attempt or a new one the job is asked for. */
  hear(event, data) {
    if (event === 'progress' || event === 'note') this.show(Object.assign(this.job, { stage: data.stage }, data.note ? { note: data.note } : { progress: data.progress }));
    else if (data.attempt >= (this.job.attempts.at(-1)?.attempt || 0)) this.again(SOON);
  }

  complain(text) { complain(text); }

  /** Cancel or finish. What the daemon says against it stays on the page until the next wish. */
  async ask(what) {
    const id = this.id;
    for (const button of ['finish', 'cancel']) $(button).disabled = true;
    this.asked = false, this.complain('');
    try {
      await call('POST', `v1/jobs/${id}/${what}`);
    } catch (error) {
      if (id !== this.id) return;
      this.asked = true;
      this.complain(`${what === 'cancel' ? 'Not cancelled' : 'Not asked to settle'}: ${error.message}`);
    }
    if (id === this.id) this.poll();
  }

  show(job) {
    this.job = job;
    const kind = { tet: 'a tet mesh', hex: 'a hexahedral mesh' }[job.options.kind];
    $('name').textContent = job.name || job.id;
    $('facts').textContent = `${stateOf(job)}; created ${new Date(job.created).toLocaleString()}${kind ? `, for ${kind}` : ''}`;
    $('live').hidden = ended(job);
    $('progress').value = job.progress;
    $('doing').textContent = doing(job);
    if (job.note && $('notes').lastChild?.textContent !== job.note) $('notes').append(el('li', {}, job.note));
    $('best').hidden = ended(job) || !$('notes').childElementCount;
    $('finish').hidden = $('finishHint').hidden = !canFinish(job);
    $('finish').disabled = $('cancel').disabled = Boolean(job.cancelling);
    $('attempts').replaceChildren(tableOf(attemptsOf(job)));
    this.moved(job);
  }

  async finishUp(job, run) {
    clearTimeout(this.timer);
    this.stream.stop();
    let results = [], report = null;
    if (job.state === 'successful') ({ results } = await call('GET', `v1/jobs/${job.id}/results`));
    if (run !== this.run) return;
    if (results.some(f => f.name === 'report.json')) report = await call('GET', `v1/jobs/${job.id}/report`);
    if (run !== this.run) return;
    const kind = kindFound(report);
    if (kind) $('facts').textContent += `; ${kind}`;
    $('report').replaceChildren(...(job.failure ? [failureOf(job.failure)] : []), ...(report ? sectionsOf(report).map(sectionOf) : []), ...(results.length ? [filesOf(results)] : []));
    this.timer = 0;
    this.atEnd(job, results);
  }
}
