// Asks for the throw while sliders move: coarse at once, fine when they rest. The last one wins.
import { post } from "./api.js";
import { askedNow, state, tell } from "./state.js";

const EVERY = 50; // no more than 20 questions a second
const REST = 220; // so long without a change is rest
let number = 0, shown = 0, last = 0, waiting = null, resting = null;

const note = (text) => { document.getElementById("state").textContent = text; };

async function ask(preview) {
  last = performance.now();
  const mine = ++number;
  const asked = askedNow(preview);
  const slow = setTimeout(() => note(state.start.compiling && !state.answer
    ? "first throw: compiling, 1 to 2 minutes ..." : "computing ..."), 400);
  try {
    const answer = await post("/api/run", asked);
    if (answer.superseded || mine < shown) return;
    shown = mine;
    Object.assign(state, { answer, asked });
    document.body.classList.remove("stale");
    message("");
    const how = preview ? "quick, as turnout simulate --mode quick" : `as turnout simulate, ${answer.seconds.toFixed(2)} s`;
    // Of an older question it would say that the sliders' own throw is shown.
    note(mine === number ? how : "computing ...");
    tell("answer");
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

// Something changed: a preview soon, the whole throw once nothing changes any more.
export function changed() {
  clearTimeout(resting);
  resting = setTimeout(settled, REST);
  if (waiting !== null) return;
  waiting = setTimeout(() => { waiting = null; ask(true); }, Math.max(0, last + EVERY - performance.now()));
}

export function settled() {
  clearTimeout(resting);
  clearTimeout(waiting);
  waiting = null;
  return ask(false);
}
