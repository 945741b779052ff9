/** Down-sampling: the values of many control steps in one pixel column of a chart. */

/**
 * @param {number[]} values one a control step; those that are not finite are left out
 * @param {(step: number) => number} columnOf the pixel column of a control step
 * @returns {{column: number, low: number, mean: number, high: number}[]} one for each column with a
 *   value, from left to right
 */
export function columnsOf(values, columnOf) {
  const found = [];
  values.forEach((value, step) => {
    if (!Number.isFinite(value)) return;
    const column = columnOf(step);
    if (found.at(-1)?.column !== column) found.push({ column, low: value, high: value, sum: 0, count: 0 });
    const last = found.at(-1);
    last.low = Math.min(last.low, value);
    last.high = Math.max(last.high, value);
    last.sum += value;
    last.count += 1;
  });
  return found.map(({ column, low, high, sum, count }) => ({ column, low, mean: sum / count, high }));
}
