// Drives with the profile CiA 402 (IEC 61800-7-201): what their words mean, and where they are.
import type { Signal } from "../protocol";

export type DriveState =
  | "not_ready" | "disabled" | "ready" | "switched_on" | "enabled" | "quick_stop"
  | "fault_reaction" | "fault";

export const STATE_NAMES: Record<DriveState, string> = {
  not_ready: "Not ready to switch on",
  disabled: "Switch on disabled",
  ready: "Ready to switch on",
  switched_on: "Switched on",
  enabled: "Operation enabled",
  quick_stop: "Quick stop active",
  fault_reaction: "Fault reaction active",
  fault: "Fault",
};

/** Mask and bits of the statusword (object 0x6041) in each state. */
const STATES: [DriveState, number, number][] = [
  ["not_ready", 0x4f, 0x00],
  ["disabled", 0x4f, 0x40],
  ["ready", 0x6f, 0x21],
  ["switched_on", 0x6f, 0x23],
  ["enabled", 0x6f, 0x27],
  ["quick_stop", 0x6f, 0x07],
  ["fault_reaction", 0x4f, 0x0f],
  ["fault", 0x4f, 0x08],
];

/** The state of a drive; null for a statusword that no state has. */
export function stateOf(statusword: number): DriveState | null {
  return STATES.find(([, mask, bits]) => (statusword & mask) === bits)?.[0] ?? null;
}

/** The controlword that goes on towards Operation enabled; null where only a reset helps. */
export function towardsEnabled(state: DriveState | null): number | null {
  switch (state) {
    case "disabled": return 0x06;
    case "ready": return 0x07;
    case "switched_on": return 0x0f;
    case "enabled": return 0x0f;
    case "not_ready": return 0x06;
    default: return null;
  }
}

/** Remarks of a statusword beside the state. */
export function remarks(statusword: number): string[] {
  const bits: [number, string][] = [
    [4, "voltage enabled"], [7, "warning"], [9, "remote"], [10, "target reached"],
    [11, "internal limit active"],
  ];
  return bits.filter(([bit]) => (statusword >> bit) & 1).map(([, text]) => text);
}

/** Modes of operation (objects 0x6060 and 0x6061). */
export const MODES: Record<number, string> = {
  0: "no mode", 1: "profile position", 2: "velocity", 3: "profile velocity", 4: "profile torque",
  6: "homing", 7: "interpolated position", 8: "cyclic synchronous position",
  9: "cyclic synchronous velocity", 10: "cyclic synchronous torque",
};
export const HOMING = 6;
export const VELOCITY_MODES = [9, 3];
/** Bit 4 of the controlword starts homing; bits 12 and 13 of the statusword tell its end. */
export const HOMING_START = 0x1f;
export const isHome = (statusword: number) => (statusword & 0x3000) === 0x1000;
export const homingFailed = (statusword: number) => (statusword & 0x2000) !== 0;

/** What is mapped of an axis. The objects of the n-th axis of a device are 0x800 * n higher. */
export interface Axis {
  slave: number;
  number: number;
  label: string;
  statusword: Signal;
  controlword: Signal | null;
  modeWanted: Signal | null;
  mode: Signal | null;
  errorCode: Signal | null;
  velocity: Signal | null;
  pairs: { title: string; target: Signal | null; actual: Signal | null }[];
  others: Signal[];
}

const AXIS = 0x800;
const PAIRS: [string, number, number][] = [
  ["Position", 0x607a, 0x6064], ["Velocity", 0x60ff, 0x606c], ["Torque", 0x6071, 0x6077],
];
const OTHERS = [0x60f4, 0x6078, 0x60fd, 0x6079];

/** The axes whose statusword is in the process data. */
export function findAxes(signals: Signal[], slaveName: (slave: number) => string): Axis[] {
  const axes: Axis[] = [];
  for (const statusword of signals) {
    const index = Number(statusword.address.split(":")[0]);
    const number = (index - 0x6041) / AXIS;
    if (statusword.output || !statusword.address.endsWith(":00")) continue;
    if (!Number.isInteger(number) || number < 0 || number > 7) continue;
    const find = (base: number, output: boolean) => {
      const digits = (base + number * AXIS).toString(16).toUpperCase().padStart(4, "0");
      return signals.find((item) => item.slave === statusword.slave && item.output === output
        && item.address === `0x${digits}:00`) ?? null;
    };
    const name = slaveName(statusword.slave);
    axes.push({
      slave: statusword.slave,
      number,
      label: number === 0 ? `${statusword.slave} ${name}` : `${statusword.slave} ${name}, axis ${number + 1}`,
      statusword,
      controlword: find(0x6040, true),
      modeWanted: find(0x6060, true),
      mode: find(0x6061, false),
      errorCode: find(0x603f, false),
      velocity: find(0x60ff, true),
      pairs: PAIRS.map(([title, target, actual]) => ({
        title, target: find(target, true), actual: find(actual, false),
      })).filter(({ target, actual }) => target !== null || actual !== null),
      others: OTHERS.map((index) => find(index, false)).filter((item) => item !== null),
    });
  }
  return axes;
}

/** All signals of an axis that the panel shows. */
export function signalsOf(axis: Axis): Signal[] {
  return [
    axis.statusword, axis.controlword, axis.modeWanted, axis.mode, axis.errorCode,
    ...axis.pairs.flatMap(({ target, actual }) => [target, actual]), ...axis.others,
  ].filter((item) => item !== null);
}
