// Makes ../assets/report.js, report.css and LICENSES.txt of what lies in src/: `npm install && npm run build`.
import { build } from "esbuild";
import { copyFileSync, mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const assets = process.argv[2] ?? join(here, "../assets");
mkdirSync(assets, { recursive: true });
await build({
  entryPoints: [join(here, "src/main.js")],
  outfile: join(assets, "report.js"),
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2022",
  charset: "utf8",
  legalComments: "none", // they stand in LICENSES.txt
});
await build({
  entryPoints: [join(here, "src/report.css")],
  outfile: join(assets, "report.css"),
  bundle: true,
  minify: true,
  legalComments: "none",
});
const licences = ["three", "uplot"].map((name) => {
  const folder = join(here, "node_modules", name);
  const { version } = JSON.parse(readFileSync(join(folder, "package.json"), "utf8"));
  return `${name} ${version}\n\n${readFileSync(join(folder, "LICENSE"), "utf8").trim()}\n`;
});
writeFileSync(join(assets, "LICENSES.txt"), licences.join(`\n${"-".repeat(72)}\n\n`));
