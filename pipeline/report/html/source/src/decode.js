// Arrays travel as base64 of zlib-deflated little-endian bytes: {"type": "u16", "shape": [n, 3], "data": "..."}.
const TYPES = { u8: Uint8Array, u16: Uint16Array, i16: Int16Array, i32: Int32Array, f32: Float32Array, f64: Float64Array };

export async function decode(packed) {
  if (!packed) return null;
  const compressed = Uint8Array.from(atob(packed.data), (c) => c.charCodeAt(0));
  const stream = new Blob([compressed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = await new Response(stream).arrayBuffer();
  return new TYPES[packed.type](bytes);
}
