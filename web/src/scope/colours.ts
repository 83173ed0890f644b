// Colours of curves, told apart by colour-blind people too (after Okabe and Ito 2008), and by light.

const LIGHT = [
  "#0072b2", "#d55e00", "#00805f", "#b1478c", "#8a6d00", "#2f2f8f", "#3b9fd1", "#7a3b00",
  "#4d4d4d", "#e0592a", "#005f73", "#9a1750", "#6a8f00", "#7b61c9", "#c58b00", "#174a7c",
  "#c0504d", "#3a7d44", "#8e6bbf", "#a0522d",
];
const DARK = [
  "#56b4e9", "#e69f00", "#35c69b", "#e48cc0", "#f0e442", "#9aa7ff", "#b7e3ff", "#ff8a5b",
  "#c9c9c9", "#ffd08a", "#5bd1d7", "#ff7fa5", "#b5d94c", "#c5b3ff", "#e3c16f", "#7fb2e5",
  "#ff9d94", "#8ddb9a", "#d9b8f5", "#dba781",
];

export const COLOURS = LIGHT.length;

export function colour(number: number, dark: boolean): string {
  return (dark ? DARK : LIGHT)[number % COLOURS]!;
}
