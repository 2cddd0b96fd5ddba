// Colours: of workers, and between the renderer's radiance and a colour field.

/// A worker's colour, the same in the overlay and in the list of workers. Neighbouring ids are far apart on the circle.
export function workerColour(id, opacity = 1) {
  return `hsl(${(id * 137.508) % 360} 70% 60% / ${opacity})`;
}

const toLinear = (s) => (s <= 0.04045 ? s / 12.92 : ((s + 0.055) / 1.055) ** 2.4);
const toStandard = (l) => (l <= 0.0031308 ? l * 12.92 : 1.055 * l ** (1 / 2.4) - 0.055);

/// The colour "#rrggbb" of a radiance in a picture of this exposure (EV).
export function radianceToHex(radiance, exposure) {
  return '#' + radiance.map((l) => {
    const byte = Math.round(255 * Math.min(1, Math.max(0, toStandard(l * 2 ** exposure))));
    return byte.toString(16).padStart(2, '0');
  }).join('');
}

/// The radiance of the colour "#rrggbb" in a picture of this exposure (EV).
export function hexToRadiance(hex, exposure) {
  return [1, 3, 5].map((i) => Number((toLinear(parseInt(hex.slice(i, i + 2), 16) / 255) / 2 ** exposure).toPrecision(5)));
}
