// Requests throws while sliders move: a preview at once, the final result when they stop. The newest wins.
import { post } from "./api.js";
import { currentRequest, state, notify } from "./state.js";

const EVERY = 50; // at most 20 requests a second
const REST = 220; // pause that ends a movement [ms]
let number = 0, shown = 0, last = 0, waiting = null, resting = null;

const note = (text) => { document.getElementById("state").textContent = text; };

async function requestThrow(preview) {
  last = performance.now();
  const mine = ++number;
  const request = currentRequest(preview);
  const slow = setTimeout(() => note(state.start.compiling && !state.answer
    ? "first throw: compiling, 1 to 2 minutes ..." : "computing ..."), 400);
  try {
    const answer = await post("/api/run", request);
    if (answer.superseded || mine < shown) return;
    shown = mine;
    Object.assign(state, { answer, request });
    document.body.classList.remove("stale");
    message("");
    const how = preview ? "preview" : `final result (${answer.seconds.toFixed(2)} s)`;
    // An older request must not be labelled as the throw of the sliders.
    note(mine === number ? how : "computing ...");
    notify("answer");
  } catch (error) {
    if (mine < shown) return;
    shown = mine;
    document.body.classList.add("stale");
    note("");
    message(error.message);
  } finally {
    clearTimeout(slow);
  }
}

export function message(text) {
  const box = document.getElementById("message");
  box.textContent = text;
  box.hidden = !text;
}

// On a change: a preview soon, the final result after a pause.
export function changed() {
  clearTimeout(resting);
  resting = setTimeout(settled, REST);
  if (waiting !== null) return;
  waiting = setTimeout(() => { waiting = null; requestThrow(true); }, Math.max(0, last + EVERY - performance.now()));
}

export function settled() {
  clearTimeout(resting);
  clearTimeout(waiting);
  waiting = null;
  return requestThrow(false);
}
