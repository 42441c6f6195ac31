// Numbers and sizes as people read them. No page, so Node runs it as well.

/** 1234567 as 1 234 567, with spaces at which no line ends. */
export const count = n => n.toLocaleString('en').replaceAll(',', '\u202f');

/** '1 block', '2 blocks'; `many` where an s is not enough. */
export const counted = (n, one, many = `${one}s`) => `${count(n)} ${n === 1 ? one : many}`;

/** A number to so many digits, without zeros at its end; '-' for what is none. */
export function real(x, digits = 4) {
  if (typeof x !== 'number' || !Number.isFinite(x)) return '-';
  if (Number.isInteger(x) && Math.abs(x) < 1e15) return count(x);
  const text = x.toPrecision(digits);
  return text.includes('e') ? text.replace(/\.?0+e/, 'e') : text.replace(/\.?0+$/, '');
}

export const percent = x => `${real(100 * x, 3)} %`;

/** As the command line program tells sizes. */
export function bytes(n) {
  const units = ['B', 'kB', 'MB', 'GB', 'TB'];
  let k = 0;
  for (; n >= (k ? 999.95 : 1000) && k < units.length - 1; k++) n /= 1000;
  return `${k ? n.toFixed(1) : n} ${units[k]}`;
}

export const seconds = x => (x < 1 ? `${real(x, 2)} s` : x < 120 ? `${x.toFixed(1)} s` : `${Math.floor(x / 60)} min ${Math.floor(x % 60)} s`);
