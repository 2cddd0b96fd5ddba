// Views as data: their form in messages and in the URL's fragment. No DOM.
//
// In the page a view's camera always has `fov`, and also `ortho` while it is orthographic. In messages it has one of
// them. A fragment names the members that differ from the default:
// #eye=1,2,3&at=0,0,0&up=0,0,1&fov=60&ortho=4&mode=voxels&spp=16&noise=0.05&ev=-1&tone=film&bg=0,0,0&axis=y&edges=yes
// The members "hide", "only", "colors", "section" and "environment" stand there as JSON.

import { cross, distance, length, subtract } from './vectors.js';

import { sectionOf } from './section/cut.js';
import { partsOf } from './parts/shown_parts.js';

const DEFAULT_FOV = 45;
/// Members by which a view looks inside the model.
export const INSIDE = ['hide', 'only', 'colors', 'section'];
const MOST_TURN = 3600, MOST_STRENGTH = 1e6, MOST_FOV = 179, MOST_SPP = 65536, MOST_EV = 100, LEAST_NOISE = 1e-4;
/// Of a view with a noise: the fewest samples, and the limit of one that names none or too few.
export const LEAST_NOISE_SPP = 17, NOISE_SPP = 4096;

/// The members of the server's default view that the page shows and sends. Lights and the like are left out: the server
/// uses its own values for missing members, and a scene's lights could be longer than a message.
export function ownMembers({ mode, spp, noise, exposure, tonemap, background, up_axis, edges }) {
  return Object.fromEntries(Object.entries({ mode, spp, noise, exposure, tonemap, background, up_axis, edges }).filter(([, value]) => value !== undefined));
}

/// The page's form of a camera from a message.
export function fromWire(camera) {
  return { up: [0, 0, 1], ...camera, fov: camera.fov ?? DEFAULT_FOV };
}

/// The environment of a name or a place among the server's, or undefined.
export function skyOf(name, environments) { return environments?.find((one) => one.name === name || one.store === name); }

/// The view in the form of `quarry render --view`. With the server's `environments` it names the place of its own, so
/// that it can be rendered without this server too.
export function toFile(view, environments) {
  const { fov, ortho, ...place } = view.camera, sky = view.environment && skyOf(view.environment.name, environments);
  const own = sky ? { environment: { ...view.environment, name: sky.store } } : {};
  return { ...view, ...own, camera: ortho > 0 ? { ...place, ortho } : { ...place, fov } };
}

/// The view in the server's form, without its lists of parts: the server knows them as a selection.
export function toWire(view) {
  const { hide, only, colors, ...rest } = toFile(view);
  return rest;
}

/// A view from a file or a link: of its lists of parts and its section, the valid ones. `dropped`: names of the others.
export function checkedInside(view) {
  const own = { ...view, hide: undefined, only: undefined, colors: undefined, ...partsOf(view), section: sectionOf(view.section), environment: environmentOf(view.environment) };
  const dropped = INSIDE.filter((name) => view[name] !== undefined && own[name] === undefined && !(name !== 'only' && Array.isArray(view[name]) && view[name].length === 0));
  return { view: Object.fromEntries(Object.entries(own).filter(([, value]) => value !== undefined)), dropped };
}

/// An environment of a file or a link, or undefined where it is invalid.
export function environmentOf(given) {
  if (typeof given?.name !== 'string' || !given.name) return undefined;
  const isNumber = (x, least, most) => x === undefined || (Number.isFinite(x) && x >= least && x <= most);
  if (!isNumber(given.turn, -MOST_TURN, MOST_TURN) || !isNumber(given.strength, 1e-6, MOST_STRENGTH)) return undefined;
  return Object.fromEntries(['name', 'turn', 'strength'].filter((name) => given[name] !== undefined).map((name) => [name, given[name]]));
}

/// Whether a camera is valid.
export function isSane(camera) {
  const isPoint = (p) => Array.isArray(p) && p.length === 3 && p.every(Number.isFinite);
  if (![camera.eye, camera.at, camera.up].every(isPoint) || !(distance(camera.eye, camera.at) > 0)) return false;
  if (!(camera.fov > 0 && camera.fov <= MOST_FOV) || (camera.ortho !== undefined && !(camera.ortho > 0))) return false;
  return length(cross(subtract(camera.at, camera.eye), camera.up)) > 0;
}

function numbers(text, count, least = -Infinity) {
  const list = (text ?? '').split(',').map((part) => (part.trim() === '' ? NaN : Number(part)));
  return list.length === count && list.every((x) => Number.isFinite(x) && x >= least) ? list : null;
}

function parsed(text) {
  try {
    return JSON.parse(text);
  } catch {
    return undefined;
  }
}

/// Applies a fragment to the default view. Invalid members of a fragment are ignored. `modes`: names of the server's
/// modes.
export function fromFragment(fragment, defaults, modes) {
  const given = new URLSearchParams(fragment.replace(/^#/, ''));
  const view = { ...defaults };
  const camera = { ...defaults.camera };
  for (const name of ['eye', 'at', 'up']) camera[name] = numbers(given.get(name), 3) ?? camera[name];
  camera.fov = numbers(given.get('fov'), 1)?.[0] ?? camera.fov;
  const ortho = numbers(given.get('ortho'), 1)?.[0];
  if (ortho === 0) delete camera.ortho;
  else if (ortho) camera.ortho = ortho;
  if (isSane(camera)) view.camera = camera;
  if (modes.includes(given.get('mode'))) view.mode = given.get('mode');
  const spp = numbers(given.get('spp'), 1, 1)?.[0];
  if (Number.isInteger(spp) && spp <= MOST_SPP) view.spp = spp;
  const noise = numbers(given.get('noise'), 1, LEAST_NOISE)?.[0];
  if (given.get('noise') === 'no') delete view.noise;
  else if (noise <= 1) view.noise = noise;
  if (view.noise && !(view.spp >= LEAST_NOISE_SPP)) view.spp = NOISE_SPP;
  const exposure = numbers(given.get('ev'), 1)?.[0];
  if (given.get('ev') === 'auto') delete view.exposure;
  else if (exposure !== undefined && Math.abs(exposure) <= MOST_EV) view.exposure = exposure;
  if (['clip', 'film'].includes(given.get('tone'))) view.tonemap = given.get('tone');
  if (['y', 'z'].includes(given.get('axis'))) view.up_axis = given.get('axis');
  view.background = numbers(given.get('bg'), 3, 0) ?? view.background;
  if (['yes', 'no'].includes(given.get('edges'))) view.edges = given.get('edges') === 'yes';
  for (const name of INSIDE) if (given.has(name)) view[name] = parsed(given.get(name));
  const environment = environmentOf(parsed(given.get('environment')));
  if (environment) view.environment = environment;
  return checkedInside(view).view;
}

/// The fragment of a view, with "#"; empty for the default view.
export function toFragment(view, defaults) {
  const parts = [];
  const put = (name, value, standard) => {
    if (String(value) !== String(standard)) parts.push(`${name}=${encodeURIComponent(value).replaceAll('%2C', ',')}`);
  };
  const { camera } = view, home = defaults.camera;
  // A link holds the whole camera, so that another default cannot change a part of it.
  if (['eye', 'at', 'up'].some((name) => String(camera[name]) !== String(home[name]))) {
    for (const name of ['eye', 'at', 'up']) put(name, camera[name], '');
  }
  put('fov', camera.fov, home.fov);
  put('ortho', camera.ortho ?? 0, home.ortho ?? 0);
  put('mode', view.mode, defaults.mode);
  put('spp', view.spp, defaults.spp);
  put('noise', view.noise ?? 'no', defaults.noise ?? 'no');
  put('ev', view.exposure ?? 'auto', defaults.exposure ?? 'auto');
  put('tone', view.tonemap ?? '', defaults.tonemap ?? '');
  put('axis', view.up_axis ?? '', defaults.up_axis ?? '');
  put('bg', view.background ?? '', defaults.background ?? '');
  if (Boolean(view.edges) !== Boolean(defaults.edges)) put('edges', view.edges ? 'yes' : 'no', '');
  for (const name of [...INSIDE, 'environment']) if (view[name]) put(name, JSON.stringify(view[name]), '');
  return parts.length ? '#' + parts.join('&') : '';
}

/// The size of a view in pixels: `wanted` times `share`, kept within the server's limits.
export function limitedSize(wanted, share, limits) {
  const [width, height] = wanted.map((x) => Math.max(1, x * share));
  const fit = Math.min(1, limits.most_side / Math.max(width, height), Math.sqrt(limits.most_pixels / (width * height)));
  return [width, height].map((x) => Math.max(1, fit === 1 ? Math.round(x) : Math.floor(x * fit)));
}
