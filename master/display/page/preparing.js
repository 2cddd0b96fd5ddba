// The page of a model that is being preprocessed: shows the progress, and becomes the viewer at the end.

import { removeToken } from './link.js';

const $ = (id) => document.getElementById(id);
const EVERY_MS = 1000;

removeToken();

const ask = (path) => fetch(new URL(path, document.baseURI), { cache: 'no-store' });

function remaining(seconds) {
  if (!Number.isFinite(seconds)) return '';
  if (seconds < 60) return `about ${Math.max(1, Math.round(seconds))} s left`;
  if (seconds < 5400) return `about ${Math.round(seconds / 60)} min left`;
  return `about ${(seconds / 3600).toFixed(1)} h left`;
}

function show({ step, done, eta_s: eta, message, failed }) {
  document.title = failed ? 'Quarry: the model could not be prepared' : `Quarry: ${Math.floor(done * 100)} % prepared`;
  $('title').textContent = failed ? 'The model could not be prepared' : 'The model is being prepared';
  $('step').textContent = step;
  $('message').textContent = message ?? '';
  $('bar').hidden = failed;
  $('bar').value = done;
  $('numbers').textContent = failed ? '' : [`${Math.floor(done * 100)} %`, remaining(eta ?? NaN)].filter(Boolean).join(', ');
}

/// Whether another page has replaced this one: the viewer, or the page that asks for the token.
async function isReady() {
  try {
    const health = await ask('healthz');
    return health.ok && [403, 404].includes((await ask('progress')).status);
  } catch {
    return false;
  }
}

async function poll() {
  try {
    const answer = await ask('progress');
    if (answer.ok) return show(await answer.json());
  } catch {
    $('numbers').textContent = 'Waiting for the server.';
  }
  if (await isReady()) location.reload();
}

/// Polls again and again; a slow answer delays the next question.
async function run() {
  for (;;) {
    await poll();
    await new Promise((resolve) => setTimeout(resolve, EVERY_MS));
  }
}
run();
