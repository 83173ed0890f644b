// Colours of curves. Any two of them differ for colour-blind people, too, and each has a contrast of 3
// to the background; `scope.test.ts` computes both. More curves than colours are dashed.

const LIGHT = [
  "#0b7186", "#e7751e", "#46208c", "#22a69a", "#8a03da", "#b13d17", "#b575fe", "#740a32",
];
const DARK = [
  "#35faf5", "#f1940d", "#c595ff", "#41c9a1", "#ba2ef7", "#d54806", "#308499", "#edea06",
];
/** Lengths of dashes and gaps, in CSS pixels. */
const DASHES = [[], [7, 4], [2, 3], [9, 3, 2, 3]];

/** How many curves look different. */
export const LOOKS = LIGHT.length * DASHES.length;

export function colours(dark: boolean): readonly string[] {
  return dark ? DARK : LIGHT;
}

export function colour(number: number, dark: boolean): string {
  return colours(dark)[number % LIGHT.length]!;
}

export function dash(number: number): number[] {
  return DASHES[Math.floor(number / LIGHT.length) % DASHES.length]!;
}

/** Whether a place in pixels along a curve lies in a gap of its dashes. */
export function isGap(dashes: number[], place: number): boolean {
  if (dashes.length === 0) return false;
  let left = place % dashes.reduce((sum, each) => sum + each, 0);
  for (let i = 0; ; i++) {
    if (left < dashes[i]!) return i % 2 === 1;
    left -= dashes[i]!;
  }
}
