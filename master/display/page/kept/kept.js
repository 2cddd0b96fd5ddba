// Views and notes that this browser keeps for a scene: in memory, and in its storage between visits.

import { EMPTY, keptOf } from './kept_file.js';

const KEY = 'quarry.kept.', LINK_KEY = 'quarry.link.';
/// Most views that are kept for links too long to hold them; the oldest go first.
const MOST_LINKS = 30;

/// A short name for a text: FNV-1a, 64 bits, as 13 letters.
export function nameOf(text) {
  let hash = 0xcbf29ce484222325n;
  for (const byte of new TextEncoder().encode(text)) hash = BigInt.asUintN(64, (hash ^ BigInt(byte)) * 0x100000001b3n);
  return hash.toString(36).padStart(13, '0');
}

function read(key) {
  try {
    return JSON.parse(localStorage.getItem(key));
  } catch {
    return null;  // storage may be forbidden, or hold something else
  }
}

export class Kept {
  /// `onChange()` runs after each change, `tell(SENTENCE)` shows a sentence.
  constructor(onChange, tell) {
    Object.assign(this, { onChange, tell });
    this.scene = '';
    this.content = EMPTY;
  }

  /// Shows the views and notes of another scene.
  open(scene) {
    this.scene = scene;
    const kept = read(KEY + scene);
    const content = kept && typeof kept === 'object' ? keptOf({ views: kept.views, notes: kept.notes }) : EMPTY;
    this.content = typeof content === 'string' ? EMPTY : content;
    this.onChange();
  }

  /// Replaces all views and notes.
  put(content) {
    this.content = content;
    if (!this.write(KEY + this.scene, content)) this.tell('This browser has no room to keep it: save it as a file.');
    this.onChange();
  }

  write(key, value) {
    try {
      localStorage.setItem(key, JSON.stringify(value));
      return true;
    } catch {
      return false;  // forbidden or full
    }
  }

  /// Keeps a link's fragment under a short name, which is returned, or null without room. `own`: one name for all, for
  /// the address bar of this tab.
  keepLink(fragment, own) {
    const name = own ?? nameOf(fragment);
    const links = (read(LINK_KEY + this.scene) ?? []).filter((link) => Array.isArray(link) && link[0] !== name);
    return this.write(LINK_KEY + this.scene, [...links, [name, fragment]].slice(-MOST_LINKS)) ? name : null;
  }

  /// The fragment of a kept link, or null.
  link(name) { return (read(LINK_KEY + this.scene) ?? []).find((link) => link?.[0] === name)?.[1] ?? null; }
}
