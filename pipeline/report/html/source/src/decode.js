// Arrays travel as base64 of zlib-deflated bytes; see packing.py.  {"array": n} stands for the n-th shared one.
import { report } from "./report.js";

export async function decode(packed) {
  if (!packed) return null;
  const { type, data, shape, step } = packed.array === undefined ? packed : report.arrays[packed.array];
  const bytes = await inflated(data);
  return type === "bytes" ? bytes : steps(bytes, shape.slice(1).reduce((a, b) => a * b, 1), step);
}

async function inflated(base64) {
  const text = atob(base64);
  const compressed = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) compressed[i] = text.charCodeAt(i);
  const stream = new Blob([compressed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

const NOT_A_NUMBER = -(2 ** 31);

// Four planes of bytes; each row is its difference from the one before, folded so that small ones of either sign are small.
function steps(bytes, width, step) {
  const n = bytes.length / 4, whole = new Int32Array(n), values = new Float32Array(n);
  for (let i = 0; i < n; i++) {
    const folded = bytes[i] | (bytes[n + i] << 8) | (bytes[2 * n + i] << 16) | (bytes[3 * n + i] << 24);
    whole[i] = ((folded >>> 1) ^ -(folded & 1)) + (i < width ? 0 : whole[i - width]); // wraps around, as when packed
    values[i] = whole[i] === NOT_A_NUMBER ? NaN : whole[i] * step;
  }
  return values;
}
