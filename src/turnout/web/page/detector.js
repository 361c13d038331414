// Verdicts of a detector: where, how large, what else; the throw in its expected band; trends.
import { post, send } from "./api.js";
import { drawBlade } from "./blade.js";
import { message } from "./live.js";
import { layoutOf, PLAIN, styleOf, suffix } from "./sheet.js";
import { on, state } from "./state.js";
import { isOpen } from "./tabs.js";

const byId = (id) => document.getElementById(id);
const LEVELS = { sound: "good", object: "bad" };
const COLOURS = ["--accent", "--bad", "--on", "--missed", "--soft", "--ink"];
const MILLI = 1000;
let detector = null, judged = null;

async function guarded(work) {
  try {
    message("");
    await work();
  } catch (error) {
    message(error.message);
  }
}

async function readDetector() {
  const file = byId("detector-file").files[0];
  if (!file) return;
  detector = await send("/api/detector", file);
  byId("detector-state").textContent = `${file.name}: for ${detector.panel || "a panel"}, ${detector.throws} sound throws of this switch known. ${detector.safety}`;
  for (const id of ["judge-file", "judge-shown"]) byId(id).disabled = false;
}

function show(found) {
  judged = found;
  byId("judged").hidden = false;
  byId("judged-throw").replaceChildren(...found.verdicts.map((item, number) => new Option(`${item.name}: ${item.status}`, number)));
  const first = found.verdicts.findIndex((item) => item.status !== "sound");
  byId("judged-throw").value = String(Math.max(first, 0));
  draw();
}

// Of throws that were refused the page shows no verdict, not that on others either.
async function showing(answer) {
  judged = null;
  byId("judged").hidden = true;
  show(await answer);
}

const millimetres = (value) => (value === null ? "?" : (Math.round(10 * MILLI * value) / 10 || 0).toFixed(1));

function gaps(verdict) {
  const row = (cells, tag) => {
    const made = document.createElement("tr");
    made.append(...cells.map((text) => Object.assign(document.createElement(tag), { textContent: text })));
    return made;
  };
  const rows = verdict.gaps.map((gap) => {
    const above = gap.called ?? gap.above > 0.5, made = row([gap.name, `${millimetres(gap.middle)} mm`, `${millimetres(gap.low)} to ${millimetres(gap.high)}`, `${millimetres(gap.limit)} mm`, above ? "above" : "below"], "td");
    made.className = above ? "over" : "";
    return made;
  });
  byId("judged-gaps").replaceChildren(...(rows.length ? [row(["Virtual sensor", "Gap", "95 % interval [mm]", "Limit", ""], "th"), ...rows] : []));
}

function band(sheet) {
  const looks = {
    low: { line: { width: 0 }, showlegend: false, hoverinfo: "skip" },
    high: { line: { width: 0 }, fill: "tonexty", fillcolor: "rgba(120,130,145,.3)", name: "95 % of sound throws of this switch" },
    expected: { line: { color: styleOf("--soft"), width: 1, dash: "dash" } },
    "this throw": { line: { color: styleOf("--bad"), width: 1.8 } },
  };
  const traces = sheet.rows.flatMap((row, number) => row.lines.map((line) => ({
    type: "scatter", mode: "lines", name: line.label, x: line.x, y: line.y, xaxis: `x${suffix(number)}`, yaxis: `y${suffix(number)}`, ...looks[line.label], ...(number ? { showlegend: false } : {}),
  })));
  Plotly.react(byId("judged-band"), traces, layoutOf(sheet, { together: false }), PLAIN);
}

function trends() {
  const { trends: sheet, staying } = judged;
  byId("trend-box").hidden = !sheet;
  if (!sheet) return;
  byId("judged-staying").textContent = staying.length ? `${staying.join("; ")}.` : "No cause stays over these throws.";
  let order = 0;
  const traces = sheet.rows.flatMap((row, number) => row.lines.map((line) => {
    const colour = styleOf(COLOURS[order++ % COLOURS.length]);
    return { type: "scatter", mode: "lines+markers", name: line.label, x: line.x, y: line.y, xaxis: `x${suffix(number)}`, yaxis: `y${suffix(number)}`, line: { color: colour, width: 1.3, dash: ["solid", "dash", "dot", "dashdot"][number] }, marker: { color: colour, size: 5 } };
  }));
  Plotly.react(byId("judged-trends"), traces, layoutOf(sheet, { together: true }), PLAIN);
}

function draw() {
  if (!judged || !isOpen("detector")) return;
  const verdict = judged.verdicts[Number(byId("judged-throw").value)] ?? judged.verdicts[0];
  const [head, ...rest] = verdict.lines;
  byId("judged-verdict").dataset.level = LEVELS[verdict.status] ?? "look";
  const strong = document.createElement("strong");
  strong.textContent = `${verdict.name}: ${verdict.status}`;
  byId("judged-head").replaceChildren(strong, head.startsWith(strong.textContent) ? head.slice(strong.textContent.length) : ` ${head}`);
  // gaps stand in the table below
  byId("judged-lines").textContent = rest.filter((line) => !line.startsWith("  gap at ")).map((line) => line.trim()).join(" \u00b7 ");
  byId("judged-remark").textContent = judged.remark;
  const known = verdict.status === "object";
  byId("judged-blade").toggleAttribute("hidden", !known);
  if (known) drawBlade(byId("judged-blade"), [...verdict.blade].sort((a, b) => a.x - b.x).map((place) => ({ ...place, text: place.value ? place.value.toFixed(2) : "", look: place.value ? "missed" : "" })));
  gaps(verdict);
  byId("judged-band").hidden = !verdict.band;
  if (verdict.band) band(verdict.band);
  trends();
}

export function startDetector() {
  byId("detector-file").addEventListener("change", () => guarded(readDetector));
  byId("judge-file").addEventListener("change", () => guarded(async () => {
    const file = byId("judge-file").files[0];
    if (file) await showing(send("/api/judge", file, { detector: detector.mark, map: chosenMap() }));
  }));
  byId("judge-shown").addEventListener("click", () => guarded(async () => {
    if (state.request) await showing(post(`/api/judge/${detector.mark}`, { ...state.request, preview: false }));
  }));
  byId("judged-throw").addEventListener("change", draw);
  for (const what of ["view", "theme"]) on(what, draw);
  new ResizeObserver(draw).observe(byId("view-detector"));
}

let chosenMap = () => "";
export const useMaps = (choose) => { chosenMap = choose; };
