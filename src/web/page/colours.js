// Colours of the maps: even steps of lightness, told apart without seeing all colours.

// Anchors of cividis (Nuñez, Anderton and Renslow 2018) and of inferno, from dark to light.
const CIVIDIS = ['#00224e', '#123570', '#3b496c', '#575d6d', '#707173', '#8a8678', '#a59c74', '#c3b369', '#e1cc55', '#fee838'];
const INFERNO = ['#120b33', '#3b0f6f', '#641a80', '#8c2981', '#b5367a', '#de4968', '#f66e5c', '#fe9f6d', '#fecf92', '#fcfdbf'];
// Orange below, purple above, light between: after ColorBrewer's PuOr.
const CHANGE = ['#b35806', '#e08214', '#fdb863', '#fee0b6', '#f7f7f7', '#d8daeb', '#b2abd2', '#8073ac', '#542788'];

export const COVERAGE = [
  { name: 'measured', colour: '#3ecf9b' },
  { name: 'interpolated', colour: '#2a7f9e' },
  { name: 'never seen', colour: '#8a97a5', hatch: true },
  { name: 'disturbed', colour: '#ff8a5c' },
];

const rgb = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));

function scale(anchors) {
  const stops = anchors.map(rgb);
  return (share) => {
    const at = Math.min(Math.max(share, 0), 1) * (stops.length - 1);
    const low = Math.min(Math.floor(at), stops.length - 2);
    const part = at - low;
    return stops[low].map((c, k) => Math.round(c + part * (stops[low + 1][k] - c)));
  };
}

const PALETTES = { height: scale(CIVIDIS), sigma: scale(INFERNO), 'fix-quality': scale(CIVIDIS), change: scale(CHANGE) };

/** Range of the values that is shown, and the colour of each. */
export function palette(map, scene) {
  const known = map.values.filter((value) => value !== null);
  if (known.length === 0) known.push(0);
  if (map.kind === 'coverage') {
    return { range: null, colour: (value) => rgb(COVERAGE[value].colour) };
  }
  let [low, high] = [Math.min(...known), Math.max(...known)];
  if (map.kind === 'height') {
    // A few cells at the border that nobody saw must not take the contrast of all others.
    const sorted = known.toSorted((a, b) => a - b);
    [low, high] = [0.01, 0.995].map((share) => sorted[Math.floor(share * (sorted.length - 1))]);
  }
  if (map.kind === 'sigma') low = 0;
  if (map.kind === 'fix-quality') [low, high] = [0, Math.max(2 * scene.min_fix_quality, high)];
  if (map.kind === 'change') { high = Math.max(Math.abs(low), Math.abs(high), 0.05); low = -high; }
  if (!(high > low)) high = low + 0.01;
  const colour = PALETTES[map.kind];
  return { range: [low, high], colour: (value) => colour((value - low) / (high - low)) };
}

/** Relief of a height map: light from the north-west, so that slopes are seen. */
export function shade(map, index) {
  const { n_cols: n, values, cell_m } = map;
  const [left, below] = [index % n > 0 ? index - 1 : index, index >= n ? index - n : index];
  if (values[index] === null || values[left] === null || values[below] === null) return 1;
  const [dx, dy] = [(values[index] - values[left]) / cell_m, (values[index] - values[below]) / cell_m];
  return Math.min(Math.max(1 + 0.35 * (dx - dy), 0.55), 1.35);
}

export const css = ([r, g, b]) => `rgb(${r} ${g} ${b})`;
