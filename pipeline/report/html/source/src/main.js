// Builds the page from the data that stands in it.
import { closureDetail, closureTable, funnel } from "./closures.js";
import { el, figure, table } from "./dom.js";
import { matrix } from "./matrix.js";
import { radio } from "./radio.js";
import { scene3d } from "./scene.js";

const report = JSON.parse(document.getElementById("report-data").textContent);

function section(id, title, ...children) {
  const content = children.flat().filter(Boolean);
  if (!content.length) return null;
  return el("section", { id, "aria-labelledby": `${id}-title` }, el("h2", { id: `${id}-title` }, title), content);
}

function cards(numbers) {
  return el("dl", { class: "cards" }, numbers.map(({ label, value, note }) =>
    el("div", {}, el("dt", {}, label), el("dd", {}, typeof value === "number" ? figure(value) : (value ?? "–")), note ? el("dd", { class: "note" }, note) : null)));
}

function verdict(of) {
  return el("div", { class: `verdict ${of.tone}`, role: "status" }, el("p", { class: "sentence" }, of.sentence),
    of.next?.length ? el("ul", {}, of.next.map((step) => el("li", {}, step))) : null);
}

function comparison(of) {
  if (!of) return null;
  return [
    table("Arms side by side", of.header, of.rows),
    el("p", { class: "note" }, of.note ?? ""),
  ];
}

function costs(run) {
  if (!run.seconds) return null;
  const total = run.seconds.total || 1;
  const rows = Object.entries(run.seconds).filter(([stage]) => stage !== "total");
  const bar = (seconds) => el("span", { class: "bar", style: { width: `${(100 * seconds) / total}%` } });
  return [
    table("Seconds per stage, as from raw scans", ["stage", "seconds", "share"], [
      ...rows.map(([stage, seconds]) => [stage, seconds, el("span", { class: "bar-cell" }, bar(seconds), `${figure((100 * seconds) / total, 2)} %`)]),
      ["total", run.seconds.total, ""],
    ]),
    table("Memory and bytes", ["what", "value"], [
      ["peak memory, MB", run.peak_rss_mb], ["bytes between the robots", run.bytes_exchanged],
    ]),
  ];
}

async function showRun(run, arms) {
  const detail = el("div", { id: "closure", "aria-live": "polite" });
  const open = async (index) => {
    detail.replaceChildren(await closureDetail(run, index));
    detail.scrollIntoView({ block: "nearest" });
  };
  const closures = run.closures?.length ? closureTable(run, open) : null;
  const main = document.getElementById("run");
  main.replaceChildren(...[
    arms.length > 1 ? el("p", { class: "note" }, `Everything below is of the arm ${run.name}.`) : null,
    run.robots?.length ? section("map", "Merged map", await scene3d(run, { onClosure: open }), run.map_note ? el("p", { class: "note" }, run.map_note) : null) : null,
    section("funnel", "What became of the candidates", run.funnel?.length ? funnel(run, (reason) => closures?.choose(reason)) : null),
    section("closures", "Closures", closures?.node, closures ? detail : null),
    section("candidates", "Candidate pairs", await Promise.all((run.matrices ?? []).map((pair, k) => matrix(pair, `${run.id}-${k}`)))),
    section("radio", "What the radio said", await Promise.all((run.radio ?? []).map(radio))),
    section("costs", "What it cost", costs(run)),
    section("figures", "All figures", (run.tables ?? []).map((t) => table(t.caption, t.header, t.rows))),
    section("reproduce", "To reproduce", el("p", {}, run.command ? el("code", {}, run.command) : "", ""),
      run.versions ? table("Versions", ["package", "version"], Object.entries(run.versions), { numeric: false }) : null,
      run.config ? el("details", {}, el("summary", {}, "Configuration"), el("pre", { tabindex: "0" }, run.config)) : null),
  ].filter(Boolean));
  navigation();
}

function navigation() {
  const nav = document.querySelector("nav ul");
  nav.replaceChildren(...[...document.querySelectorAll("main section[id]")].map((part) =>
    el("li", {}, el("a", { href: `#${part.id}` }, part.querySelector("h2").textContent))));
}

function theme() {
  const choices = ["as the system", "light", "dark"];
  const apply = (choice) => {
    document.documentElement.dataset.theme = { light: "light", dark: "dark" }[choice] ?? "";
    document.dispatchEvent(new Event("themechange"));
  };
  return el("label", { class: "theme" }, "Colours ",
    el("select", { onchange: (event) => apply(event.target.value) }, choices.map((choice) => el("option", {}, choice))));
}

async function start() {
  document.querySelector("header").append(theme());
  const runs = report.runs;
  const main = document.querySelector("main");
  const chosen = runs.length > 1
    ? el("fieldset", { class: "toggles arms" }, el("legend", {}, "Look at arm"), runs.map((run, k) =>
        el("label", { class: "toggle" }, el("input", { type: "radio", name: "arm", checked: k === runs.length - 1, onchange: () => showRun(run, runs) }), run.name)))
    : null;
  main.replaceChildren(...[
    verdict(report.verdict),
    report.numbers?.length ? cards(report.numbers) : null,
    section("comparison", "Side by side", comparison(report.comparison)),
    chosen,
    el("div", { id: "run" }),
  ].filter(Boolean));
  if (runs.length) await showRun(runs[runs.length - 1], runs);
  document.documentElement.dataset.ready = "true";
}

start();
