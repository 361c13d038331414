// Assembles the page.
import { begin, showPanel, startFiles } from "./files.js";
import { startCompare } from "./compare.js";
import { startControls } from "./controls.js";
import { startCurves } from "./curves.js";
import { startLamps } from "./lamps.js";
import { message } from "./live.js";
import { drawPlan, startPlan } from "./plan.js";
import { startPlayer } from "./player.js";
import { isOpen, startTabs } from "./tabs.js";
import { on, state, notify } from "./state.js";

function keep(key, attribute, select) {
  const root = document.documentElement;
  select.value = root.dataset[attribute];
  select.addEventListener("change", () => {
    root.dataset[attribute] = select.value;
    try { localStorage.setItem(key, select.value); } catch { /* private window */ }
    drawPlan();
    notify("theme");
  });
}

function words() {
  const list = document.getElementById("words");
  list.replaceChildren(...state.answer.summary.flatMap(([heading, text]) => {
    const term = document.createElement("dt"), definition = document.createElement("dd");
    term.textContent = heading;
    definition.textContent = text;
    return [term, definition];
  }));
}

// The 3-D view is large and needs WebGL: load it when its tab opens.
let scene = null;
async function showScene() {
  if (!isOpen("scene") || !state.answer) return;
  try {
    scene ??= import("./scene.js");
    (await scene).drawScene();
  } catch (error) {
    document.getElementById("scene-note").textContent = `3-D view unavailable: ${error.message}`;
  }
}

async function run() {
  startTabs();
  startControls();
  startPlan();
  startLamps();
  startCurves();
  startCompare();
  on("answer", words);
  for (const what of ["answer", "frame", "theme", "view", "scale"]) on(what, showScene);
  startPlayer();
  keep("theme", "theme", document.getElementById("theme"));
  keep("text", "text", document.getElementById("text-size"));
  document.getElementById("exaggeration").addEventListener("input", () => { drawPlan(); notify("scale"); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { drawPlan(); notify("theme"); });
  await begin();
  startFiles();
  await showPanel(state.start.panel);
}

run().catch((error) => message(error.message));
