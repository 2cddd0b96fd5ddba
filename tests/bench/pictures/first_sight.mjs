// The browser of first_sight. Reads an address of a preview and the model's triangles, one pair a line; prints a line at the first frame of each,
// and one when all of the model has been read.
import readline from 'node:readline';
import { launch, open } from '../../browser/viewing.mjs';

const browser = await launch(['--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--ignore-gpu-blocklist']);
const empty = await open(browser, 'about:blank', { viewport: { width: 1000, height: 600 } });
console.log('running');
for await (const line of readline.createInterface({ input: process.stdin })) {
  const [url, triangles] = line.split(' ');
  await empty.goto(url);
  for (const least of [1, Number(triangles)]) {
    // What the line says is drawn in the next frame.
    await empty.waitForFunction((least) => {
      const [, read] = /^Preview, [\d,]+ of ([\d,]+) triangles read$/.exec(document.getElementById('shown')?.textContent ?? '') ?? [];
      return Number(read?.replaceAll(',', '')) >= least && new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(() => resolve(true))));
    }, least, { timeout: 120000, polling: 'raf' });
    console.log(least);
  }
  await empty.goto('about:blank');
}
await browser.close();
