// A model while it is read: the preview of `quarry view`, and how it gives way to the viewer or to a sentence.
import assert from 'node:assert/strict';
import fs from 'node:fs';
import os from 'node:os';
import path from 'node:path';
import { spawn, spawnSync } from 'node:child_process';
import { after, before, test } from 'node:test';
import { BIN } from './cluster.mjs';
import { SIZE, apart, errors, launch, open, shoot, viewOf, visit } from './viewing.mjs';

// Software draws the discs: the machine may have no graphics card.
const DRAWS = ['--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--ignore-gpu-blocklist'];
const folder = fs.mkdtempSync(path.join(os.tmpdir(), 'quarry-preview-'));
const model = path.join(folder, 'plant.ply');
const cache = path.join(folder, 'cache');
const AWAY = 500000;
let browser;
const running = [];

/** Moves a model so far from the origin that its scene has an offset: x of each vertex, in place. */
function moveAway(of) {
  const bytes = fs.readFileSync(of), header = bytes.indexOf('end_header\n') + 'end_header\n'.length;
  const count = Number(/element vertex (\d+)/.exec(bytes.toString('latin1', 0, header))[1]), vertex = 15;  // three floats, three bytes
  for (let at = header; at < header + count * vertex; at += vertex) bytes.writeFloatLE(bytes.readFloatLE(at) + AWAY, at);
  fs.writeFileSync(of, bytes);
}

before(async () => {
  const made = spawnSync(path.join(BIN, 'quarry-scene'), ['plant', '--triangles', '2000000', '-o', model, '--quiet'], { encoding: 'utf8' });
  assert.equal(made.status, 0, made.stderr);
  moveAway(model);
  browser = await launch(DRAWS);
});
after(async () => {
  await browser?.close();
  for (const viewing of running) viewing.kill('SIGTERM');
  await Promise.all(running.map((viewing) => viewing.exitCode ?? new Promise((resolve) => viewing.once('exit', resolve))));
  fs.rmSync(folder, { recursive: true });
  assert.deepEqual(errors, []);
});

/** The address of `quarry view` of a model. */
async function view(of) {
  const viewing = spawn(path.join(BIN, 'quarry'), ['view', of, '--http', '127.0.0.1:0', '--quiet', '--threads', '1'],
    { stdio: ['ignore', 'pipe', 'ignore'], env: { ...process.env, QUARRY_CACHE_DIR: cache } });
  running.push(viewing);
  return new Promise((resolve) => viewing.stdout.once('data', (text) => resolve(String(text).trim())));
}
const shown = (page) => page.waitForFunction(() => /^Preview, [\d,]+ of [\d,]+ triangles read$/.test(document.getElementById('shown')?.textContent ?? ''),
  null, { timeout: 60000, polling: 50 });

test('a preview is drawn while the model is read, and becomes the viewer with its camera', async () => {
  const page = await open(browser, await view(model));
  await shown(page);
  await page.evaluate(() => { window.sameDocument = true; });
  const colours = () => page.evaluate(() => {
    const canvas = document.getElementById('discs'), gl = canvas.getContext('webgl2'), bytes = new Uint8Array(canvas.width * canvas.height * 4);
    gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    return new Set(new Uint32Array(bytes.buffer)).size;
  });
  assert.ok(await colours() > 20, 'the preview shows the model');
  await page.mouse.move(320, 200);
  await page.mouse.down();
  await page.mouse.move(400, 210, { steps: 4 });
  await page.mouse.up();
  await shoot(page, 'preview');
  await page.waitForFunction(() => window.quarry && document.getElementById('picture')?.width > 1, null, { timeout: 120000 });
  assert.ok(await page.evaluate(() => window.sameDocument), 'nothing was reloaded');
  // The address follows the camera a little later.
  await page.waitForFunction(() => new URLSearchParams(location.hash.slice(1)).has('eye'), null, { timeout: 20000 });
  const from = new URLSearchParams((await page.evaluate(() => location.hash)).slice(1));
  const { camera } = await viewOf(page);
  assert.ok(Math.abs(camera.at[0] - AWAY) < 1000, `the camera looks at ${camera.at}, near the model`);
  for (const name of ['eye', 'at']) assert.ok(apart(camera[name], from.get(name).split(',').map(Number)) < 1e-6, `the camera kept its ${name}`);
  await page.waitForFunction(() => !document.getElementById('discs'), null, { timeout: 20000 });
  await shoot(page, 'after-preview');
  await page.context().close();
});

test('a model that fails at its last byte takes the page to a sentence, and leaves no store', async () => {
  const broken = path.join(folder, 'broken.ply');
  fs.writeFileSync(broken, fs.readFileSync(model).subarray(0, -1));
  const page = await open(browser, await view(broken));
  await page.waitForFunction(() => document.getElementById('title').textContent === 'The model could not be prepared', null, { timeout: 60000 });
  assert.match(await page.locator('#message').innerText(), /could not be preprocessed/);
  assert.equal(await page.locator('#stage').isVisible(), false);
  await shoot(page, 'failed-preview');
  assert.deepEqual(fs.readdirSync(cache).filter((name) => /broken.*\.quarry$/.test(name)), []);
  await page.context().close();
});

test('a browser that cannot draw the preview says so, and still becomes the viewer', async () => {
  fs.rmSync(cache, { recursive: true });
  const context = await browser.newContext({ viewport: SIZE });
  await context.addInitScript(() => {
    const own = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...more) { return kind === 'webgl2' ? null : own.call(this, kind, ...more); };
  });
  const page = await visit(context, await view(model));
  await page.waitForFunction(() => /^No preview: no WebGL 2$/.test(document.getElementById('shown')?.textContent ?? ''), null, { timeout: 60000, polling: 50 });
  await page.waitForFunction(() => window.quarry?.view() != null, null, { timeout: 120000 });
  await page.context().close();
});
