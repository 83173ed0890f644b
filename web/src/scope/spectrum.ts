// Amplitude spectrum of a window of samples.

export type WindowFunction = "rectangular" | "hann" | "blackman-harris" | "flat top";

/** Coefficients of cosines (Heinzel, Rüdiger, Schilling 2002, appendix C and D). */
const COSINES: Record<WindowFunction, number[]> = {
  rectangular: [1],
  hann: [0.5, -0.5],
  "blackman-harris": [0.35875, -0.48829, 0.14128, -0.01168],
  "flat top": [0.21557895, -0.41663158, 0.277263158, -0.083578947, 0.006947368],
};
export const WINDOW_FUNCTIONS = Object.keys(COSINES) as WindowFunction[];

export interface Spectrum {
  /** Hz between two lines. */
  step: number;
  /** Amplitude (peak value of a sine) of each line, from 0 Hz to half the rate of samples. */
  amplitudes: Float64Array;
  /** Greatest local maxima, the greatest first. */
  peaks: { frequency: number; amplitude: number }[];
}

/** Fourier transform in place; the length is a power of two (Cooley and Tukey 1965). */
export function transform(real: Float64Array, imaginary: Float64Array): void {
  const n = real.length;
  for (let i = 1, j = 0; i < n; i++) {
    let bit = n >> 1;
    for (; j & bit; bit >>= 1) j ^= bit;
    j ^= bit;
    if (i < j) {
      [real[i], real[j]] = [real[j]!, real[i]!];
      [imaginary[i], imaginary[j]] = [imaginary[j]!, imaginary[i]!];
    }
  }
  const cosine = new Float64Array(n / 2);
  const sine = new Float64Array(n / 2);
  for (let i = 0; i < n / 2; i++) {
    cosine[i] = Math.cos((2 * Math.PI * i) / n);
    sine[i] = -Math.sin((2 * Math.PI * i) / n);
  }
  for (let size = 2; size <= n; size *= 2) {
    const half = size / 2;
    const stride = n / size;
    for (let begin = 0; begin < n; begin += size) {
      for (let k = 0; k < half; k++) {
        const a = begin + k;
        const b = a + half;
        const c = cosine[k * stride]!;
        const s = sine[k * stride]!;
        const re = real[b]! * c - imaginary[b]! * s;
        const im = real[b]! * s + imaginary[b]! * c;
        real[b] = real[a]! - re;
        imaginary[b] = imaginary[a]! - im;
        real[a] = real[a]! + re;
        imaginary[a] = imaginary[a]! + im;
      }
    }
  }
}

/**
 * @param samples Values at equal distances; their number is a power of two, at least 8.
 * @param rate Samples per second.
 */
export function spectrum(
  samples: Float64Array, rate: number, window: WindowFunction, peaks = 5,
): Spectrum {
  const n = samples.length;
  const mean = samples.reduce((sum, value) => sum + value, 0) / n;
  const real = new Float64Array(n);
  let gain = 0;
  for (let i = 0; i < n; i++) {
    let weight = 0;
    COSINES[window].forEach((a, k) => (weight += a * Math.cos((2 * Math.PI * k * i) / n)));
    real[i] = (samples[i]! - mean) * weight;
    gain += weight;
  }
  const imaginary = new Float64Array(n);
  transform(real, imaginary);
  const amplitudes = new Float64Array(n / 2 + 1);
  for (let i = 1; i <= n / 2; i++) {
    amplitudes[i] = ((i < n / 2 ? 2 : 1) * Math.hypot(real[i]!, imaginary[i]!)) / gain;
  }
  amplitudes[0] = Math.abs(mean);
  return { step: rate / n, amplitudes, peaks: findPeaks(amplitudes, rate / n, peaks) };
}

function findPeaks(amplitudes: Float64Array, step: number, most: number): Spectrum["peaks"] {
  const found: { at: number; amplitude: number }[] = [];
  const greatest = amplitudes.reduce((a, b, i) => (i > 0 && b > a ? b : a), 0);
  for (let at = 1; at < amplitudes.length - 1; at++) {
    const amplitude = amplitudes[at]!;
    if (amplitude <= greatest * 0.005 || (at > 1 && amplitude < amplitudes[at - 1]!)) continue;
    if (amplitude > amplitudes[at + 1]!) found.push({ at, amplitude });
  }
  found.sort((a, b) => b.amplitude - a.amplitude);
  return found.slice(0, most).map(({ at, amplitude }) => {
    // The vertex of the parabola through the logarithms of three lines.
    const [a, b, c] = [at - 1, at, at + 1].map((i) => Math.log(amplitudes[i]! || 1e-300));
    const bend = a! - 2 * b! + c!;
    const shift = bend === 0 ? 0 : Math.max(-0.5, Math.min(0.5, (a! - c!) / (2 * bend)));
    return { frequency: (at + shift) * step, amplitude };
  });
}
