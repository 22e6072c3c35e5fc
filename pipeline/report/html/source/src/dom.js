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
  for (const child of children.flat()) {
    if (child === null || child === undefined || child === false) continue;
    node.append(child instanceof Node ? child : document.createTextNode(String(child)));
  }
  return node;
}

export function figure(value, digits = 3) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (typeof value !== "number") return String(value);
  if (Number.isInteger(value) || Math.abs(value) >= 1000) return Math.round(value).toLocaleString("en");
  return value.toPrecision(digits);
}

export function table(caption, header, rows, { numeric = true, rowAttributes = () => ({}) } = {}) {
  return el(
    "div",
    { class: "scroll", tabindex: "0", role: "region", "aria-label": caption },
    el(
      "table",
      {},
      el("caption", {}, caption),
      el("thead", {}, el("tr", {}, header.map((name) => el("th", { scope: "col" }, name)))),
      el(
        "tbody",
        {},
        rows.map((row, index) =>
          el(
            "tr",
            rowAttributes(row, index),
            row.map((cell, column) =>
              column === 0
                ? el("th", { scope: "row" }, cell)
                : el("td", { class: numeric && typeof cell === "number" ? "number" : "" }, cell instanceof Node ? cell : figure(cell)),
            ),
          ),
        ),
      ),
    ),
  );
}

export function toggles(legend, options, { type = "checkbox", name } = {}) {
  const inputs = options.map(({ label, checked, swatch, change, value }) => {
    const input = el("input", { type, name, value, checked, onchange: (event) => change(event.target.checked, value) });
    return el("label", { class: "toggle" }, input, swatch ? el("span", { class: "swatch", style: { background: swatch } }) : null, label);
  });
  return el("fieldset", { class: "toggles" }, el("legend", {}, legend), inputs);
}

export const palette = () => {
  const style = getComputedStyle(document.documentElement);
  return (name) => style.getPropertyValue(`--${name}`).trim();
};
