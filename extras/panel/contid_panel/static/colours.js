// The colours of axes: nine that a person tells apart, in light and dark (`--axis-0` to `--axis-8` of panel.css).

export const COUNT = 9;

export const axisVariable = (number) => `var(--axis-${number % COUNT})`;

/** The value of a variable of the style. */
export function style(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

export const axisColour = (number) => style(`--axis-${number % COUNT}`);

/** Red, green, blue from 0 to 1, and opaque, of `#rrggbb`; NaN of anything else. */
export function rgba(hex) {
  return [...[1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255), 1];
}
