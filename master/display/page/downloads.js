// Files that the browser saves.

import { element, shown } from './formats.js';

/// A file name that any system accepts.
export const fileName = (name) => shown(name || 'quarry').replace(/[\/\\:*?"<>|\ufffd]+/g, '_').slice(0, 100) || 'quarry';

/// Hands an address to the browser's downloads.
export function download(address, name) {
  element('a', { href: address, download: name }).click();
}

export function downloadBytes(parts, type, name) {
  const address = URL.createObjectURL(new Blob(parts, { type }));
  download(address, name);
  setTimeout(() => URL.revokeObjectURL(address), 10000);
}
