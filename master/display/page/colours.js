// Colours: of workers, and between the renderer's radiance and a colour field.

/// A worker's colour, the same in the overlay and in the list of workers. Neighbouring ids are far apart on the circle.
export function workerColour(id, opacity = 1) {
  return `hsl(${(id * 137.508) % 360} 70% 60% / ${opacity})`;
}

const toLinear = (s) => (s <= 0.04045 ? s / 12.92 : ((s + 0.055) / 1.055) ** 2.4);
const toStandard = (l) => (l <= 0.0031308 ? l * 12.92 : 1.055 * l ** (1 / 2.4) - 0.055);

// Film's tone curve, and its inverse up to 62: white itself has none.
const toFilm = (l) => (l <= 0.5 ? l : 1 - 0.25 / l);
const fromFilm = (l) => (l <= 0.5 ? l : 0.25 / Math.max(1 - l, 0.004));

/// The colour "#rrggbb" of a radiance in a picture of this exposure (EV) and tone curve ("clip" or "film").
export function radianceToHex(radiance, exposure, tone) {
  return '#' + radiance.map((l) => {
    const exposed = l * 2 ** exposure;
    const byte = Math.round(255 * Math.min(1, Math.max(0, toStandard(tone === 'film' ? toFilm(exposed) : exposed))));
    return byte.toString(16).padStart(2, '0');
  }).join('');
}

/// The radiance of the colour "#rrggbb" in a picture of this exposure (EV) and tone curve.
export function hexToRadiance(hex, exposure, tone) {
  return [1, 3, 5].map((i) => {
    const shown = toLinear(parseInt(hex.slice(i, i + 2), 16) / 255);
    return Number(((tone === 'film' ? fromFilm(shown) : shown) / 2 ** exposure).toPrecision(5));
  });
}
