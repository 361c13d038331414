// A wheel that rolls along the closed rail: the gauge at rest, at the wheel and anywhere under it.
import { runJob } from "./jobs.js";
import { message } from "./live.js";
import { layoutOf, PLAIN, styleOf, suffix } from "./sheet.js";
import { currentRequest, on, state } from "./state.js";
import { isOpen } from "./tabs.js";

const byId = (id) => document.getElementById(id);
let found = null;

function force(id) {
  const box = byId(id), value = Number(box.value);
  if (box.value === "" || !(value >= 0) || !Number.isFinite(value)) throw new Error(`${box.labels[0].textContent}: '${box.value}' is no force of at least 0`);
  return `${value} kN`;
}

async function roll() {
  const button = byId("wheel-roll"), note = byId("wheel-state");
  try {
    message("");
    const body = { run: { ...currentRequest(false), preview: false }, lateral: force("wheel-lateral"), vertical: force("wheel-vertical"), course: byId("wheel-course").value };
    button.disabled = true;
    note.textContent = "rolls ...";
    found = await runJob("/api/wheel", body, { bar: byId("wheel-progress"), said: () => {} });
    note.textContent = `of ${state.panel.name} as set when it was computed`;
    draw();
  } catch (error) {
    note.textContent = "";
    message(error.message);
  } finally {
    button.disabled = false;
  }
}

function draw() {
  if (!found || !isOpen("wheel")) return;
  byId("wheel-findings").replaceChildren(...found.findings.map((item) => {
    const row = document.createElement("tr");
    row.className = item.level === "bad" ? "over" : "";
    row.append(...[item.question, item.answer, item.detail].map((text) => Object.assign(document.createElement("td"), { textContent: text })));
    return row;
  }));
  byId("wheel-chart").hidden = false;
  const traces = found.sheet.rows.flatMap((row, number) => row.lines.map((line) => ({
    type: "scatter", mode: "lines", name: line.label, x: line.x, y: line.y, xaxis: `x${suffix(number)}`, yaxis: `y${suffix(number)}`,
    line: { color: styleOf(line.label === "at rest" ? "--ink" : "--accent"), width: 1.6 }, ...(number ? { showlegend: false } : {}),
  })));
  Plotly.react(byId("wheel-chart"), traces, layoutOf(found.sheet, { together: false }), PLAIN);
}

export function startWheel() {
  byId("wheel-roll").addEventListener("click", roll);
  for (const what of ["view", "theme"]) on(what, draw);
  on("pins", () => {
    if (state.answer) return;
    found = null;
    byId("wheel-findings").replaceChildren();
    byId("wheel-chart").hidden = true;
    byId("wheel-state").textContent = "";
  });
}
