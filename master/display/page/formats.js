// Numbers and texts for people. `element` builds a DOM element.

/// Three digits with a prefix after a space that does not break: 1234567 is "1.23 M".
export function compact(number) {
  if (!Number.isFinite(number)) return '–';
  const prefixes = ['', '\u00a0k', '\u00a0M', '\u00a0G', '\u00a0T'];
  let power = 0;
  while (Math.abs(number) >= 999.5 && power < prefixes.length - 1) {
    number /= 1000;
    ++power;
  }
  const digits = Math.abs(number) >= 99.95 || (power === 0 && Number.isInteger(number)) ? 0 : Math.abs(number) >= 9.995 ? 1 : 2;
  return number.toFixed(digits) + prefixes[power];
}

export const bytes = (count) => {
  const text = compact(count);
  return text.includes('\u00a0') ? text + 'B' : text + '\u00a0B';
};
export const percent = (share) => (Number.isFinite(share) ? `${(share * 100).toFixed(share > 0.9 && share < 1 ? 1 : 0)} %` : '–');
export const milliseconds = (ms) => (Number.isFinite(ms) ? `${ms < 10 ? ms.toFixed(1) : Math.round(ms)} ms` : '–');
export const coordinate = (x) => String(Number(x.toPrecision(7)));

/// A foreign name, safe to show: without control codes, and without marks that change the direction of other text.
export const shown = (name) => String(name).replace(/[\u0000-\u001f\u007f-\u009f\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff]/g, '\ufffd');

export function duration(seconds) {
  if (seconds < 90) return `${Math.round(seconds)} s`;
  if (seconds < 5400) return `${Math.round(seconds / 60)} min`;
  return seconds < 172800 ? `${Math.round(seconds / 3600)} h` : `${Math.round(seconds / 86400)} days`;
}

/// An element with properties and children (elements or texts).
export function element(name, properties = {}, ...children) {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
}

/// Fills a <dl> with [name, value] rows; rows whose value is null are left out.
export function fillList(list, rows) {
  list.replaceChildren(...rows.filter(([, value]) => value !== null && value !== undefined)
    .flatMap(([name, value]) => [element('dt', {}, name), element('dd', {}, value)]));
}

/// Copies a text. Returns whether it could.
export async function copyText(text) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    // Only secure pages may use the clipboard; a selection works everywhere.
    const field = element('textarea', { value: text, className: 'offscreen' });
    document.body.append(field);
    field.select();
    const done = document.execCommand('copy');
    field.remove();
    return done;
  }
}
