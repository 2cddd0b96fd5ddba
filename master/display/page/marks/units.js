// Lengths in the unit of the store. No DOM.

const NAMES = [[1e-6, 'µm'], [0.001, 'mm'], [0.01, 'cm'], [0.1, 'dm'], [1000, 'km'], [0.0254, 'in'], [0.3048, 'ft'], [0.9144, 'yd'], [1609.344, 'mi']];

/// The name of a unit. A store states 1 m also where its model has stated no unit, so that one has the name "units".
export function unitName(metres) {
  return NAMES.find(([length]) => Math.abs(length / metres - 1) < 1e-9)?.[1] ?? 'units';
}

/// A length with six digits at most.
export const lengthText = (length) => String(Number(length.toPrecision(6)));

export const withUnit = (length, metres) => `${lengthText(length)}\u00a0${unitName(metres)}`;

/// The largest of 1, 2 and 5 times a power of ten that is not above `most`.
export function roundLength(most) {
  if (!(most > 0) || !Number.isFinite(most)) return 1;
  const power = 10 ** Math.floor(Math.log10(most));
  return [5, 2, 1].map((digit) => Number((digit * power).toPrecision(1))).find((length) => length <= most * (1 + 1e-12)) ?? power;
}
