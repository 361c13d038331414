// Assembles the page.
import { panelOfAddress, startAddress, warnings } from "./address.js";
import { startChannels } from "./channels.js";
import { begin, chosenMap, showPanel, startFiles } from "./files.js";
import { startCompare } from "./compare.js";
import { startControls } from "./controls.js";
import { startCurves } from "./curves.js";
import { message, startLive } from "./live.js";
import { startDetector, useMaps } from "./detector.js";
import { startLimit } from "./limit.js";
import { startMap } from "./map.js";
import { drawPlan, startPlan } from "./plan.js";
import { startPlayer } from "./player.js";
import { startSplitters } from "./split.js";
import { isOpen, startTabs } from "./tabs.js";
import { startVerdict } from "./verdict.js";
import { startWheel } from "./wheel.js";
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
  const lines = [...state.answer.summary, ["command", state.answer.command]];
  list.replaceChildren(...lines.flatMap(([heading, text]) => {
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
  startLive();
  startSplitters();
  startTabs();
  startControls();
  startPlan();
  startVerdict();
  startChannels();
  startCurves();
  startCompare();
  startMap();
  startWheel();
  startLimit();
  startDetector();
  useMaps(chosenMap);
  on("answer", words);
  for (const what of ["answer", "frame", "theme", "view", "scale"]) on(what, showScene);
  startPlayer();
  startAddress();
  keep("theme", "theme", document.getElementById("theme"));
  keep("text", "text", document.getElementById("text-size"));
  document.getElementById("exaggeration").addEventListener("input", (event) => { event.target.dataset.chosen = "yes"; drawPlan(); notify("scale"); });
  addEventListener("beforeprint", () => notify("theme"));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { drawPlan(); notify("theme"); });
  await begin();
  startFiles();
  await showPanel(await panelOfAddress(), { addressed: true });
  if (warnings.length) message(warnings.join("\n"));
}

run().catch((error) => message(error.message));
