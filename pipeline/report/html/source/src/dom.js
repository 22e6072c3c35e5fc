// Elements without a framework.  Text is always set as text, never as HTML: names come from recordings.
export function el(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
    else if (key === "style") Object.assign(node.style, value);
    else if (key === "class") node.className = value;
    else node.setAttribute(key, value === true ? "" : value);
  }
  for (const child of children.flat(2)) {
    if (child === null || child === undefined || child === false) continue;
    node.append(child instanceof Node ? child : document.createTextNode(String(child)));
  }
  return node;
}

export function figure(value, digits = 2) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (typeof value === "boolean") return value ? "yes" : "no";
  if (typeof value !== "number") return String(value);
  const size = Math.abs(value);
  if (Number.isInteger(value) || size >= 10 ** (digits - 1)) return Math.round(value).toLocaleString("en");
  if (size < 1e-3) return value > 0 ? "< 0.001" : value.toPrecision(1);
  return value.toPrecision(digits);
}

export const name = (key) => key.join(" ");

// A cell is text, a number, a node, or {text, note, link}.
function content(cell) {
  if (cell instanceof Node) return cell;
  if (cell === null || typeof cell !== "object") return figure(cell);
  const text = cell.link ? el("a", { href: cell.link }, cell.text) : cell.text;
  return cell.note ? [text, el("span", { class: "difference" }, cell.note)] : text;
}

const NUMBER = /^[-+–−]?[\d.,]+( ?(%|m|s|MB|°))?( \[.*\])?$/;
const numeric = (cell) => cell === null || typeof cell === "number" || NUMBER.test(typeof cell === "object" ? (cell.text ?? "") : cell);

export function table(caption, header, rows, { wide = false } = {}) {
  const right = header.map((_, column) => column > 0 && rows.length > 0 && rows.every((row) => !(row[column] instanceof Node) && numeric(row[column] ?? null)));
  const prose = header.map((_, column) => rows.some((row) => typeof row[column] === "string" && row[column].length > 30));
  const css = (column) => (right[column] ? "number" : prose[column] ? "prose" : undefined);
  return el("div", { class: `scroll${wide ? " wide" : ""}${rows.length > 15 ? " long" : ""}`, tabindex: "0", role: "region", "aria-label": caption },
    el("table", {},
      el("caption", {}, el("span", {}, caption)),
      el("thead", {}, el("tr", {}, header.map((title, column) =>
        title === "" ? el("td") : el("th", { scope: "col", class: css(column) }, title)))),
      el("tbody", {}, rows.map((row) => el("tr", {}, row.map((cell, column) =>
        column === 0 ? el("th", { scope: "row" }, content(cell)) : el("td", { class: css(column) }, content(cell))))))));
}

export function toggles(legend, options, { type = "checkbox", group } = {}) {
  const inputs = options.map(({ label, checked, swatch, change, value }) => {
    const input = el("input", { type, name: group, value, checked, onchange: (event) => change(event.target.checked, value) });
    return el("label", { class: "toggle" }, input, swatch ? el("span", { class: "swatch", style: { background: swatch } }) : null, label);
  });
  return el("fieldset", { class: "toggles" }, el("legend", {}, legend), inputs);
}

export function choice(label, options, change) {
  return el("label", { class: "choice" }, `${label} `,
    el("select", { onchange: (event) => change(event.target.value) }, options.map(([value, text]) => el("option", { value }, text))));
}

// A part that is built when it is first opened: long tables cost time and memory.
export function details(summary, build) {
  const node = el("details", {}, el("summary", {}, summary));
  node.addEventListener("toggle", () => node.open && node.children.length === 1 && node.append(build()));
  return node;
}

export const palette = () => {
  const style = getComputedStyle(document.documentElement);
  return (key) => style.getPropertyValue(`--${key}`).trim();
};

// Draws now and whenever the colours change, as long as the node is in the page.
export function themed(node, draw) {
  draw();
  const again = () => (node.isConnected ? draw() : document.removeEventListener("themechange", again));
  document.addEventListener("themechange", again);
}
