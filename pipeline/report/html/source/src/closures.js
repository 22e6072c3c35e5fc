// The funnel with reasons, the table of closures, and one closure in detail: both scans laid over each other.
import { decode } from "./decode.js";
import { el, figure, name, palette, table, themed, toggles } from "./dom.js";

// What each stage leaves, and why the rest is lost where that is no closure's own reason.
const STAGES = {
  read: ["closures in the files"],
  pairs: ["pairs of keyframes"],
  kept: ["kept by the filter", "their paths do not come near each other there, as the filter sees it"],
  "scan context": ["look alike (scan context)", "look different, or another pair beside them looks more alike"],
  registered: ["registered"],
  "radio check": ["agree with the radio"],
  PCM: ["agree with each other (consistency check)"],
  graph: ["fit the estimate (pose graph)"],
};

export function funnel(run, onChoose) {
  const most = Math.max(1, ...run.funnel.map((stage) => stage.count));
  const width = (count) => `${count ? Math.max(1, (100 * Math.log1p(count)) / Math.log1p(most)) : 0}%`;
  const reason = (of) => el("li", {}, el("button", { type: "button", class: "link", onclick: () => onChoose(of) }, `${figure(of.count)} rejected: ${of.text}`));
  return [
    el("ol", { class: "funnel" }, run.funnel.map((stage, k) => {
      const lost = k ? run.funnel[k - 1].count - stage.count : 0;
      const [title, why] = STAGES[stage.stage] ?? [stage.stage];
      return el("li", {},
        el("div", { class: "funnel-row" },
          el("span", { class: "funnel-name" }, title),
          el("span", { class: "funnel-track" }, el("span", { class: "funnel-bar", style: { width: width(stage.count) } })),
          el("span", { class: "funnel-count" }, el("strong", {}, figure(stage.count)),
            stage.true === null || stage.true === undefined ? "" : ` (${figure(stage.true)} true, ${figure(stage.false)} false)`)),
        why && lost > 0 ? el("p", { class: "lost" }, `${figure(lost)} lost: ${why}.`) : null,
        stage.reasons?.length ? el("ul", { class: "reasons" }, stage.reasons.map(reason)) : null);
    })),
    el("p", { class: "note" }, "Bars are logarithmic. True and false by ground truth, where there is any. A reason leads to its closures."),
  ];
}

const SHOWN = 100;

const KINDS = {
  all: ["all", () => true],
  accepted: ["accepted", (c) => c.decision === "accepted"],
  rejected: ["rejected", (c) => c.decision === "rejected"],
  false: ["accepted, but false", (c) => c.decision === "accepted" && c.true === false],
  missed: ["rejected, but true", (c) => c.decision === "rejected" && c.true === true],
};

export function closureTable(run, onClosure) {
  const body = el("div"), select = el("select", { id: "which-closures" });
  const judged = run.closures.some((c) => typeof c.true === "boolean");
  let rows = [], shown = SHOWN, title = "Closures";
  const kinds = Object.entries(KINDS).map(([key, [label, test]]) => [key, label, run.closures.filter(test).length]);
  select.append(...kinds.filter(([key, , count]) => key === "all" || count).map(([key, label, count]) => el("option", { value: key }, `${label}: ${figure(count)}`)));
  const columns = [
    ["decision", (c) => c.decision], ["reason", (c) => c.reason],
    ...(judged ? [["true", (c) => c.true ?? null]] : []),
    ["inlier ratio", (c) => c.inlier_ratio], ["chi-square from prediction", (c) => c.prior_chi2], ["off the estimate, m", (c) => c.residual_m],
  ].filter(([, value]) => run.closures.some((c) => value(c) !== undefined && value(c) !== null && value(c) !== ""));
  const show = () => {
    body.replaceChildren(
      table(title, ["closure", ...columns.map(([label]) => label)], rows.slice(0, shown).map((k) => {
        const c = run.closures[k];
        return [
          el("button", { type: "button", class: "link closure", "aria-haspopup": "dialog", onclick: () => onClosure(k, rows) }, `${name(c.query)} – ${name(c.match)}`),
          ...columns.map(([, value]) => value(c) ?? null),
        ];
      }), { wide: true }),
      rows.length > shown
        ? el("button", { type: "button", onclick: () => ((shown += 5 * SHOWN), show()) }, `show more (${figure(shown)} of ${figure(rows.length)} shown)`)
        : "",
    );
  };
  const choose = (chosen, heading) => {
    [rows, shown, title] = [chosen, SHOWN, heading];
    show();
  };
  const byKind = () => choose([...run.closures.keys()].filter((k) => KINDS[select.value][1](run.closures[k])), "Closures");
  select.addEventListener("change", byKind);
  byKind();
  const node = el("div", {}, el("p", {}, el("label", { for: "which-closures" }, "Show "), select), body);
  return {
    node,
    chooseReason(reason) {
      select.value = "all";
      choose(reason.rows, `Closures: ${reason.text}`);
      node.scrollIntoView({ block: "start" });
      body.querySelector("button")?.focus({ preventScroll: true });
    },
  };
}

const EVIDENCE = [
  ["rejected at", "rejected_at"], ["true, by ground truth", "true"], ["scan context distance", "scan_context_distance"],
  ["probability of overlap, by the filter", "overlap_probability"], ["chi-square from the prediction", "prior_chi2"],
  ["matched points of structure", "inliers"], ["share of structure that matches", "inlier_ratio"],
  ["agreement: matched, not in free-space conflict", "agreement"], ["rms of matched points, m", "rms_m"],
  ["other closures that agree", "consistent_with"], ["off the estimate, m", "residual_m"], ["off the estimate, degrees", "residual_deg"],
];

// A dialog over the page: Escape closes it, and focus goes back to where it was.
export function closureDialog(run, onShow) {
  const body = el("div"), title = el("h2", { id: "closure-title", tabindex: "-1" });
  const step = (by) => el("button", { type: "button", onclick: () => show(at + by) }, by < 0 ? "previous" : "next");
  const [previous, next] = [step(-1), step(1)];
  const dialog = el("dialog", { "aria-labelledby": "closure-title" },
    el("div", { class: "dialog-bar" }, title, el("div", { class: "buttons" }, previous, next,
      el("button", { type: "button", onclick: () => dialog.close() }, "close"))), body);
  let rows = [], at = 0;
  const show = async (k) => {
    at = k;
    const c = run.closures[rows[at]];
    previous.disabled = at === 0;
    next.disabled = at === rows.length - 1;
    title.textContent = `${name(c.query)} – ${name(c.match)}`;
    const evidence = EVIDENCE.map(([label, key]) => [label, c[key]]).filter(([, value]) => value !== null && value !== undefined);
    const picture = await overlay(run, c);
    body.replaceChildren(
      el("p", { class: `decision ${c.decision}` }, el("strong", {}, c.decision), c.reason ? `: ${c.reason}` : ""),
      el("div", { class: "columns" }, picture, table("Evidence", ["what", "value"], evidence)));
    onShow(rows[at]);
  };
  return {
    dialog,
    async open(index, among) {
      rows = among?.includes(index) ? among : [index];
      await show(rows.indexOf(index));
      if (!dialog.open) dialog.showModal();
      title.focus();
    },
  };
}

async function overlay(run, c) {
  const [query, match] = await Promise.all([c.query, c.match].map((key) => decode(run.clouds?.[key.join(":")])));
  if (!query?.length || !match?.length) return el("p", { class: "note" }, "The scans of this closure are not in the report.");
  const size = 480, T = c.T_query_match;
  const canvas = el("canvas", { width: size, height: size, class: "overlay", role: "img",
    "aria-label": `Scans of ${name(c.query)} and ${name(c.match)} from above, laid over each other` });
  const flat = (cloud, [a, b, g, x, d, e, h, y]) => {
    const out = new Float32Array((2 * cloud.length) / 3);
    for (let i = 0, o = 0; i < cloud.length; i += 3, o += 2) {
      out[o] = a * cloud[i] + b * cloud[i + 1] + g * cloud[i + 2] + x;
      out[o + 1] = d * cloud[i] + e * cloud[i + 1] + h * cloud[i + 2] + y;
    }
    return out;
  };
  const clouds = [[flat(query, [1, 0, 0, 0, 0, 1, 0, 0]), c.query, "query"], [flat(match, T), c.match, "match"]];
  const places = [0, 1].map((axis) => clouds.flatMap(([points]) => [...points].filter((_, i) => i % 2 === axis)));
  const [low, high] = [0.02, 0.98].map((q) => places.map((along) => quantile(along, q)));
  const middle = low.map((least, axis) => (least + high[axis]) / 2);
  const reach = Math.max(10, ...high.map((most, axis) => 1.05 * (most - middle[axis]))); // nearly all of both scans
  const shown = [true, true];
  const colours = () => {
    const own = (key) => run.robots.find((robot) => robot.name === key[0])?.colour;
    return c.query[0] === c.match[0] ? [own(c.query), palette()("missed")] : clouds.map(([, key]) => own(key));
  };
  const draw = () => {
    const pen = canvas.getContext("2d"), k = size / 2 / reach;
    pen.fillStyle = palette()("canvas");
    pen.fillRect(0, 0, size, size);
    pen.globalAlpha = 0.6;
    clouds.forEach(([points], n) => {
      if (!shown[n]) return;
      pen.fillStyle = colours()[n] ?? palette()("text");
      for (let i = 0; i < points.length; i += 2) pen.fillRect(size / 2 - k * (points[i + 1] - middle[1]) - 1, size / 2 - k * (points[i] - middle[0]) - 1, 2, 2);
    });
    pen.globalAlpha = 1;
  };
  themed(canvas, draw);
  return el("figure", {},
    toggles("Scans", clouds.map(([, key, role], n) => ({ label: `${role}: ${name(key)}`, checked: true, swatch: colours()[n], change: (on) => ((shown[n] = on), draw()) }))),
    canvas,
    el("figcaption", {}, `From above, ${figure(2 * reach, 2)} m across, the query's x axis up; the match where it was ${c.inliers === undefined ? "taken to be" : "measured"}.`));
}

function quantile(values, q) {
  const sorted = Float32Array.from(values).sort();
  return sorted[Math.floor(q * (sorted.length - 1))] ?? 1;
}
