// What the robots measured of each other over time, against the estimate.
import uPlot from "uplot";
import { decode } from "./decode.js";
import { choice, details, el, figure, palette, table } from "./dom.js";

const known = (values) => Array.from(values, (v) => (Number.isNaN(v) ? null : v));

export async function radio(run) {
  const pairs = run.radio ?? [];
  if (!pairs.length) return null;
  const holder = el("div");
  const show = async (k) => holder.replaceChildren(await radioPair(pairs[k]));
  const summary = table("Alignment of two robots' odometry frames by the radio",
    ["robots", "certain", "measurements", "sigma of yaw, degrees", "sigma of x, m", "sigma of y, m", "alternatives", "odds against the next"],
    pairs.map((p) => [`${p.a} and ${p.b}`, p.certain, p.measured, p.sigma?.yaw_deg ?? null, p.sigma?.x_m ?? null, p.sigma?.y_m ?? null,
      p.alternatives.length, p.alternatives.length ? odds(Math.min(...p.alternatives.map((a) => a.odds))) : null]), { wide: true });
  await show(0);
  return [summary,
    pairs.length > 1 ? choice("Robots", pairs.map((p, k) => [k, `${p.a} and ${p.b}${p.certain ? "" : ": not certain"}`]), show) : null,
    holder];
}

const odds = (value) => (value >= 1e6 ? "over a million to 1" : `${figure(value, 2)} to 1`);

async function radioPair(pair) {
  const [times, range, estimate, direction, azimuth, kept, aReceives] = await Promise.all(
    [pair.times, pair.range, pair.estimate, pair.direction, pair.azimuth, pair.azimuth_kept, pair.a_receives].map(decode));
  const charts = [], plots = el("div", { class: "plots" });
  const add = (title, unit, series, data) => {
    const holder = el("div", { class: "plot", role: "img", "aria-label": title });
    plots.append(el("figure", {}, el("figcaption", {}, title), holder));
    charts.push(() => chart(holder, unit, series, data));
  };
  const residual = range.map((v, i) => v - estimate[i]);
  if (range.some((v) => !Number.isNaN(v))) {
    add("Range, m", "m", [{ label: "measured", colour: "radio", points: true }, { label: "by the estimate", colour: "text" }],
      [known(times), known(range), known(estimate)]);
    if (residual.some((v) => !Number.isNaN(v)))
      add("Range, measured minus estimate, m", "m", [{ label: "residual", colour: "radio", points: true }], [known(times), known(residual)]);
  }
  if (azimuth.some((v) => !Number.isNaN(v))) {
    const of = (i) => Math.floor(i / pair.paths); // every path at its measurement's time
    const paths = (flag) => Array.from(azimuth, (v, i) => (kept[i] === flag && !Number.isNaN(v) ? v : null));
    add("Directions of arrival, degrees counter-clockwise from ahead", "degrees",
      [{ label: "by the estimate", colour: "text", points: true, size: 9, hollow: true }, { label: "path kept", colour: "found", points: true },
        { label: "path left out", colour: "wasted", points: true }],
      [Array.from(azimuth, (_, i) => times[of(i)]), known(Array.from(azimuth, (_, i) => direction[of(i)])), paths(1), paths(0)]);
  }
  const redraw = () => {
    if (plots.isConnected) charts.forEach((draw) => draw());
  };
  document.addEventListener("themechange", redraw);
  new ResizeObserver(redraw).observe(plots);
  const sigma = pair.sigma;
  return el("div", {},
    el("h3", {}, `${pair.a} and ${pair.b}`),
    el("p", {}, el("strong", {}, pair.certain ? "The alignment is certain: " : "The alignment is not certain: "), `${pair.reason}.`),
    sigma ? el("p", {}, `Standard deviation of the alignment: ${figure(sigma.yaw_deg, 2)} degrees of yaw; ${figure(sigma.x_m, 2)} m along x, ${figure(sigma.y_m, 2)} m along y, ${figure(sigma.z_m, 2)} m in height.`) : null,
    pair.alternatives.length
      ? table("Alternative alignments", ["alternative", "odds of the best against it", "apart, m", "turned, degrees"],
          pair.alternatives.map((other, k) => [`${k + 1}`, odds(other.odds), other.apart_m, other.turned_deg]))
      : null,
    charts.length ? plots : el("p", { class: "note" }, "No measurement of these robots can be drawn."),
    times.length
      ? details(`${figure(times.length)}${times.length < pair.measured ? ` of ${figure(pair.measured)}` : ""} measurements as a table`, () => asTable())
      : null);

  function asTable() {
    const path = (i) => {
      const own = Array.from({ length: pair.paths }, (_, p) => i * pair.paths + p).filter((k) => !Number.isNaN(azimuth[k]));
      const chosen = own.find((k) => kept[k]);
      return [own.length, chosen === undefined ? null : azimuth[chosen], Number.isNaN(direction[i]) ? null : direction[i]];
    };
    return table("Measurements", ["time, s", "receiver", "range, m", "by the estimate, m", "residual, m", "paths", "path kept, degrees", "direction by the estimate, degrees"],
      Array.from(times.keys(), (i) => [times[i].toFixed(2), aReceives[i] ? pair.a : pair.b, ...known([range[i], estimate[i], residual[i]]), ...path(i)]), { wide: true });
  }
}

function chart(holder, unit, series, data) {
  const colour = palette(), font = "14px system-ui, sans-serif";
  const width = Math.max(240, holder.clientWidth || 600);
  const axis = { stroke: colour("text"), grid: { stroke: colour("rule"), width: 1 }, ticks: { stroke: colour("rule") }, font, labelFont: font, labelSize: 22 };
  holder.replaceChildren();
  new uPlot(
    {
      width,
      height: 240,
      scales: { x: { time: false }, ...(unit === "degrees" ? { y: { range: [-190, 190] } } : {}) },
      cursor: { show: false },
      legend: { live: false, markers: { width: 0, fill: (_, k) => colour(series[k - 1]?.colour ?? "text") } },
      axes: [{ ...axis, label: "time, s" }, { ...axis, label: unit, size: 58, ...(unit === "degrees" ? { splits: () => [-180, -90, 0, 90, 180] } : {}) }],
      series: [
        { label: "time, s" },
        ...series.map((s) => ({
          label: s.label,
          stroke: colour(s.colour),
          width: s.points ? 0 : 1.5,
          paths: s.points ? () => null : undefined,
          points: { show: Boolean(s.points), size: s.size ?? 6, width: s.hollow ? 1.5 : 0, fill: s.hollow ? "transparent" : colour(s.colour), stroke: colour(s.colour) },
          spanGaps: !s.points,
        })),
      ],
    },
    data,
    holder,
  );
}
