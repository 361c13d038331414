// The verdict, then each state and value with its limit. States are of the shown instant, values of the throw.
import { on, state } from "./state.js";

// The limit that belongs to a lamp: of several the one with the least left.
function limitOf(lamp) {
  const key = { control: `sensor_gap:${lamp.name}`, slip: `drive_force:${lamp.name.replace(/^drive /, "")}`, lock: "drive_gap:" }[lamp.kind];
  const fits = state.answer.limits.filter((item) => lamp.kind === "lock" ? item.key.startsWith(key) : item.key === key);
  return fits.sort((a, b) => a.share - b.share)[0];
}

function made({ kind, name, title, limit, long }) {
  const box = document.createElement("div");
  box.className = "lamp";
  box.dataset.kind = kind;
  box.dataset.name = name;
  box.title = title;
  const [light, text, value] = ["i", "span", "small"].map((tag) => document.createElement(tag));
  light.setAttribute("aria-hidden", "true");
  text.append(`${name[0].toUpperCase()}${name.slice(1)}: `, document.createElement("b"));
  if (limit) {
    const margin = document.createElement("b");
    margin.textContent = limit.margin;
    value.append(`${long ? `${limit.label} ` : ""}${limit.text}`, margin);
    value.className = limit.passed ? "" : "over";
  }
  box.append(light, text, value);
  return box;
}

function boxes() {
  const { lamps, limits } = state.answer;
  const shown = lamps.map((lamp) => {
    const limit = limitOf(lamp);
    return made({ ...lamp, limit, long: lamp.kind === "lock", title: `${lamp.words[0]} when ${lamp.rule}.${limit ? ` ${limit.meaning}` : ""}` });
  });
  const own = limits.filter((item) => !/^(sensor_gap|drive_force|drive_gap):/.test(item.key));
  shown.push(...own.map((limit) => {
    const box = made({ kind: "limit", name: limit.label, limit, title: limit.meaning });
    box.dataset.state = limit.passed ? passed() : "bad";
    box.querySelector("b").textContent = limit.passed ? "wide enough" : "too narrow";
    return box;
  }));
  document.getElementById("lamps").replaceChildren(...shown);
}

// Green never means missed: what accepts a trapped object is not good.
const passed = () => state.answer.verdict.missed ? "missed" : "good";

function table() {
  const row = (cells, tag) => {
    const made = document.createElement("tr");
    made.append(...cells.map((text) => Object.assign(document.createElement(tag), { textContent: text })));
    return made;
  };
  const rows = state.answer.limits.map((item) => {
    const made = row([item.label, item.text, item.margin, item.meaning], "td");
    made.className = item.passed ? "" : "over";
    return made;
  });
  document.getElementById("limits").replaceChildren(row(["Value", "Of its limit", "Margin", "Meaning"], "th"), ...rows);
}

export function startVerdict() {
  const [meaning, text] = ["verdict-meaning", "verdict-text"].map((id) => document.getElementById(id)), box = document.getElementById("verdict");
  on("answer", () => {
    const { verdict } = state.answer;
    const [head, ...rest] = verdict.text.split(": ");
    const strong = document.createElement("strong");
    strong.textContent = rest.length ? `${head}: ` : head;
    // First what it means in words without terms, then the same in numbers.
    const detail = rest.join(": ");
    meaning.replaceChildren(strong, verdict.meaning || detail);
    text.textContent = verdict.meaning ? detail.replace(/^./, (first) => first.toUpperCase()) : "";
    box.dataset.level = verdict.level;
    box.dataset.kind = verdict.kind;
    boxes();
    table();
    if (!state.request.preview) document.getElementById("announce").textContent = `${verdict.text} ${verdict.meaning}`;
  });
  on("frame", () => {
    const { lamps } = state.answer;
    for (const [number, box] of [...document.getElementById("lamps").children].entries()) {
      const lamp = lamps[number];
      if (!lamp) break;
      const lit = lamp.on[state.frame];
      // A moving or open switch need not be locked or in control; that is no fault.
      const word = lit === lamp.wanted ? passed() : "bad";
      box.dataset.state = lamp.judged[state.frame] ? word : "rest";
      box.querySelector("b").textContent = lamp.words[lit ? 0 : 1];
    }
  });
}
