// The live view in a real browser: headless Chromium against a master and three workers. Screenshots go to $QUARRY_SCREENSHOTS.
// Exit status 77: skipped, with the reason.
import assert from 'node:assert/strict';
import http from 'node:http';
import { after, before, test } from 'node:test';
import { Cluster } from './cluster.mjs';
import { apart, drawnBy, errors, exactOf, eyeOf, launch, open as openIn, pause, shoot, untilExact, viewOf } from './viewing.mjs';

const cluster = new Cluster();
let browser, page;
const open = (url, options) => openIn(browser, url, options);

/** The frame that is exact must be the batch job's file, and the canvas its pixels. */
async function checkExact(of) {
  const { view, png: live } = await exactOf(of);
  const batch = cluster.render(view);
  assert.ok(live.equals(batch), 'the exact frame is the file that quarry render writes');
  const differing = await of.evaluate(async base64 => {
    const bytes = Uint8Array.from(atob(base64), letter => letter.charCodeAt(0));
    const bitmap = await createImageBitmap(new Blob([bytes]), { colorSpaceConversion: 'none', premultiplyAlpha: 'none' });
    const canvas = document.createElement('canvas');
    canvas.width = bitmap.width;
    canvas.height = bitmap.height;
    const context = canvas.getContext('2d');
    context.drawImage(bitmap, 0, 0);
    const shown = document.querySelector('canvas');
    if (shown.width !== bitmap.width || shown.height !== bitmap.height) return `${shown.width}x${shown.height}`;
    const a = context.getImageData(0, 0, canvas.width, canvas.height).data;
    const b = shown.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
    let count = 0;
    for (let i = 0; i < a.length; ++i) count += a[i] !== b[i];
    return count;
  }, batch.toString('base64'));
  assert.equal(differing, 0, 'the canvas has the pixels of the file');
}

/** Status of a request with these headers. */
function ask(target, headers = {}, method = 'GET') {
  return new Promise((resolve, reject) => {
    const request = http.request({ host: '127.0.0.1', port: cluster.httpPort, path: target, headers, method }, answer => {
      answer.resume();
      resolve(answer.statusCode);
    });
    request.once('upgrade', (answer, socket) => { socket.destroy(); resolve(answer.statusCode); });
    request.once('error', reject);
    request.end();
  });
}

before(async () => {
  cluster.addEnvironment('evening');
  await cluster.begin(300000);
  for (let i = 0; i < 3; ++i) cluster.addWorker();
  browser = await launch();
  page = await open(cluster.url);
});

after(async () => {
  await browser?.close();
  await cluster.end();
});

test('the picture becomes exact, byte for byte, and the token leaves the address', async () => {
  await checkExact(page);
  assert.ok(!page.url().includes('token'));
  await shoot(page, 'exact');
});

test('a drag orbits, and frames follow it', async () => {
  const [before, drawn] = [await eyeOf(page), await drawnBy(page)];
  await page.mouse.move(320, 240);
  await page.mouse.down();
  for (let i = 1; i <= 30; ++i) {
    await page.mouse.move(320 + 4 * i, 240 + i);
    await pause(15);
  }
  await shoot(page, 'orbit');
  await page.mouse.up();
  assert.ok(apart(before, await eyeOf(page)) > 1);
  await checkExact(page);
  assert.ok(await drawnBy(page) > drawn + 5);
});

test('a click names the part under it', async () => {
  await page.mouse.click(320, 300);
  const card = page.locator('#pick, .pick, [data-pick]').first();
  await card.waitFor({ state: 'visible', timeout: 10000 });
  const text = await card.innerText();
  const parts = cluster.run('quarry', 'info', cluster.store, '--parts');
  const named = parts.split('\n').map(line => line.trim().split(/\s+/).slice(2).join(' ')).filter(name => name.length > 2);
  assert.ok(named.some(name => text.includes(name)), `${text} names a part`);
  await shoot(page, 'pick');
  await page.keyboard.press('Escape');
});

test('another mode is rendered as a batch job renders it', async () => {
  const view = await viewOf(page);
  for (const mode of ['whitted', 'voxels', 'raycast', 'ao']) {
    await page.evaluate(next => window.quarry.setView(next), { ...view, mode, spp: mode === 'ao' ? 4 : 2 });
    await checkExact(page);
    await shoot(page, mode);
  }
});

test('a sky is chosen and turned, and the link names it', async () => {
  const view = await viewOf(page);
  await page.evaluate(next => window.quarry.setView(next), { ...view, mode: 'path', spp: 2 });
  await page.click('#tool-panel');
  await page.locator('#sky-row').waitFor({ state: 'visible' });
  assert.ok(await page.locator('#sky-turn-row').isHidden());
  await page.selectOption('#sky', 'evening');
  await page.locator('#sky-turn').fill('90');
  await untilExact(page);
  assert.deepEqual((await viewOf(page)).environment, { name: cluster.environments[0], turn: 90 });
  await checkExact(page);
  await shoot(page, 'sky');
  await page.waitForFunction(() => location.hash.includes('environment='));
  const turned = (await exactOf(page)).png;
  await page.locator('#sky-turn').fill('200');
  assert.ok(!(await exactOf(page)).png.equals(turned), 'another turn is another picture');
  await page.selectOption('#sky', '');
  await checkExact(page);
  assert.equal((await viewOf(page)).environment, undefined);
  await page.click('#tool-panel');
  await page.evaluate(next => window.quarry.setView(next), view);
});

test('a wish for the noise ends the picture, which is the job\'s, and the page shows what is reached', async () => {
  const view = await viewOf(page);
  await page.evaluate(next => window.quarry.setView(next), { ...view, mode: 'path', spp: 64 });
  await page.click('#tool-panel');
  await page.selectOption('#noise', '0.2');
  await untilExact(page);
  const wished = await viewOf(page);
  assert.deepEqual([wished.noise, wished.spp], [0.2, 4096]);
  await checkExact(page);
  await page.waitForFunction(() => /^exact · noise [\d.]+ %, wanted 20 %$/.test(document.getElementById('status-text').textContent), null, { timeout: 5000 });
  assert.equal(await page.innerText('#spp-name'), 'Samples a pixel at most');
  await shoot(page, 'noise');
  await page.waitForFunction(() => location.hash.includes('noise=0.2'));
  const exact = (await exactOf(page)).png;
  await page.selectOption('#noise', '');
  assert.deepEqual([(await viewOf(page)).noise, (await viewOf(page)).spp], [undefined, 64]);
  assert.ok(!(await exactOf(page)).png.equals(exact), 'all samples are another picture');
  await page.click('#tool-panel');
  await page.evaluate(next => window.quarry.setView(next), view);
});

test('a worker dies and another joins during a flight', async () => {
  const [before, drawn] = [await eyeOf(page), await drawnBy(page)];
  await page.keyboard.press('g');
  await page.keyboard.down('w');
  await pause(700);
  cluster.workers[0].kill('SIGKILL');
  await page.waitForFunction(() => /Worker .* is gone: .* The other workers continue\./.test(document.getElementById('toast').innerText), null, { timeout: 20000 });
  cluster.addWorker();
  await pause(1200);
  await shoot(page, 'flight');
  await page.keyboard.up('w');
  await page.keyboard.press('g');
  assert.ok(apart(before, await eyeOf(page)) > 0.1);
  assert.ok(await drawnBy(page) > drawn + 8);
  await checkExact(page);
});

test('a second browser has another view, and a third one that stalls delays nobody', async () => {
  const stalled = await open(`${cluster.url.split('?')[0]}style.css`);
  await stalled.context().addCookies(await page.context().cookies());
  const second = await open(cluster.url);
  await stalled.goto(`${cluster.url.split('?')[0]}healthz`);
  await stalled.evaluate(address => {
    window.frames_ = 0;
    window.socket_ = new WebSocket(address);
    window.socket_.binaryType = 'arraybuffer';
    window.socket_.onmessage = message => {
      if (typeof message.data !== 'string') return void ++window.frames_;
      const text = JSON.parse(message.data);
      if (text.type !== 'welcome') return;
      const view = { ...text.view, size: [320, 240], spp: 64 };
      let input = 0;
      setInterval(() => {
        view.camera.eye[0] += 0.01;
        window.socket_.send(JSON.stringify({ type: 'view', input: ++input, time: 0, moving: true, view }));
      }, 50);
    };
  }, `ws://127.0.0.1:${cluster.httpPort}/live`);
  await viewOf(second);
  await second.evaluate(() => {
    const view = window.quarry.view();
    view.camera.eye = view.camera.eye.map((x, i) => view.camera.at[i] + 0.6 * (x - view.camera.at[i]));
    window.quarry.setView(view);
  });
  await checkExact(second);
  await checkExact(page);
  assert.notDeepEqual(await eyeOf(second), await eyeOf(page));
  assert.equal(await stalled.evaluate(() => window.frames_), 2);
  await shoot(second, 'second');
  await second.context().close();
  await stalled.context().close();
});

test('the page finds a restarted master', async () => {
  const gone = new Promise(resolve => cluster.master.once('exit', resolve));
  cluster.master.kill('SIGKILL');
  await gone;
  await page.waitForFunction(() => window.quarry.state().connection !== 'open', null, { timeout: 20000 });
  await pause(500);
  await shoot(page, 'master-gone');
  await cluster.startMaster();
  await page.waitForFunction(() => window.quarry.state().connection === 'open', null, { timeout: 30000 });
  await page.evaluate(() => {
    const view = window.quarry.view();
    view.camera.eye[2] += 1;
    window.quarry.setView(view);
  });
  await checkExact(page);
});

test('without workers the page says so', async () => {
  for (const worker of cluster.workers) worker.kill('SIGKILL');
  await page.waitForFunction(() => /no worker/i.test(document.body.innerText), null, { timeout: 20000 });
  await shoot(page, 'no-workers');
  for (let i = 0; i < 2; ++i) cluster.addWorker();
  await page.waitForFunction(() => !/no worker is/i.test(document.body.innerText), null, { timeout: 20000 });
});

test('wrong tokens, hosts and origins are refused', async () => {
  const [cookie] = await page.context().cookies();
  const good = `${cookie.name}=${cookie.value}`;
  const upgrade = {
    Connection: 'Upgrade', Upgrade: 'websocket', 'Sec-WebSocket-Version': '13', 'Sec-WebSocket-Key': 'AAAAAAAAAAAAAAAAAAAAAA==',
  };
  const origin = `http://127.0.0.1:${cluster.httpPort}`;
  assert.equal(await ask('/'), 403);
  assert.equal(await ask('/access'), 403);
  assert.equal(await ask('/access', { Cookie: good }), 200);
  assert.equal(await ask('/?token=wrong'), 403);
  assert.equal(await ask('/', { Cookie: good }), 200);
  assert.equal(await ask('/', { Cookie: good, Host: 'evil.example' }), 403);
  assert.equal(await ask('/live', { ...upgrade, Cookie: good, Origin: origin }), 101);
  assert.equal(await ask('/live', { ...upgrade, Cookie: good, Origin: 'http://evil.example' }), 403);
  assert.equal(await ask('/live', { ...upgrade, Cookie: good }), 403);
  assert.equal(await ask('/live', { ...upgrade, Origin: origin }), 403);
  assert.equal(await ask('/live', { ...upgrade, Cookie: good, Origin: origin, Host: 'evil.example' }), 403);
  assert.equal(await ask('/metrics'), 200);
  assert.equal(await ask('/metrics', { 'X-Forwarded-For': '192.0.2.1' }), 403);  // the proxy's loopback is not the reader's
  assert.equal(await ask('/metrics', { Authorization: `Bearer ${cluster.token}` }), 200);
  assert.equal(await ask('/healthz'), 200);
  const denied = await open(`http://127.0.0.1:${cluster.httpPort}/`);
  await shoot(denied, 'denied');
  await denied.context().close();
});

test('behind nginx with TLS, under another path', async () => {
  await cluster.startNginx();
  const proxied = await open(`https://localhost:${cluster.nginxPort}/a/b/?token=${cluster.token}`, { ignoreHTTPSErrors: true });
  await checkExact(proxied);
  assert.equal(new URL(proxied.url()).pathname, '/a/b/');
  await proxied.context().close();
});

test('on a phone, and with the panels open', async () => {
  const phone = await open(cluster.url, { viewport: { width: 390, height: 800 }, deviceScaleFactor: 2, hasTouch: true, isMobile: true });
  await untilExact(phone);
  await shoot(phone, 'phone');
  await phone.context().close();
  const desk = await open(cluster.url, { viewport: { width: 1400, height: 900 } });
  await desk.getByRole('button', { name: 'Activity' }).click();
  await desk.getByRole('button', { name: 'Settings' }).click();
  await untilExact(desk);
  await pause(2500);
  await shoot(desk, 'panels');
  await desk.context().close();
});

test('damaged blocks are named', async () => {
  const seen = await open(cluster.url);
  await untilExact(seen);
  for (const worker of cluster.workers) worker.kill('SIGKILL');
  cluster.damage();
  cluster.addWorker();
  await seen.evaluate(() => {
    const view = window.quarry.view();
    view.camera.eye = view.camera.eye.map((x, i) => x + 0.5 * (view.camera.at[i] - x));
    window.quarry.setView(view);
  });
  await seen.waitForFunction(() => /block \d+ at byte \d+ is damaged/.test(document.body.innerText), null, { timeout: 30000 });
  await shoot(seen, 'damaged');
  await seen.context().close();
});

test('no page has raised an error', () => assert.deepEqual(errors, []));
