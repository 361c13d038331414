// Puts the parts of the page together.
import { begin, showPanel, startFiles } from "./files.js";
import { startCompare } from "./compare.js";
import { startControls } from "./controls.js";
import { startCurves } from "./curves.js";
import { startLamps } from "./lamps.js";
import { message } from "./live.js";
import { drawPlan, startPlan } from "./plan.js";
import { startPlayer } from "./player.js";
import { isOpen, startTabs } from "./tabs.js";
import { on, state, tell } from "./state.js";

function keep(key, attribute, select) {
  const root = document.documentElement;
  select.value = root.dataset[attribute];
  select.addEventListener("change", () => {
    root.dataset[attribute] = select.value;
    try { localStorage.setItem(key, select.value); } catch { /* private window */ }
    drawPlan();
    tell("theme");
  });
}

function words() {
  const list = document.getElementById("words");
  list.replaceChildren(...state.answer.summary.flatMap(([heading, text]) => {
    const term = document.createElement("dt"), said = document.createElement("dd");
    term.textContent = heading;
    said.textContent = text;
    return [term, said];
  }));
}

// The 3-D view is large and needs WebGL: it is loaded when it is looked at.
let scene = null;
async function showScene() {
  if (!isOpen("scene") || !state.answer) return;
  try {
    scene ??= import("./scene.js");
    (await scene).drawScene();
  } catch (error) {
    document.getElementById("scene-note").textContent = `no 3-D view here: ${error.message}`;
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
  document.getElementById("exaggeration").addEventListener("input", () => { drawPlan(); tell("scale"); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { drawPlan(); tell("theme"); });
  await begin();
  startFiles();
  await showPanel(state.start.panel);
}

run().catch((error) => message(error.message));
