// The page: which of its views is shown, document.body.dataset.view: list (of jobs), job (progress or report) or mesh; by the address: #<id> of a job, #<id>/report, or none.
import { $, tell, useToken } from './dom.mjs';
import { ended, JobPage, stateOf } from './job.mjs';
import { JobList } from './list.mjs';
import { MeshView } from './viewer.mjs';

const MESH = 'hexmesh.bwh';
const FILE = '#file'; // the address while a file from disk is shown, so that the way back to the list is one to another

let wish = { id: '', report: false }, shown = ''; // shown: the job whose mesh is in the view
const list = new JobList();

function view(name) {
  document.body.dataset.view = name;
  list.show(name === 'list');
}

function fail(text) {
  shown = '';
  mesh.forget();
  view('list');
  tell('failed', text);
}

const mesh = new MeshView({
  said: (state, text) => document.body.dataset.view === 'mesh' && tell(state, text),
  failed: text => (document.body.dataset.view === 'mesh' ? fail(text) : (shown = '')),
});
const job = new JobPage({ moved: tellJob, atEnd: showResult, lost: fail });

// ---- a job

function tellJob(now) {
  if (!ended(now)) tell('waiting', `${now.name || now.id}: ${stateOf(now)}`);
}

function link(id, hasMesh) {
  $('toMesh').href = `#${id}`, $('toReport').href = `#${id}/report`;
  $('toMesh').hidden = !hasMesh, $('toReport').hidden = !id;
}

// A job has ended: its mesh, if it has one and is not asked for its report, or else what is known of it.
function showResult(now, results) {
  const file = results.find(f => f.name === MESH);
  link(now.id, Boolean(file));
  if (file && !wish.report && !mesh.trouble) {
    view('mesh');
    shown = now.id;
    mesh.load({ url: new URL(file.href.slice(1), document.baseURI).href });
  } else {
    const text = now.state !== 'successful' ? stateOf(now) : wish.report ? 'its report' : `its report; ${file ? mesh.trouble : 'there is no hex mesh to show'}`;
    tell(now.state === 'failed' ? 'failed' : 'ready', `${now.name || now.id}: ${text}`);
  }
}

function follow() {
  const [, id = '', report = ''] = /^#([0-9a-f]{24})(\/report)?$/.exec(location.hash) || [];
  const same = id && id === shown && wish.id === id;
  wish = { id, report: report !== '' };
  if (same && !report) {
    job.stop();
    view('mesh'), mesh.say();
    return;
  }
  if (!report) shown = '', mesh.forget();
  job.stop();
  view(id ? 'job' : 'list');
  if (id) {
    link(id, shown === id);
    tell('waiting', 'Loading \u2026');
    job.follow(id);
  } else if (location.hash.length > 1 && location.hash !== FILE) fail('The address names no job: #, then the job\u2019s id');
  else tell('empty', 'Choose a job, or open a file');
}

$('access').addEventListener('submit', event => {
  event.preventDefault(); // it goes nowhere but into the headers of requests
  useToken($('token').value);
});

function openFile() {
  const [file] = $('file').files;
  if (!file) return;
  $('file').value = ''; // so that the same file can be chosen again
  job.stop();
  history.pushState(null, '', FILE);
  shown = '', wish = { id: '', report: false };
  view('mesh');
  link('', false);
  mesh.load({ file });
}

$('file').addEventListener('change', openFile);
addEventListener('hashchange', follow);
follow();
