// Files of kept views and notes, of views and of camera paths, as text. No DOM.
//
// Kept is {views: [{name, view, measures}], notes: [{text, point, view}]}. A view here is in the form of
// `quarry render --view`, without size.

import { between, isOrthographic } from '../camera.js';
import { fromWire, isSane, toFile } from '../view_state.js';
import { isMeasurement } from '../measure/snap.js';

/// The name of the format in a file of kept views.
const FORMAT = 'quarry kept views', VERSION = 1;
const MOST_NAME = 200, MOST_TEXT = 10000;
/// Most frames of a path: an hour at 30 frames a second.
const MOST_FRAMES = 108000;

export const EMPTY = { views: [], notes: [] };

const isObject = (given) => typeof given === 'object' && given !== null && !Array.isArray(given);
const isText = (given, most) => typeof given === 'string' && given !== '' && given.length <= most;
const isPoint = (given) => Array.isArray(given) && given.length === 3 && given.every(Number.isFinite);
const isView = (view) => isObject(view) && isObject(view.camera) && isSane(fromWire(view.camera));

/// The view as it is kept: the whole of it, but its size.
export function keptView(view) {
  const { size, ...rest } = toFile(view);
  return rest;
}

/// Kept views and notes from a file's object, or a sentence that says why it is none.
export function keptOf(given) {
  const { views, notes } = given;
  if (given.version > VERSION) return 'The file is of a newer version of Quarry.';
  if (!Array.isArray(views) || !Array.isArray(notes)) return 'The file has no lists of views and notes.';
  const isKept = ({ name, view, measures = [] }) => isText(name, MOST_NAME) && isView(view) && Array.isArray(measures) && measures.every(isMeasurement);
  const isNote = ({ text, point, view }) => isText(text, MOST_TEXT) && isPoint(point) && isView(view);
  const bad = views.findIndex((each) => !isObject(each) || !isKept(each));
  if (bad >= 0) return `View ${bad + 1} of the file is not valid.`;
  const wrong = notes.findIndex((each) => !isObject(each) || !isNote(each));
  if (wrong >= 0) return `Note ${wrong + 1} of the file is not valid.`;
  return { views: views.map(({ name, view, measures }) => ({ name, view, measures: measures ?? [] })), notes };
}

export function keptText(kept, scene) {
  return JSON.stringify({ format: FORMAT, version: VERSION, scene: scene.name, scene_id: scene.scene_id, ...kept }, null, 1) + '\n';
}

/// Reads a text: {kept}, {view}, {path} or {error: SENTENCE}; also `scene_id` where the file names one.
export function readFile(text) {
  let given;
  try {
    given = JSON.parse(text);
  } catch {
    return { error: 'The file is not JSON.' };
  }
  if (!isObject(given)) return { error: 'The file holds no view.' };
  if (given.format === FORMAT) {
    const kept = keptOf(given);
    return typeof kept === 'string' ? { error: kept } : { kept, scene_id: given.scene_id };
  }
  if (Array.isArray(given.frames)) {
    const isPath = given.frames.length > 0 && given.frames.length <= MOST_FRAMES && given.frames.every((camera) => isObject(camera) && isSane(fromWire(camera)));
    if (!isPath || !(given.view === undefined || isObject(given.view))) return { error: 'The file’s camera path is not valid.' };
    return { path: { frames: given.frames.map(fromWire), view: given.view } };
  }
  if (given.camera === undefined) return { error: 'The file holds neither a view, nor kept views, nor a camera path.' };
  return isView(given) ? { view: given } : { error: 'The camera of the file is not valid.' };
}

/// The cameras of a path through key cameras: `count` frames from each to the next, at an even pace that slows down at
/// each key.
export function framesThrough(cameras, count, upAxis) {
  const frames = [];
  for (let i = 0; i + 1 < cameras.length; ++i) {
    const from = cameras[i], to = cameras[i + 1];
    for (let frame = 0; frame < count; ++frame) {
      const t = frame / count, eased = t * t * (3 - 2 * t);
      // Two projections have nothing between them: the picture changes in the middle.
      const isCut = isOrthographic(from) !== isOrthographic(to);
      frames.push(isCut ? (t < 0.5 ? from : to) : between(from, to, eased, upAxis));
    }
  }
  return [...frames, ...cameras.slice(-1)];
}
