// The page of a model that is being preprocessed: shows the progress and a preview, and becomes the viewer at the end, in
// the same document and with the same camera.

import { removeToken } from './link.js';
import { Preview } from './preview.js';

const $ = (id) => document.getElementById(id);
const EVERY_MS = 1000, EARLY_MS = 250, EARLY_FOR_MS = 15000;

removeToken();

const ask = (path) => fetch(new URL(path, document.baseURI), { cache: 'no-store' });
const began = performance.now();
let preview = null;  // false: this browser cannot draw it
let isLooking = false, isDone = false;
let drawn = '';  // the state of the discs that are shown

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
  if (failed) {
    document.body.className = 'notice';
    $('stage').hidden = true;
    $('shown').textContent = '';
    preview = false;
  }
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

/// Shows the discs of what has been read, if there are newer ones.
async function look() {
  if (preview === false || isDone) return;
  const answer = await ask(`discs?seen=${drawn}`);
  if (answer.status !== 200) return;  // 204: nothing new
  const buffer = await answer.arrayBuffer();
  if (preview === false || isDone) return;
  try {
    $('stage').hidden = false;
    preview ??= new Preview($('stage'));
  } catch (error) {
    preview = false;
    $('stage').hidden = true;
    $('shown').textContent = `No preview: ${error.message}`;
    return;
  }
  const discs = preview.take(buffer);
  if (!discs) return;
  drawn = answer.headers.get('ETag');
  document.body.className = 'viewer previewing';
  $('shown').textContent = `Preview, ${discs.count.toLocaleString('en')} of ${discs.triangles.toLocaleString('en')} triangles read`;
}

/// Looks beside the polls: on a slow line discs take seconds.
function lookSoon() {
  if (isLooking) return;
  isLooking = true;
  look().catch(() => {}).finally(() => { isLooking = false; });
}

/// Puts the viewer in the place of this page. The preview stays behind its picture until there is one.
async function become() {
  isDone = true;
  const answer = await ask('');
  const page = new DOMParser().parseFromString(await answer.text(), 'text/html');
  const isViewer = answer.ok && page.querySelector('script[src="main.js"]');
  if (!isViewer || !preview?.isShown) return location.reload();
  const canvas = $('discs');
  // The view of a link comes first, then a camera that somebody has moved, then the viewer's own.
  history.replaceState(null, '', location.pathname + location.search + (location.hash || preview.fragment()));
  document.title = page.title;
  document.body.className = page.body.className;
  document.body.replaceChildren(...document.adoptNode(page.body).childNodes);
  $('stage').prepend(canvas);
  const picture = $('picture');
  new MutationObserver((_, observer) => {
    if (picture.width <= 1) return;
    observer.disconnect();
    requestAnimationFrame(() => canvas.remove());
  }).observe(picture, { attributes: true });
  await import(new URL('main.js', document.baseURI));
}

/// Asks once. Returns whether the page is done.
async function poll() {
  try {
    const answer = await ask('progress');
    if (answer.ok) {
      show(await answer.json());
      lookSoon();
      return false;
    }
  } catch {
    $('numbers').textContent = 'Waiting for the server.';
  }
  if (!await isReady()) return false;
  try {
    await become();
  } catch {
    location.reload();
  }
  return true;
}

/// Polls again and again; a slow answer delays the next question.
async function run() {
  while (!await poll()) {
    const pause = performance.now() - began < EARLY_FOR_MS ? EARLY_MS : EVERY_MS;
    await new Promise((resolve) => setTimeout(resolve, pause));
  }
}
run();
