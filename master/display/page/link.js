// The address bar: the URL's fragment contains the view, so that a link opens the same view.

import { fromFragment, toFragment } from './view_state.js';

/// Browsers refuse more than about 100 changes of the address in 30 s.
const WRITE_MS = 400;

/// Removes a token from the address: the server has exchanged it for a cookie.
export function removeToken() {
  const address = new URL(location.href);
  if (!address.searchParams.has('token')) return;
  address.searchParams.delete('token');
  history.replaceState(null, '', address.pathname + address.search + address.hash);
}

export class Link {
  /// `onView(view)` runs when a person puts another fragment in the address bar.
  constructor(live, onView) {
    this.live = live;
    this.home = null;  // the default view
    this.modes = [];  // names of the server's modes
    this.timer = 0;
    addEventListener('hashchange', () => this.home && onView(this.read(location.hash)));
  }

  /// The view of a fragment. Members that it leaves out have the default's values.
  read(fragment) { return fromFragment(fragment, this.home, this.modes); }

  /// Writes the view into the address bar soon.
  write() {
    this.timer ||= setTimeout(() => {
      this.timer = 0;
      if (this.live.isMoving) return;  // the next rest writes again
      const fragment = toFragment(this.live.view, this.home);
      if (fragment !== location.hash) history.replaceState(null, '', location.pathname + location.search + fragment);
    }, WRITE_MS);
  }

  /// A link to the present view.
  address() {
    return location.origin + location.pathname + location.search + toFragment(this.live.view, this.home);
  }
}
