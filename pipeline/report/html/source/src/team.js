// Who is joined to whom: a circle of robots, lines as thick as accepted closures are many.
import { el, figure, table } from "./dom.js";

const SIZE = 360, RADIUS = 130;

export function team(run) {
  if (run.robots.length < 3 || !run.closures?.length) return null;
  const pairs = new Map();
  for (const { query, match, decision } of run.closures) {
    if (query[0] === match[0]) continue;
    const names = [query[0], match[0]].sort(), key = JSON.stringify(names);
    const pair = pairs.get(key) ?? pairs.set(key, { names, accepted: 0, rejected: 0 }).get(key);
    pair[decision === "rejected" ? "rejected" : "accepted"]++;
  }
  const rows = [...pairs.values()].sort((a, b) => b.accepted - a.accepted);
  return el("div", { class: "columns" }, picture(run.robots, rows),
    table("Closures between robots", ["robots", "accepted", "rejected"], rows.map((pair) => [pair.names.join(" and "), pair.accepted, pair.rejected])));
}

function svg(tag, attributes, ...children) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  node.append(...children);
  return node;
}

function picture(robots, pairs) {
  const at = new Map(robots.map((robot, k) => {
    const angle = (2 * Math.PI * k) / robots.length - Math.PI / 2;
    return [robot.name, [SIZE / 2 + RADIUS * Math.cos(angle), SIZE / 2 + RADIUS * Math.sin(angle)]];
  }));
  const most = Math.max(1, ...pairs.map((pair) => pair.accepted));
  const lines = pairs.map(({ names, accepted, rejected }) => {
    const [[x1, y1], [x2, y2]] = names.map((name) => at.get(name));
    return svg("line", { x1, y1, x2, y2, class: accepted ? "joined" : "refused", "stroke-width": accepted ? 1.5 + (6 * accepted) / most : 1.5 },
      svg("title", {}, `${names.join(" and ")}: ${figure(accepted)} accepted, ${figure(rejected)} rejected`));
  });
  const dots = robots.flatMap((robot) => {
    const [x, y] = at.get(robot.name), right = x > SIZE / 2 + 1, middle = Math.abs(x - SIZE / 2) <= 1;
    return [svg("circle", { cx: x, cy: y, r: 9, fill: robot.colour }),
      svg("text", { x: middle ? x : x + (right ? 14 : -14), y: middle ? y + (y < SIZE / 2 ? -16 : 26) : y + 5, "text-anchor": middle ? "middle" : right ? "start" : "end" }, robot.name)];
  });
  return svg("svg", { viewBox: `-70 0 ${SIZE + 140} ${SIZE}`, class: "team", role: "img", "aria-label": "Robots that accepted closures join; the table beside it says the same" }, ...lines, ...dots);
}
