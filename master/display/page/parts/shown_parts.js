// The members "hide", "only" and "colors" of a view, and how they change. Pure functions, no DOM.
//
// A path is names joined by "/". In "hide", "only" and "colors" a path also stands for all parts below it, and "*" for
// any letters. In "colors" a null gives parts their own colour back. `parts` here is {hide, only, colors}; a member that is
// missing leaves nothing out.

/// The colour of dimmed parts, linear.
const DIM = [0.55, 0.55, 0.55];

const escaped = (text) => text.replace(/[.*+?^${}()|[\]\\]/g, '\\$&');

/// Whether an entry of a list names the part with this path, or one above it.
export function names(entry, path) {
  if (path === entry || path.startsWith(`${entry}/`)) return true;
  if (!/(^|[^\\])(\\\\)*\*/.test(entry)) return false;
  const letters = entry.match(/\\.|[^\\]/gs) ?? [];
  const pattern = letters.map((letter) => (letter === '*' ? '.*' : escaped(letter))).join('');
  return new RegExp(`^${pattern}(/.*)?$`, 's').test(path);
}

const namedBy = (list, path) => (list ?? []).some((entry) => names(entry, path));

/// Whether a part is left out, by itself or by a part above it.
export function isHidden({ hide, only }, path) {
  return namedBy(hide, path) || (only !== undefined && !namedBy(only, path));
}

/// The colour that a part is given, or null; dimmed parts have none. The last entry that names it counts.
export function colourOf(parts, path) {
  return bright(parts).findLast((entry) => namedBy(entry.parts, path))?.color ?? null;
}

/// The lists without empty ones.
const pruned = ({ hide, only, colors }) => ({
  hide: hide?.length ? hide : undefined, only: only?.length ? only : undefined, colors: colors?.length ? colors : undefined,
});

/// `list` without the entries that `paths` stand for.
const without = (list, paths) => list?.filter((entry) => !paths.some((path) => names(path, entry)));

/// Leaves parts out.
export function hidden(parts, paths) {
  return pruned({ ...parts, hide: [...(without(parts.hide, paths) ?? []), ...paths] });
}

/// Shows parts again, with all parts above them.
export function unhidden(parts, paths) {
  const { hide, only } = parts;
  const left = hide?.filter((entry) => !paths.some((path) => names(entry, path) || names(path, entry)));
  const outside = only && paths.filter((path) => !namedBy(only, path));
  return pruned({ ...parts, hide: left, only: only && [...without(only, outside), ...outside] });
}

/// Shows these parts only.
export function isolated(parts, paths) {
  return { ...unhidden({ ...parts, only: undefined }, paths), only: paths };
}

export const allShown = (parts) => pruned({ ...parts, hide: undefined, only: undefined });

const isDim = (entry) => entry?.parts.length === 1 && entry.parts[0] === '*' && String(entry.color) === String(DIM);

/// Whether all parts but some are dimmed.
export const isDimmed = ({ colors }) => isDim(colors?.[0]);

/// The colours without those that dim.
const bright = ({ colors }) => (colors ?? []).slice(isDim(colors?.[0]) ? 2 : 0);

/// Dims all parts but these.
export function dimmed(parts, paths) {
  return { ...parts, colors: [{ parts: ['*'], color: DIM }, { parts: paths, color: null }, ...bright(parts)] };
}

export const undimmed = (parts) => pruned({ ...parts, colors: bright(parts) });

/// Gives parts a colour; null takes it away.
export function coloured(parts, paths, colour) {
  const dims = isDimmed(parts) ? parts.colors.slice(0, 2) : [];
  const colors = bright(parts).map((entry) => ({ ...entry, parts: without(entry.parts, paths) })).filter((entry) => entry.parts.length > 0);
  const isNews = colour !== null || paths.some((path) => colourOf({ colors }, path) !== null);  // a part above may have one
  return pruned({ ...parts, colors: [...dims, ...colors, ...(isNews ? [{ parts: paths, color: colour }] : [])] });
}

const isPaths = (list) => Array.isArray(list) && list.length > 0 && list.every((path) => typeof path === 'string' && path !== '');
const isColour = (colour) => colour === null || (Array.isArray(colour) && colour.length === 3 && colour.every((x) => Number.isFinite(x) && x >= 0));

/// The members of a view that are valid lists of parts.
export function partsOf({ hide, only, colors }) {
  return pruned({
    hide: isPaths(hide) ? hide : undefined, only: isPaths(only) ? only : undefined,
    colors: Array.isArray(colors) && colors.every((entry) => isPaths(entry?.parts) && isColour(entry.color)) ? colors : undefined,
  });
}
