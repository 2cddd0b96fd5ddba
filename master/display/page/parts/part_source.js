// The parts of the model, as the server lists them: in pages, fetched when rows of them come in sight.
//
// A part is {id, name, path, children, triangles, box, closed, parent}, as PROTOCOL.md states it; one that was asked for by
// its number may have {attributes}.

const PAGE = 200;
/// Pages that a list keeps; the longest unused go first.
const MOST_PAGES = 50;

/// A list of the server's: the children of a part, or the parts that a search finds.
class Listing {
  constructor(source, query) {
    this.source = source;
    this.query = query;
    this.total = null;  // until the first page has come
    this.pages = new Map();  // by number: a list of parts, or null while it is fetched
  }

  /// The part at a place, or undefined while it is fetched.
  at(place) {
    const number = Math.floor(place / PAGE), page = this.pages.get(number);
    if (page === undefined) this.fetch(number);
    if (!page) return undefined;
    this.pages.delete(number);
    this.pages.set(number, page);
    return page[place - number * PAGE];
  }

  async fetch(number) {
    this.pages.set(number, null);
    const answer = await this.source.ask(`${this.query}&from=${number * PAGE}&count=${PAGE}`);
    if (!answer) return this.pages.delete(number);
    this.total = answer.total;
    this.pages.set(number, answer.parts);
    if (this.pages.size > MOST_PAGES) this.pages.delete(this.pages.keys().next().value);
    this.source.onLoad(this);
    return true;
  }
}

export class PartSource {
  /// `onLoad(listing)` runs when a page has come, `onFailure(SENTENCE)` when none comes.
  constructor(onLoad, onFailure) {
    this.onLoad = onLoad;
    this.onFailure = onFailure;
    this.reset();
  }

  /// Forgets the parts of another scene.
  reset() {
    this.children = new Map();
    this.known = new Map();
  }

  /// The list of a part's children; `parent` null: the parts without a parent.
  childrenOf(parent) {
    if (!this.children.has(parent)) this.children.set(parent, new Listing(this, `parent=${parent ?? 'none'}`));
    return this.children.get(parent);
  }

  find(text) { return new Listing(this, `find=${encodeURIComponent(text)}`); }

  /// A part by its number: {part, ancestors, places}, or null. `places`: of its ancestors and of itself among their
  /// siblings.
  async part(id) {
    if (!this.known.has(id)) this.known.set(id, this.ask(`id=${id}`));
    const answer = await this.known.get(id);
    if (!answer) this.known.delete(id);
    return answer && { part: answer.parts[0], ancestors: answer.ancestors, places: answer.places };
  }

  /// The server's answer, or null after a failure.
  async ask(query) {
    try {
      const answer = await fetch(new URL(`parts?${query}`, document.baseURI), { cache: 'no-store' });
      if (answer.ok) return await answer.json();
      this.onFailure((await answer.text()).trim().slice(0, 300));
    } catch {
      this.onFailure('The list of parts does not arrive.');
    }
    return null;
  }
}
