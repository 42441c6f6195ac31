// Numbers and sizes as people read them. No page, so Node runs it as well.

/** 1234567 as 1 234 567, with spaces at which no line ends. */
export const count = n => n.toLocaleString('en').replaceAll(',', '\u202f');

/** '1 block', '2 blocks'; `many` where an s is not enough. */
export const counted = (n, one, many = `${one}s`) => `${count(n)} ${n === 1 ? one : many}`;

/** A number to so many digits, without zeros at its end; whole where it is large; '-' for what is none. */
export function real(x, digits = 4) {
  if (typeof x !== 'number' || !Number.isFinite(x)) return '-';
  const size = Math.abs(x), large = Number.isInteger(x) || size >= 10 ** digits;
  if (large && size < 1e15) return count(Math.round(x));
  const text = large || size < 1e-4 ? x.toExponential(digits - 1) : x.toPrecision(digits);
  return text.includes('.') ? text.replace(/\.?0+(?=e|$)/, '') : text;
}

export const percent = x => `${real(100 * x, 3)} %`;

/** As the command line program tells sizes. */
export function bytes(n) {
  const units = ['B', 'kB', 'MB', 'GB', 'TB'];
  let k = 0;
  for (; n >= (k ? 999.95 : 1000) && k < units.length - 1; k++) n /= 1000;
  return `${k ? n.toFixed(1) : n} ${units[k]}`;
}

export const seconds = x => (x < 0.001 ? 'under 1 ms' : x < 1 ? `${real(x, 2)} s` : x < 120 ? `${x.toFixed(1)} s` : `${Math.floor(x / 60)} min ${Math.floor(x % 60)} s`);
