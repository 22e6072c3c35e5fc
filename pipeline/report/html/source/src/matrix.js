// Which keyframes of two robots were candidates, binned: share kept, and share that truly overlaps where that is known.
import { decode } from "./decode.js";
import { choice, details, el, figure, palette, table, themed, toggles } from "./dom.js";

const MARGIN = { left: 74, bottom: 46, top: 10, right: 24 }, SIDE = 400;

export async function matrices(run) {
  const pairs = run.matrices ?? [];
  if (!pairs.length) return null;
  const holder = el("div");
  const show = async (k) => holder.replaceChildren(await matrix(pairs[k]));
  await show(0);
  if (pairs.length === 1) return holder;
  return el("div", {}, choice("Robots", pairs.map((pair, k) => [k, `${pair.a} and ${pair.b}: ${figure(pair.pairs_kept)} pairs`]), show), holder);
}

async function matrix(pair) {
  const [kept, overlap, marks] = await Promise.all([decode(pair.kept), decode(pair.overlap), decode(pair.closures)]);
  const [rows, columns] = pair.bins, [cellHeight, cellWidth] = [SIDE / rows, SIDE / columns];
  const [width, height] = [SIDE + MARGIN.left + MARGIN.right, SIDE + MARGIN.top + MARGIN.bottom];
  const canvas = el("canvas", { width, height, class: "matrix", role: "img",
    "aria-label": `Candidate pairs of ${pair.a} and ${pair.b}: ${figure(pair.pairs_kept)} of ${figure(pair.pairs_total)} kept` });
  let axis = "time";
  const draw = () => {
    const colour = palette(), pen = canvas.getContext("2d");
    pen.fillStyle = colour("canvas");
    pen.fillRect(0, 0, width, height);
    for (let r = 0; r < rows; r++)
      for (let c = 0; c < columns; c++) {
        const k = r * columns + c;
        const kind = overlap?.[k] ? (kept[k] ? "found" : "missed") : kept[k] ? (overlap ? "wasted" : "found") : null;
        if (!kind) continue;
        pen.fillStyle = colour(kind);
        pen.globalAlpha = kind === "missed" ? 0.9 : 0.35 + 0.65 * (kept[k] / 255);
        pen.fillRect(MARGIN.left + c * cellWidth, MARGIN.top + r * cellHeight, cellWidth + 0.5, cellHeight + 0.5);
      }
    pen.globalAlpha = 1;
    pen.lineWidth = 1.5;
    for (let i = 0; i < marks.length; i += 2) {
      const [x, y] = [MARGIN.left + marks[i + 1] * SIDE, MARGIN.top + marks[i] * SIDE];
      pen.strokeStyle = colour("canvas");
      pen.strokeRect(x - 4, y - 4, 8, 8);
      pen.strokeStyle = colour("text");
      pen.strokeRect(x - 3, y - 3, 6, 6);
    }
    axes(pen, colour, pair, axis);
  };
  themed(canvas, draw);
  const key = overlap
    ? [["found", `kept, within ${figure(pair.radius_m)} m`], ["wasted", "kept, farther apart"], ["missed", `not kept, within ${figure(pair.radius_m)} m`]]
    : [["found", "kept"]];
  return el("figure", {},
    toggles("Axes in", [
      { label: "seconds", value: "time", checked: true, change: () => ((axis = "time"), draw()) },
      { label: "metres travelled", value: "metres", change: () => ((axis = "metres"), draw()) },
    ], { type: "radio", group: "matrix-axes" }),
    canvas,
    el("p", { class: "key" }, key.map(([colour, label]) => el("span", {}, el("span", { class: "swatch", style: { background: `var(--${colour})` } }), label)),
      marks.length ? el("span", {}, el("span", { class: "swatch square" }), "accepted closure") : null),
    el("figcaption", {}, `Each keyframe of ${pair.a} (down) with each of ${pair.b} (across): ${figure(pair.pairs_kept)} of ${figure(pair.pairs_total)} pairs were kept.`),
    details("The same as a table", () => asTable(pair)));
}

function asTable(pair) {
  const { kept, overlap } = pair.parts;
  const part = (k, n, [seconds, last]) => `${figure((k * last) / n, 2)}–${figure(((k + 1) * last) / n, 2)} ${seconds}`;
  const [a, b] = [["s", pair.seconds[0]], ["s", pair.seconds[1]]];
  return table(`Pairs kept${overlap ? " of those that overlap and others" : ""}: ${pair.a} down, ${pair.b} across`,
    [`${pair.a} \\ ${pair.b}`, ...kept[0].map((_, c) => part(c, kept[0].length, b))],
    kept.map((row, r) => [part(r, kept.length, a), ...row.map((count, c) => (overlap ? `${figure(count)}; ${figure(overlap[r][c])} overlap` : count))]), { wide: true });
}

function axes(pen, colour, pair, axis) {
  pen.strokeStyle = colour("rule");
  pen.lineWidth = 1;
  pen.strokeRect(MARGIN.left, MARGIN.top, SIDE, SIDE);
  pen.fillStyle = colour("text");
  pen.font = "14px system-ui, sans-serif";
  const unit = axis === "time" ? "s" : "m";
  const [last_a, last_b] = axis === "time" ? pair.seconds : pair.metres;
  const label = (share, last) => `${figure(share * last)} ${unit}`;
  pen.textAlign = "right";
  for (const share of [0, 0.5, 1]) pen.fillText(label(share, last_a), MARGIN.left - 6, MARGIN.top + share * SIDE + [11, 5, 0][2 * share]);
  for (const share of [0, 0.5, 1]) {
    pen.textAlign = ["left", "center", "right"][2 * share];
    pen.fillText(label(share, last_b), MARGIN.left + share * SIDE, MARGIN.top + SIDE + 18);
  }
  pen.textAlign = "center";
  pen.fillText(pair.b, MARGIN.left + SIDE / 2, MARGIN.top + SIDE + 38, SIDE);
  pen.save();
  pen.translate(13, MARGIN.top + SIDE / 2);
  pen.rotate(-Math.PI / 2);
  pen.fillText(pair.a, 0, 0, SIDE);
  pen.restore();
}
