// Lock, control and slip at the shown instant; good, bad and rest differ in shape too.
import { on, state } from "./state.js";

function made(lamp) {
  const box = document.createElement("div");
  box.className = "lamp";
  box.dataset.kind = lamp.kind;
  box.dataset.name = lamp.name;
  const name = lamp.name[0].toUpperCase() + lamp.name.slice(1);
  const [light, text, rule] = ["i", "span", "small"].map((tag) => document.createElement(tag));
  light.setAttribute("aria-hidden", "true");
  const word = document.createElement("b");
  text.append(`${name}: `, word);
  rule.textContent = `${lamp.words[0]} when ${lamp.rule}`;
  box.append(light, text, rule);
  return box;
}

export function startLamps() {
  const group = document.getElementById("lamps");
  on("answer", () => group.replaceChildren(...state.answer.lamps.map(made)));
  on("frame", () => {
    const lamps = state.answer.lamps;
    for (const [number, box] of [...group.children].entries()) {
      const lamp = lamps[number];
      const lit = lamp.on[state.frame];
      // A moving or open switch need not be locked or in control; that is no fault.
      const word = lit === lamp.wanted ? "good" : "bad";
      box.dataset.state = lamp.judged[state.frame] ? word : "rest";
      box.querySelector("b").textContent = lamp.words[lit ? 0 : 1];
    }
  });
}
