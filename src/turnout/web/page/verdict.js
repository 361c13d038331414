// The verdict, then each check. Lamps show state and number of the shown instant, the table the checks of the throw.
import { on, state } from "./state.js";

function made({ kind, name, title }) {
  const box = document.createElement("div");
  box.className = "lamp";
  box.dataset.kind = kind;
  box.dataset.name = name;
  box.title = title;
  const [light, text, value] = ["i", "span", "small"].map((tag) => document.createElement(tag));
  light.setAttribute("aria-hidden", "true");
  text.append(`${name[0].toUpperCase()}${name.slice(1)}: `, document.createElement("b"));
  value.append(document.createElement("span"), document.createElement("b"));
  box.append(light, text, value);
  return box;
}

// State, word and number of a lamp always change together.
function show(box, { word, state: light, numbers, margin }) {
  box.dataset.state = light;
  box.querySelector("span b").textContent = word;
  const value = box.querySelector("small");
  value.className = light === "bad" ? "over" : "";
  value.querySelector("span").textContent = numbers;
  value.querySelector("b").textContent = margin;
}

function boxes() {
  const { lamps, checks } = state.answer;
  const shown = lamps.map(made);
  for (const check of checks.filter((item) => ["flangeway", "gauge"].includes(item.kind))) {
    const box = made({ kind: "limit", name: check.label, title: check.meaning });
    show(box, { word: check.state === "bad" ? "too narrow" : "wide enough", state: check.state, numbers: check.text, margin: check.margin });
    shown.push(box);
  }
  document.getElementById("lamps").replaceChildren(...shown);
}

function table() {
  const row = (cells, tag) => {
    const made = document.createElement("tr");
    made.append(...cells.map((text) => Object.assign(document.createElement(tag), { textContent: text })));
    return made;
  };
  const rows = state.answer.checks.map((item) => {
    const made = row([item.label, item.text, item.margin, item.meaning], "td");
    made.className = item.state === "bad" ? "over" : "";
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
      // A moving or open switch need not be locked or in control; that is no fault.
      const [word, light, numbers, margin] = [lamp.words, lamp.states, lamp.numbers, lamp.margins].map((values) => values[state.frame]);
      show(box, { word, state: light, numbers, margin });
    }
  });
}
