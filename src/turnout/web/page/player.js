// The instant that is shown, and playing through the throw at its own speed.
import { on, state, notify } from "./state.js";

let playing = false, began = 0, from = 0, instant = 0;

const slider = () => document.getElementById("time");

export function showFrame(number) {
  const { time } = state.answer.motion;
  state.frame = Math.max(0, Math.min(time.length - 1, number));
  instant = time[state.frame];
  slider().value = state.frame;
  const text = `${time[state.frame].toFixed(2)} s`;
  document.getElementById("time-text").textContent = text;
  slider().setAttribute("aria-valuetext", text);
  notify("frame");
}

function step(now) {
  if (!playing) return;
  const { time } = state.answer.motion;
  const wanted = from + (now - began) / 1000;
  let frame = time.findIndex((instant) => instant >= wanted);
  if (frame < 0) frame = time.length - 1;
  if (frame !== state.frame) showFrame(frame);
  if (frame === time.length - 1) play(false);
  else requestAnimationFrame(step);
}

export function play(wanted) {
  playing = wanted;
  const button = document.getElementById("play");
  button.textContent = playing ? "Pause" : "Play";
  button.setAttribute("aria-pressed", String(playing));
  if (!playing) return;
  const { time } = state.answer.motion;
  if (state.frame >= time.length - 1) showFrame(0);
  from = time[state.frame];
  began = performance.now();
  requestAnimationFrame(step);
}

export function startPlayer() {
  slider().addEventListener("input", () => { play(false); if (state.answer) showFrame(Number(slider().value)); });
  document.getElementById("play").addEventListener("click", () => state.answer && play(!playing));
  document.addEventListener("keydown", (event) => {
    // Space has its own meaning on buttons, boxes to tick, lists and fields.
    const own = event.target.closest?.('button, select, textarea, summary, a, input:not([type="range"])');
    if (event.key !== " " || own || event.ctrlKey || event.metaKey || event.altKey || !state.answer) return;
    event.preventDefault();
    if (!event.repeat) play(!playing);
  });
  on("answer", () => {
    const { time } = state.answer.motion;
    const atEnd = state.frame >= Number(slider().max);
    slider().max = time.length - 1;
    // A preview has fewer instants: the one nearest to what was shown is shown again.
    const gap = (number) => Math.abs(time[number] - instant);
    const nearest = time.reduce((best, _, number) => gap(number) < gap(best) ? number : best, 0);
    showFrame(atEnd ? time.length - 1 : nearest);
  });
}
