// Number formatting, with the same digits as in the tables of the program.

/** A value of a metric; rates in percent. */
export function number(metric, value) {
  if (value === null || value === undefined) return "–";
  if (metric.unit === "rate") return (100 * value).toFixed(2);
  return value.toFixed(["m", "m/s²"].includes(metric.unit) ? 2 : 3);
}

/** Half the width of an interval after a "±"; empty without an interval, which few scenarios do not have. */
export const half = (metric, { low, high }) => (low === null ? "" : ` ±${number(metric, (high - low) / 2)}`);

/** An interval in words. */
export const interval = (metric, { low, high }) => (low === null ? "too few scenarios for an interval" : `95 % interval ${number(metric, low)} to ${number(metric, high)}`);

/** Title of a metric with its unit. */
export const titled = (metric) => `${metric.title}${metric.unit === "rate" ? " (%)" : ["", "count"].includes(metric.unit) ? "" : ` (${metric.unit})`}`;

/** Seconds after the current frame, `now`. */
export const seconds = (frame, now) => `${((frame - now) / 10).toFixed(1)} s`;

/** A count with its noun in singular or plural. */
export const count = (n, what) => `${n.toLocaleString("en")} ${what}${n === 1 ? "" : "s"}`;
