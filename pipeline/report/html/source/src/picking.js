// What lies nearest to the pointer on the screen.
const PIXELS = 14;

export function nearest(pickable, groups, event, canvas, camera) {
  const box = canvas.getBoundingClientRect();
  const x = event.clientX - box.left, y = event.clientY - box.top;
  const m = camera.projectionMatrix.clone().multiply(camera.matrixWorldInverse).elements;
  let best = null, least = PIXELS ** 2;
  for (const set of pickable) {
    if (!groups[set.group].visible || !set.node.visible) continue;
    const p = set.xyz, favour = set.closure ? 0.5 : 1;
    for (let i = 0; i < p.length; i += 3) {
      const w = m[3] * p[i] + m[7] * p[i + 1] + m[11] * p[i + 2] + m[15];
      if (w <= 0) continue;
      const u = ((m[0] * p[i] + m[4] * p[i + 1] + m[8] * p[i + 2] + m[12]) / w + 1) * 0.5 * box.width - x;
      const v = (1 - (m[1] * p[i] + m[5] * p[i + 1] + m[9] * p[i + 2] + m[13]) / w) * 0.5 * box.height - y;
      const apart = favour * (u * u + v * v);
      if (apart < least) [least, best] = [apart, [set, i / 3]];
    }
  }
  return best && { says: best[0].says(best[1]), closure: best[0].closure?.(best[1]) };
}
