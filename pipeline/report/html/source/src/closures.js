// The funnel with reasons, the table of closures, and one closure in detail: both scans laid over each other.
import { decode } from "./decode.js";
import { el, figure, palette, table } from "./dom.js";

export function funnel(run, onChoose) {
  const most = Math.max(1, ...run.funnel.map((stage) => stage.count));
  const width = (count) => `${Math.max(0.5, (100 * Math.log1p(count)) / Math.log1p(most))}%`;
  return el(
    "ol",
    { class: "funnel" },
    run.funnel.map((stage) =>
      el(
        "li",
        {},
        el("div", { class: "funnel-row" },
          el("span", { class: "funnel-name" }, stage.stage),
          el("span", { class: "funnel-bar", style: { width: width(stage.count) } }),
          el("span", { class: "funnel-count" }, figure(stage.count),
            stage.true === null || stage.true === undefined ? "" : ` (${figure(stage.true)} true, ${figure(stage.false)} false)`),
        ),
        stage.reasons?.length
          ? el("ul", { class: "reasons" }, stage.reasons.map((reason) =>
              el("li", {}, el("button", { type: "button", class: "link", onclick: () => onChoose(reason) },
                `${figure(reason.count)} lost here: ${reason.text}`))))
          : null,
      ),
    ),
    el("li", { class: "note" }, "Bars are logarithmic. A reason chooses its closures in the table below."),
  );
}

const SHOWN = 200;

export function closureTable(run, onClosure) {
  const body = el("div");
  const filter = el("select", { "aria-label": "Which closures" },
    el("option", { value: "" }, `all ${run.closures.length} closures`),
    ["accepted", "rejected"].map((d) => el("option", { value: d }, `${d}: ${run.closures.filter((c) => c.decision === d).length}`)),
  );
  let chosen = (c) => !filter.value || c.decision === filter.value;
  let title = "";
  const show = () => {
    const rows = run.closures.map((c, k) => [c, k]).filter(([c]) => chosen(c));
    const shown = rows.slice(0, SHOWN);
    body.replaceChildren(
      table(
        title || "Closures",
        ["closure", "decision", "reason", "inlier ratio", "prediction's chi-square", "residual, m"],
        shown.map(([c, k]) => [
          el("button", { type: "button", class: "link", onclick: () => onClosure(k) }, `${c.query.join(" ")} – ${c.match.join(" ")}`),
          c.decision, c.reason, c.inlier_ratio, c.prior_chi2, c.residual_m,
        ]),
      ),
      rows.length > SHOWN ? el("p", { class: "note" }, `The first ${SHOWN} of ${rows.length}; closures.csv holds all.`) : "",
    );
  };
  filter.addEventListener("change", () => {
    title = "";
    chosen = (c) => !filter.value || c.decision === filter.value;
    show();
  });
  show();
  const choose = (reason) => {
    const rows = new Set(reason.rows);
    filter.value = "";
    title = `Closures: ${reason.text}`;
    chosen = (c) => rows.has(run.closures.indexOf(c));
    show();
    body.scrollIntoView({ block: "nearest" });
  };
  return { node: el("div", {}, el("p", {}, filter), body), choose };
}

export async function closureDetail(run, index) {
  const c = run.closures[index];
  const evidence = [
    ["decision", c.decision], ["reason", c.reason], ["rejected at", c.rejected_at],
    ["scan context distance", c.scan_context_distance], ["overlap probability by the filter", c.overlap_probability],
    ["squared Mahalanobis distance from the prediction", c.prior_chi2], ["matched points", c.inliers],
    ["inlier ratio", c.inlier_ratio], ["agreement with free space", c.agreement], ["rms of matched points, m", c.rms_m],
    ["closures that agree", c.consistent_with], ["residual in the estimate, m", c.residual_m],
    ["residual in the estimate, rad", c.residual_rad], ["true, by ground truth", c.right],
  ].filter(([, value]) => value !== null && value !== undefined && value !== "");
  const picture = await overlay(run, c);
  return el("div", { class: "detail" },
    el("h4", {}, `${c.query.join(" ")} – ${c.match.join(" ")}`),
    el("div", { class: "columns" }, picture, table("Evidence", ["what", "value"], evidence)),
  );
}

async function overlay(run, c) {
  const [query, match] = await Promise.all([c.query, c.match].map((key) => decode(run.clouds?.[key.join(":")])));
  if (!query || !match) return el("p", { class: "note" }, "The scans of this closure are not kept in the report.");
  const size = 420;
  const canvas = el("canvas", { width: size, height: size, class: "overlay", role: "img",
    "aria-label": `Scans of ${c.query.join(" ")} and ${c.match.join(" ")} from above, laid over each other` });
  const scale = run.cloud_scale_m, T = c.T_query_match;
  const flat = (cloud, [a, b, x, d, e, y, g]) => {
    const out = new Float32Array((2 * cloud.length) / 3);
    for (let i = 0, o = 0; i < cloud.length; i += 3, o += 2) {
      const [p, q, r] = [cloud[i] * scale, cloud[i + 1] * scale, cloud[i + 2] * scale];
      out[o] = a * p + b * q + g[0] * r + x;
      out[o + 1] = d * p + e * q + g[1] * r + y;
    }
    return out;
  };
  const one = flat(query, [1, 0, 0, 0, 1, 0, [0, 0]]);
  const two = flat(match, [T[0], T[1], T[3], T[4], T[5], T[7], [T[2], T[6]]]);
  const reach = Math.max(10, quantile(one.map(Math.abs), 0.97));
  const draw = () => {
    const colour = palette(), pen = canvas.getContext("2d"), k = size / 2 / reach;
    pen.fillStyle = colour("canvas");
    pen.fillRect(0, 0, size, size);
    pen.globalAlpha = 0.55;
    for (const [points, name] of [[one, c.query[0]], [two, c.match[0]]]) {
      pen.fillStyle = run.robots.find((robot) => robot.name === name)?.colour ?? colour("text");
      for (let i = 0; i < points.length; i += 2) pen.fillRect(size / 2 - k * points[i + 1], size / 2 - k * points[i], 1.6, 1.6);
    }
    pen.globalAlpha = 1;
  };
  draw();
  document.addEventListener("themechange", draw);
  return el("figure", {}, canvas, el("figcaption", {}, `From above, ${figure(2 * reach, 2)} m wide, in the query's axes, x up; the match as measured.`));
}

function quantile(values, q) {
  const sorted = Float32Array.from(values).sort();
  return sorted[Math.floor(q * (sorted.length - 1))] ?? 1;
}
