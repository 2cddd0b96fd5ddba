// Shared by the browser tests: Chromium, pages on the live view, and readings of their content. Screenshots go to $QUARRY_SCREENSHOTS.
import fs from 'node:fs';
import path from 'node:path';
import { createRequire } from 'node:module';

const CHROMIUM = process.env.QUARRY_CHROMIUM ?? '/usr/bin/chromium';
const SCREENS = process.env.QUARRY_SCREENSHOTS ?? '';
const { chromium } = createRequire(path.join(process.env.QUARRY_NODE_MODULES ?? '.', 'x'))('playwright-core');

export const SIZE = { width: 640, height: 480 };
/** Errors thrown by pages. */
export const errors = [];
export const pause = ms => new Promise(resolve => setTimeout(resolve, ms));
export const apart = (a, b) => Math.hypot(...a.map((x, i) => x - b[i]));

export function launch(more = []) {
  if (SCREENS) fs.mkdirSync(SCREENS, { recursive: true });
  return chromium.launch({
    executablePath: CHROMIUM,
    args: ['--no-sandbox', '--disable-gpu', '--disable-background-networking', '--disable-component-update', '--disable-sync', ...more],
  });
}

/** A page on the live view, in a browser context of its own. */
export async function open(browser, url, options = {}) {
  const context = await browser.newContext({ viewport: SIZE, deviceScaleFactor: 1, ...options });
  return visit(context, url);
}

export async function visit(context, url) {
  const opened = await context.newPage();
  opened.on('pageerror', error => errors.push(error.message));
  await opened.goto(url);
  return opened;
}

/** Waits until the newest view is exact. An exact picture of a view before does not count. */
export async function untilExact(of, timeout = 60000) {
  await of.waitForFunction(() => window.quarry?.state().isExact && window.quarry.lastExactPng() != null, null, { timeout });
}

/** The exact picture with its view, of one moment: a frame that comes between two questions has no exact picture. */
export async function exactOf(of, timeout = 60000) {
  const end = Date.now() + timeout;
  for (;;) {
    await untilExact(of, Math.max(1, end - Date.now()));
    const shown = await of.evaluate(() => {
      const png = window.quarry.state().isExact ? window.quarry.lastExactPng() : null;
      return png && { view: window.quarry.view(), png: Array.from(png) };
    });
    if (shown) return { view: shown.view, png: Buffer.from(shown.png) };
  }
}

export async function shoot(of, name) {
  if (SCREENS) await of.screenshot({ path: path.join(SCREENS, `${name}.png`) });
}

/** The view, once the page has one. */
export async function viewOf(of) {
  await of.waitForFunction(() => window.quarry?.view() != null);
  return of.evaluate(() => window.quarry.view());
}
export const eyeOf = async of => (await viewOf(of)).camera.eye;
export const drawnBy = of => of.evaluate(() => window.quarry.state().framesDrawn);
