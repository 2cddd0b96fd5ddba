// The address bar: the URL's fragment contains the view, so that a link opens the same view. A view that is too long for
// this is kept in this browser, and the fragment names it: #kept=NAME.

import { fromFragment, toFragment } from './view_state.js';

/// Browsers refuse more than about 100 changes of the address in 30 s.
const WRITE_MS = 400;
/// Longest address, in letters: mail and chat programs cut longer ones.
const LONGEST = 2000;
const KEPT = /^#?kept=([a-z0-9]+)$/;

/// Removes a token from the address: the server has exchanged it for a cookie.
export function removeToken() {
  const address = new URL(location.href);
  if (!address.searchParams.has('token')) return;
  address.searchParams.delete('token');
  history.replaceState(null, '', address.pathname + address.search + address.hash);
}

export class Link {
  /// `onView(view)` runs when a person puts another fragment in the address bar. `kept` keeps long links.
  constructor(live, kept, tell, onView) {
    Object.assign(this, { live, kept, tell });
    this.tab = Math.random().toString(36).slice(2, 12);  // a name for the address bar of this tab
    this.home = null;  // the default view
    this.modes = [];  // names of the server's modes
    this.timer = 0;
    addEventListener('hashchange', () => this.home && onView(this.read(location.hash)));
  }

  /// The view of a fragment. Members that it leaves out have the default's values.
  read(fragment) {
    const name = KEPT.exec(fragment)?.[1], held = name ? this.kept.link(name) : fragment;
    if (held === null) this.tell('This browser does not keep the view of this link. Links as long as this one open where they were copied.');
    return fromFragment(held ?? '', this.home, this.modes);
  }

  get base() { return location.origin + location.pathname + location.search; }

  /// The fragment of the present view, or the name under which it is kept; null without room. `own`: the name.
  fragment(own) {
    const fragment = toFragment(this.live.view, this.home);
    if (this.base.length + fragment.length <= LONGEST) return fragment;
    const name = this.kept.keepLink(fragment, own);
    return name && `#kept=${name}`;
  }

  /// Writes the view into the address bar soon.
  write() {
    this.timer ||= setTimeout(() => {
      this.timer = 0;
      if (this.live.isMoving) return;  // the next rest writes again
      const fragment = this.fragment(this.tab);
      if (fragment !== null && fragment !== location.hash) history.replaceState(null, '', location.pathname + location.search + fragment);
    }, WRITE_MS);
  }

  /// A link to the present view, or null where it cannot be kept.
  address() {
    const fragment = this.fragment();
    return fragment === null ? null : this.base + fragment;
  }

  /// Whether a link names a kept view.
  isKept(address) { return KEPT.test(new URL(address).hash); }
}
