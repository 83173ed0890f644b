// Builds the page into a folder, by default dist/: node build.mjs [FOLDER]
import { build } from "esbuild";
import { copyFile, mkdir, rm } from "node:fs/promises";

const folder = process.argv[2] ?? "dist";
await rm(folder, { recursive: true, force: true });
await mkdir(folder, { recursive: true });
await build({
  entryPoints: { page: "src/main.tsx", scope: "src/scope/worker.ts", style: "src/style.css" },
  outdir: folder,
  bundle: true,
  minify: true,
  format: "esm",
  target: "es2022",
  jsx: "automatic",
  jsxImportSource: "preact",
  legalComments: "linked",
  logLevel: "warning",
});
await copyFile("src/index.html", `${folder}/index.html`);
