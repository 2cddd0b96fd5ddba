// Outputs of the live view: links, views, commands and pictures; and the page that a restarted view lets in again.
import assert from 'node:assert/strict';
import fs from 'node:fs';
import path from 'node:path';
import { spawn, spawnSync } from 'node:child_process';
import { after, before, test } from 'node:test';
import { BIN, Cluster, freePort } from './cluster.mjs';
import { errors, exactOf, launch, open as openIn, shoot, untilExact, viewOf, visit } from './viewing.mjs';

const cluster = new Cluster();
let browser, page;
const open = (url, options) => openIn(browser, url, options);
const link = () => page.evaluate(() => navigator.clipboard.readText());
const toast = of => of.locator('#toast').innerText();

/** Runs a line in a shell that finds the programs, in an empty folder. Returns the content of the file that the line writes. */
function runLine(line, file) {
  const folder = cluster.file(`line-${Math.random()}`);
  fs.mkdirSync(folder);
  const ended = spawnSync('bash', ['-c', line], { cwd: folder, encoding: 'utf8', env: { ...process.env, PATH: `${BIN}:${process.env.PATH}` } });
  assert.equal(ended.status, 0, `${line}\n${ended.stderr}`);
  return fs.readFileSync(path.join(folder, file));
}

/** The name and bytes of the file that the browser saves after a click. */
async function downloadOf(of, button) {
  const [saved] = await Promise.all([of.waitForEvent('download', { timeout: 60000 }), of.click(button)]);
  return { name: saved.suggestedFilename(), bytes: fs.readFileSync(await saved.path()) };
}

async function setSize(of, width, height) {
  await of.fill('#save-width', String(width));
  await of.fill('#save-height', String(height));
}

before(async () => {
  await cluster.begin(100000, "it's a plant (1)");
  for (let i = 0; i < 2; ++i) cluster.addWorker();
  browser = await launch();
  page = await open(cluster.url, { viewport: { width: 1000, height: 700 }, permissions: ['clipboard-read', 'clipboard-write'] });
  await untilExact(page);
  await page.keyboard.press('p');
});

after(async () => {
  await browser?.close();
  await cluster.end();
});

test('a link with access lets a colleague in, and a link without access explains the need', async () => {
  await page.click('#copy-link');
  await page.waitForFunction(() => /with access/.test(document.getElementById('toast').innerText));
  assert.match(await toast(page), /ssh -L/);
  const plain = await link();
  assert.ok(!plain.includes('token'));
  const colleague = await open(plain);
  assert.match(await colleague.locator('body').innerText(), /with access/);
  await shoot(colleague, 'link-without-access');
  await page.click('#copy-access');
  await page.waitForFunction(() => /Anybody with this link/.test(document.getElementById('toast').innerText));
  await shoot(page, 'link-with-access');
  await colleague.goto(await link());
  await untilExact(colleague);
  assert.deepEqual((await viewOf(colleague)).camera, (await viewOf(page)).camera);
  assert.ok(!colleague.url().includes('token'));
  await colleague.context().close();
});

test('without a clipboard, as on pages without encryption, the link is still copied', async () => {
  const context = await browser.newContext({ permissions: ['clipboard-read', 'clipboard-write'] });
  await context.addInitScript(() => Object.defineProperty(navigator, 'clipboard', { value: undefined }));
  const plain = await visit(context, cluster.url);
  await viewOf(plain);
  await plain.keyboard.press('p');
  await plain.click('#copy-link');
  await plain.waitForFunction(() => /copied/.test(document.getElementById('toast').innerText));
  await plain.keyboard.press('Escape');
  await plain.evaluate(() => document.body.append(Object.assign(document.createElement('textarea'), { id: 'pasted' })));
  await plain.focus('#pasted');
  await plain.keyboard.press('Control+v');
  assert.match(await plain.inputValue('#pasted'), /^http:/);
  await context.close();
});

test('view, command and picture of any size are the same picture', async () => {
  await setSize(page, 333, 222);
  const view = await downloadOf(page, '#save-view');
  assert.equal(view.name, "it's a plant (1).view.json");
  fs.writeFileSync(cluster.file('saved.json'), view.bytes);
  cluster.run('quarry', 'render', '-o', cluster.file('of-view.png'), '--view', cluster.file('saved.json'), '--force', '--quiet', cluster.store);
  const expected = fs.readFileSync(cluster.file('of-view.png'));
  const picture = await downloadOf(page, '#save-picture');
  assert.equal(picture.name, "it's a plant (1).png");
  assert.ok(picture.bytes.equals(expected), 'the saved picture is the file of quarry render --view');
  await page.click('#copy-command');
  await page.waitForFunction(() => /command is copied/.test(document.getElementById('toast').innerText));
  assert.ok(runLine(await link(), "it's a plant (1).png").equals(expected), 'the command writes the same file');
  await shoot(page, 'sharing');
});

test('a command contains every setting that differs from the default', async () => {
  const view = await viewOf(page);
  for (const change of [{ mode: 'whitted', spp: 2, exposure: -0.5 }, { background: [0.25, 0, 0.5] }, { camera: { ...view.camera, fov: undefined, ortho: 80 } }]) {
    await page.evaluate(next => window.quarry.setView(next), JSON.parse(JSON.stringify({ ...view, ...change })));
    const exact = await exactOf(page);
    const [width, height] = exact.view.size;
    await setSize(page, width, height);
    await page.click('#copy-command');
    await page.waitForFunction(() => /command is copied/.test(document.getElementById('toast').innerText));
    assert.ok(runLine(await link(), "it's a plant (1).png").equals(exact.png), JSON.stringify(change));
    const picture = await downloadOf(page, '#save-picture');  // the picture on the screen
    assert.ok(picture.bytes.equals(exact.png));
  }
});

test('a picture that cannot be saved gets a sentence, and a long one can be cancelled', async () => {
  await setSize(page, 65536, 65536);
  await page.click('#save-picture');
  await page.waitForFunction(() => /65536x65536 takes/.test(document.getElementById('toast').innerText), null, { timeout: 20000 });
  await setSize(page, 0, 10);
  await page.click('#save-picture');
  assert.match(await toast(page), /1 to 65536/);
  await page.evaluate(view => window.quarry.setView({ ...view, mode: 'ao', spp: 4096 }), await viewOf(page));
  await setSize(page, 1000, 1000);
  await page.click('#save-picture');
  await page.locator('#save-progress').waitFor({ state: 'visible' });
  await shoot(page, 'saving');
  await page.click('#save-cancel');
  await page.locator('#save-progress').waitFor({ state: 'hidden' });
});

/** The process of `quarry view`'s worker. */
async function workerOf(viewing) {
  for (;;) {
    const children = spawnSync('pgrep', ['-P', String(viewing.pid), '-f', 'quarry-worker'], { encoding: 'utf8' }).stdout.trim();
    if (children) return Number(children.split('\n')[0]);
    await new Promise(resolve => setTimeout(resolve, 50));
  }
}

test('a killed worker of a view is named on the page, with the signal, and is started again', async () => {
  const viewing = spawn(path.join(BIN, 'quarry'), ['view', cluster.store, '--http', '127.0.0.1:0', '--quiet'], { stdio: ['ignore', 'pipe', 'ignore'] });
  const url = await new Promise(resolve => viewing.stdout.once('data', text => resolve(String(text).trim())));
  const seen = await open(url);
  await untilExact(seen);
  process.kill(await workerOf(viewing), 'SIGKILL');
  await seen.waitForFunction(() => /Worker local-1 is gone/.test(document.getElementById('overlay').innerText), null, { timeout: 20000 });
  await seen.waitForFunction(() => /Worker local-1 was killed by signal 9, out of memory\? It is started again/.test(document.getElementById('toast').innerText), null, { timeout: 20000 });
  await shoot(seen, 'killed-worker');
  await seen.evaluate(view => window.quarry.setView({ ...view, mode: 'raycast' }), await viewOf(seen));
  await untilExact(seen);
  await seen.context().close();
  const ended = new Promise(resolve => viewing.once('exit', resolve));
  viewing.kill('SIGTERM');
  await ended;
});

test('the saved view of a model with its other axis up has the sun turned, and is the picture on the page', async () => {
  const before = await viewOf(page);
  assert.equal(before.up_axis, undefined);
  await page.selectOption('#up-axis', 'y');
  await page.evaluate(camera => window.quarry.setView({ camera, up_axis: 'y', mode: 'shadow', spp: 1 }), before.camera);
  const exact = await exactOf(page);
  assert.notDeepEqual(exact.view.lights, before.lights);
  const view = await downloadOf(page, '#save-view');
  fs.writeFileSync(cluster.file('turned.json'), JSON.stringify({ ...JSON.parse(view.bytes), size: exact.view.size }));
  cluster.run('quarry', 'render', '-o', cluster.file('turned.png'), '--view', cluster.file('turned.json'), '--force', '--quiet', cluster.store);
  assert.ok(exact.png.equals(fs.readFileSync(cluster.file('turned.png'))));
  await page.selectOption('#up-axis', 'z');
});

test('a restarted view accepts its page again', async () => {
  const port = await freePort();
  const env = { ...process.env, XDG_STATE_HOME: cluster.file('state') };
  const start = () => {
    const viewing = spawn(path.join(BIN, 'quarry'), ['view', cluster.store, '--http', `127.0.0.1:${port}`, '--quiet'], { env, stdio: ['ignore', 'pipe', 'ignore'] });
    return new Promise(resolve => viewing.stdout.once('data', text => resolve([viewing, String(text).trim()])));
  };
  const end = viewing => new Promise(resolve => { viewing.once('exit', resolve); viewing.kill('SIGTERM'); });
  const [first, url] = await start();
  const seen = await open(url);
  await untilExact(seen);
  await end(first);
  await seen.waitForFunction(() => window.quarry.state().connection !== 'open', null, { timeout: 20000 });
  const [second] = await start();
  await seen.waitForFunction(() => window.quarry.state().connection === 'open', null, { timeout: 30000 });
  await untilExact(seen);
  await seen.context().close();
  await end(second);
});

test('proxies: one keeps its prefix, one removes it, and one passes no WebSockets', async () => {
  await cluster.startNginx();
  for (const place of ['a/b', 'whole']) {
    const proxied = await open(`https://localhost:${cluster.nginxPort}/${place}/?token=${cluster.token}`, { ignoreHTTPSErrors: true });
    await untilExact(proxied);
    await proxied.context().close();
  }
  const deaf = await open(`https://localhost:${cluster.nginxPort}/deaf/?token=${cluster.token}`, { ignoreHTTPSErrors: true });
  await deaf.waitForFunction(() => /proxy .*passes no WebSockets/.test(document.body.innerText), null, { timeout: 20000 });
  await shoot(deaf, 'proxy-without-websockets');
  await deaf.context().close();
});

test('another name of this machine gets a page with a sentence', async () => {
  const named = await launch(['--host-resolver-rules=MAP evil.example 127.0.0.1']);
  const foreign = await openIn(named, `http://evil.example:${cluster.httpPort}/`);
  assert.match(await foreign.locator('h1').innerText(), /This address is not allowed/);
  await shoot(foreign, 'foreign-host');
  await named.close();
});

test('no page has raised an error', () => assert.deepEqual(errors, []));
