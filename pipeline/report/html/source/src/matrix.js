// Which keyframes of two robots were candidates, binned: share kept, and share that truly overlaps where that is known.
import { decode } from "./decode.js";
import { el, figure, palette, toggles } from "./dom.js";

export async function matrix(pair, id) {
  const [kept, overlap, marks] = await Promise.all([decode(pair.kept), decode(pair.overlap), decode(pair.closures)]);
  const [rows, columns] = pair.bins;
  const margin = { left: 64, bottom: 46, top: 10, right: 12 }, side = 400;
  const scale = side / Math.max(rows, columns);
  const [width, height] = [columns * scale + margin.left + margin.right, rows * scale + margin.top + margin.bottom];
  const canvas = el("canvas", { width, height, class: "matrix", role: "img",
    "aria-label": `Candidate pairs of ${pair.a} and ${pair.b}: ${figure(pair.pairs_kept)} of ${figure(pair.pairs_total)} kept` });
  let axis = "time";
  const draw = () => {
    const colour = palette(), pen = canvas.getContext("2d");
    pen.fillStyle = colour("canvas");
    pen.fillRect(0, 0, width, height);
    const mix = (k) => (overlap && overlap[k] > 0 ? (kept[k] ? "found" : "missed") : kept[k] ? "wasted" : null);
    for (let r = 0; r < rows; r++)
      for (let c = 0; c < columns; c++) {
        const name = mix(r * columns + c);
        if (!name) continue;
        pen.fillStyle = colour(overlap ? name : "found");
        pen.globalAlpha = name === "missed" ? 0.9 : 0.35 + 0.65 * (kept[r * columns + c] / 255);
        pen.fillRect(margin.left + c * scale, margin.top + r * scale, scale + 0.5, scale + 0.5);
      }
    pen.globalAlpha = 1;
    pen.strokeStyle = colour("text");
    pen.lineWidth = 1.5;
    for (let i = 0; i < marks.length; i += 2) {
      const [x, y] = [margin.left + (marks[i + 1] / 65535) * columns * scale, margin.top + (marks[i] / 65535) * rows * scale];
      pen.strokeRect(x - 3, y - 3, 6, 6);
    }
    axes(pen, colour, pair, axis, margin, rows * scale, columns * scale);
  };
  draw();
  document.addEventListener("themechange", draw);
  const key = overlap
    ? [["found", "kept, overlaps"], ["wasted", "kept, too far apart"], ["missed", "overlaps, not kept"]]
    : [["found", "kept"]];
  return el("figure", { class: "matrix-figure" },
    toggles("Axes in", [
      { label: "seconds", value: "time", checked: true, change: () => ((axis = "time"), draw()) },
      { label: "metres travelled", value: "metres", change: () => ((axis = "metres"), draw()) },
    ], { type: "radio", name: `axes-${id}` }),
    canvas,
    el("figcaption", {}, `${pair.a} (down) and ${pair.b} (across): ${figure(pair.pairs_kept)} of ${figure(pair.pairs_total)} pairs kept. Squares: accepted closures.`,
      el("span", { class: "key" }, key.map(([name, label]) => el("span", {}, el("span", { class: "swatch", style: { background: `var(--${name})` } }), label)))),
  );
}

function axes(pen, colour, pair, axis, margin, height, width) {
  pen.strokeStyle = colour("rule");
  pen.lineWidth = 1;
  pen.strokeRect(margin.left, margin.top, width, height);
  pen.fillStyle = colour("text");
  pen.font = "13px system-ui, sans-serif";
  const unit = axis === "time" ? "s" : "m";
  const [last_a, last_b] = axis === "time" ? pair.seconds : pair.metres;
  pen.textAlign = "right";
  for (const share of [0, 0.5, 1]) pen.fillText(`${figure(share * last_a)} ${unit}`, margin.left - 5, margin.top + share * height + (share ? 0 : 9));
  for (const share of [0, 0.5, 1]) {
    pen.textAlign = ["left", "center", "right"][2 * share];
    pen.fillText(`${figure(share * last_b)} ${unit}`, margin.left + share * width, margin.top + height + 16);
  }
  pen.textAlign = "center";
  pen.fillText(pair.b, margin.left + width / 2, margin.top + height + 36);
  pen.save();
  pen.translate(12, margin.top + height / 2);
  pen.rotate(-Math.PI / 2);
  pen.fillText(pair.a, 0, 0);
  pen.restore();
}
