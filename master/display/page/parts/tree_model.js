// The rows of a tree of which only parts are known: every list has a length, and elements that are fetched when they
// are asked for. No DOM.

/// An open part with its children. `open`: open children by their places.
class Branch {
  constructor(list, above, place) {
    Object.assign(this, { list, above, place, open: new Map() });
  }

  get level() { return this.above ? this.above.level + 1 : 1; }

  /// Rows of all below. A list whose length is not known yet counts as one row.
  get rows() {
    let rows = this.list.total ?? 1;
    for (const branch of this.open.values()) rows += branch.rows;
    return rows;
  }
}

export class TreeModel {
  /// `listOf(id)`: the list of a part's children, {total, at(place)}; of null: the first level.
  constructor(listOf) {
    this.listOf = listOf;
    this.root = new Branch(listOf(null), null, -1);
    this.isTree = true;
  }

  get rows() { return this.root.rows; }

  /// The row with a number: {part, level, place, of, isOpen, branch}. `part` is undefined while it is fetched; `branch`
  /// is the list that it lies in, of `of` elements. Null beyond the end.
  row(number) {
    let branch = this.root, left = number;
    if (number < 0 || number >= this.rows) return null;
    for (;;) {
      // Open children before the wanted row take rows of their own.
      let place = left, inner = null;
      for (const [at, child] of [...branch.open].sort(([a], [b]) => a - b)) {
        if (place <= at) break;
        if (place <= at + child.rows) {
          inner = child;
          left = place - at - 1;
          break;
        }
        place -= child.rows;
      }
      if (!inner) return { part: branch.list.at(place), level: branch.level, place, of: branch.list.total ?? 1, isOpen: branch.open.has(place), branch };
      branch = inner;
    }
  }

  /// The number of the row at a place of a branch.
  numberOf(branch, place) {
    let number = place;
    for (const [at, child] of branch.open) if (at < place) number += child.rows;
    return branch.above ? this.numberOf(branch.above, branch.place) + 1 + number : number;
  }

  /// Opens a row, if its part has children.
  open({ part, branch, place }) {
    if (part?.children > 0 && !branch.open.has(place)) branch.open.set(place, new Branch(this.listOf(part.id), branch, place));
  }

  close({ branch, place }) { branch.open.delete(place); }

  /// The number of the row above that holds a row's list, or -1.
  above({ branch }) { return branch.above ? this.numberOf(branch.above, branch.place) : -1; }

  /// Opens all ancestors of a part, and returns the number of its row. `ancestors` from the first level down; `places`
  /// has a place more, the part's own.
  reveal(ancestors, places) {
    let branch = this.root;
    ancestors.forEach((id, i) => {
      if (!branch.open.has(places[i])) branch.open.set(places[i], new Branch(this.listOf(id), branch, places[i]));
      branch = branch.open.get(places[i]);
    });
    return this.numberOf(branch, places.at(-1));
  }
}

/// A flat list in the form of a tree: the parts that a search has found.
export class FoundModel extends TreeModel {
  constructor(list) {
    super(() => list);
    this.isTree = false;
  }
  open() {}
  reveal() { return -1; }
}
