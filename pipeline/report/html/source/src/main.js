// Builds the page from the data that stands in it.
import { closureDialog, closureTable, funnel } from "./closures.js";
import { choice, el, figure, table, toggles } from "./dom.js";
import { matrices } from "./matrix.js";
import { radio } from "./radio.js";
import { report } from "./report.js";
import { scene3d } from "./scene.js";
import { team } from "./team.js";

function section(id, title, ...children) {
  const content = children.flat(2).filter(Boolean);
  if (!content.length) return null;
  return el("section", { id, "aria-labelledby": `${id}-title` }, el("h2", { id: `${id}-title` }, title), content);
}

const cards = (numbers) => el("dl", { class: "cards" }, numbers.map(({ label, value, note }) =>
  el("div", {}, el("dt", {}, label), el("dd", {}, value), note ? el("dd", { class: "note" }, note) : null)));

const list = (sentences) => el("ul", {}, sentences.map((sentence) => el("li", {}, sentence)));

function verdict(of) {
  return el("div", { class: `verdict ${of.tone}` },
    el("p", { class: "sentence" }, of.sentence),
    of.next?.length ? [el("p", { class: "next" }, "What to do next"), list(of.next)] : null,
    of.notes?.length ? el("details", { open: !of.next?.length }, el("summary", {}, "Notes"), list(of.notes)) : null);
}

const tables = (of) => (of ?? []).map((t) => [table(t.caption, t.header, t.rows, { wide: t.header.join(" ").length > 55 }), t.note ? el("p", { class: "note" }, t.note) : null]);

function costs(seconds) {
  if (!seconds?.total) return null;
  const bar = (value) => el("span", { class: "bar-cell" }, el("span", { class: "bar-track" }, el("span", { class: "bar", style: { width: `${(100 * value) / seconds.total}%` } })), `${figure((100 * value) / seconds.total, 2)} %`);
  const stages = Object.entries(seconds).filter(([stage, value]) => stage !== "total" && value >= 5e-4); // others did not run
  return table("Seconds per stage, as from raw scans", ["stage", "seconds", "share"],
    [...stages.map(([stage, value]) => [stage, value, bar(value)]), ["total", seconds.total, ""]]);
}

function reproduce(run) {
  if (!run.versions && !run.config) return null;
  return [
    run.config ? el("p", {}, "With the same recordings and these versions: ", el("code", {}, report.kind === "filter" ? "wiclosure filter ... --config config.yaml" : report.kind === "optimisation" ? "wiclosure optimize ... --config config.yaml" : "wiclosure run DATA --config config.yaml"), ", with the config.yaml of the run's folder.") : null,
    run.versions ? table("Versions", ["package", "version"], Object.entries(run.versions)) : null,
    run.config ? el("details", {}, el("summary", {}, "Configuration"), el("pre", { tabindex: "0" }, run.config)) : null,
  ];
}

async function showRun(run) {
  let scene;
  const dialog = run.closures?.length ? closureDialog(run, (index) => scene.highlight(index)) : null;
  const closures = dialog ? closureTable(run, dialog.open) : null;
  scene = await scene3d(run, (index) => dialog.open(index));
  document.getElementById("run").replaceChildren(...[
    report.runs.length > 1 ? verdict(run.verdict) : null,
    report.runs.length > 1 && run.numbers?.length ? cards(run.numbers) : null,
    section("map", run.map ? "Merged map" : "Paths", scene.node, run.map_note ? el("p", { class: "note" }, run.map_note) : null),
    section("funnel", report.kind === "optimisation" ? "What became of the closures" : "What became of the candidates", run.funnel?.length ? funnel(run, closures?.chooseReason) : null),
    section("team", "Who is joined to whom", team(run)),
    section("closures", "Closures", closures?.node, dialog?.dialog),
    section("candidates", "Candidate pairs", await matrices(run)),
    section("radio", "What the radio said", await radio(run)),
    section("costs", "What it cost", costs(run.seconds)),
    section("figures", "All figures", run.tables?.length ? el("div", { class: "tables" }, tables(run.tables).flat()) : null),
    section("reproduce", "To reproduce", reproduce(run)),
  ].filter(Boolean));
  navigation();
}

function navigation() {
  document.querySelector("nav ul").replaceChildren(...[...document.querySelectorAll("main section[id]")].map((part) =>
    el("li", {}, el("a", { href: `#${part.id}` }, part.querySelector("h2").textContent))));
}

function colours() {
  const root = document.documentElement;
  let chosen = "";
  const apply = (theme) => {
    root.dataset.theme = theme;
    document.dispatchEvent(new Event("themechange"));
  };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => apply(chosen));
  addEventListener("beforeprint", () => {
    for (const notes of document.querySelectorAll(".verdict details")) notes.open = true;
    apply("light");
  });
  addEventListener("afterprint", () => apply(chosen));
  return choice("Colours", [["", "as the system"], ["light", "light"], ["dark", "dark"]], (theme) => apply((chosen = theme)));
}

async function start() {
  document.querySelector("header").append(colours());
  const { runs } = report, first = report.look_at ?? 0;
  const of = report.verdict ?? runs[0].verdict, numbers = report.numbers ?? (runs.length === 1 ? runs[0].numbers : []);
  document.querySelector("main").replaceChildren(...[
    verdict(of),
    numbers?.length ? cards(numbers) : null,
    section("comparison", "All arms", tables(report.tables)),
    runs.length > 1
      ? el("div", { class: "arms" }, toggles("Look at the arm", runs.map((run, k) => ({ label: run.name, value: String(k), checked: k === first, change: () => showRun(run) })), { type: "radio", group: "arm" }))
      : null,
    el("div", { id: "run" }),
  ].filter(Boolean));
  await showRun(runs[first]);
  document.documentElement.dataset.ready = "true";
}

start();
