// What the robots measured of each other over time, against the estimate.
import uPlot from "uplot";
import { decode } from "./decode.js";
import { el, figure, palette, table } from "./dom.js";

export async function radio(pair) {
  const [times, range, estimate, azimuth, kept, direction] = await Promise.all(
    [pair.times, pair.range, pair.estimate, pair.azimuth, pair.azimuth_kept, pair.direction].map(decode),
  );
  const plots = el("div", { class: "plots" });
  const charts = [];
  const add = (title, unit, series, data) => {
    const holder = el("div", { class: "plot" });
    plots.append(el("figure", {}, holder, el("figcaption", {}, title)));
    charts.push(() => chart(holder, unit, series, data));
  };
  const numbers = (array) => Array.from(array, (v) => (Number.isNaN(v) ? null : v));
  const ranged = range && range.some((v) => !Number.isNaN(v));
  if (ranged) {
    add("Range, measured and by the estimate, m", "m",
      [{ label: "measured", colour: "radio", points: true }, { label: "estimate", colour: "text" }],
      [Array.from(times), numbers(range), numbers(estimate)]);
    add("Range: measured minus estimate, m", "m", [{ label: "residual", colour: "radio", points: true }],
      [Array.from(times), Array.from(range, (v, i) => (Number.isNaN(v) || Number.isNaN(estimate[i]) ? null : v - estimate[i]))]);
  }
  if (azimuth?.length) {
    const width = azimuth.length / times.length;
    const degrees = (v) => (Number.isNaN(v) ? null : (v * 180) / Math.PI);
    const paths = (flag) => Array.from(azimuth, (v, i) => (kept[i] === flag ? degrees(v) : null));
    add("Paths, and the direction by the estimate, degrees counter-clockwise from ahead", "degrees",
      [{ label: "direction by the estimate", colour: "text" }, { label: "path kept", colour: "found", points: true },
        { label: "path left out", colour: "faint", points: true }],
      [Array.from(azimuth, (_, i) => times[Math.floor(i / width)]), // every path at its time
        Array.from(azimuth, (_, i) => degrees(direction[Math.floor(i / width)])), paths(1), paths(0)]);
  }
  const redraw = () => charts.forEach((draw) => draw());
  document.addEventListener("themechange", redraw);
  new ResizeObserver(redraw).observe(plots);
  const sigma = pair.sigma;
  return el("div", {},
    el("h3", {}, `${pair.a} and ${pair.b}`),
    el("p", {}, pair.says),
    sigma ? el("p", {}, `Standard deviation of the alignment: ${figure(sigma.yaw_deg)} degrees of yaw, ${figure(sigma.x_m)}, ${figure(sigma.y_m)} and ${figure(sigma.z_m)} m.`) : null,
    pair.alternatives?.length
      ? table("Alternative alignments", ["alternative", "odds for the best against it", "apart, m", "turned, degrees"],
          pair.alternatives.map((other, k) => [`${k + 1}`, other.odds, other.apart_m, other.turned_deg]))
      : null,
    times.length ? plots : null,
    times.length
      ? el("details", {}, el("summary", {}, `${times.length} measurements as a table`),
          table("Measurements", ["time, s", "range, m", "estimate, m", "residual, m"],
            Array.from(times.keys()).slice(0, 500).map((i) => [figure(times[i], 6), range[i], estimate[i], range[i] - estimate[i]])))
      : null,
  );
}

function chart(holder, unit, series, data) {
  const colour = palette();
  const width = Math.max(240, holder.clientWidth || 600);
  const axis = { stroke: colour("text"), grid: { stroke: colour("rule"), width: 1 }, ticks: { stroke: colour("rule") }, font: "13px system-ui, sans-serif" };
  holder.replaceChildren();
  new uPlot(
    {
      width,
      height: 230,
      scales: { x: { time: false } },
      legend: { live: false },
      axes: [{ ...axis, label: "s", labelFont: "13px system-ui, sans-serif", labelSize: 20 }, { ...axis, label: unit, labelFont: "13px system-ui, sans-serif", labelSize: 20, size: 56 }],
      series: [
        { label: "time, s" },
        ...series.map((s) => ({
          label: s.label,
          stroke: colour(s.colour),
          width: s.points ? 0 : 1.5,
          paths: s.points ? () => null : undefined,
          points: { show: Boolean(s.points), size: 5, fill: colour(s.colour), stroke: colour(s.colour) },
          spanGaps: !s.points,
        })),
      ],
    },
    data,
    holder,
  );
}
