// Asking the server; nothing else is ever asked.

export class Refused extends Error {}

async function checked(answer) {
  if (answer.ok) return answer;
  const text = await answer.text();
  let message = text;
  try { message = JSON.parse(text).message; } catch { /* plain text */ }
  throw new Refused(message);
}

async function asked(address, options = {}) {
  let answer;
  try {
    answer = await fetch(address, { credentials: "same-origin", ...options });
  } catch {
    throw new Refused("the studio does not answer; is `turnout studio` still running?");
  }
  return checked(answer);
}

const posted = (body) => ({
  method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body),
});

export const get = async (address) => (await asked(address)).json();
export const post = async (address, body) => (await asked(address, posted(body))).json();
export const postForFile = async (address, body) => (await asked(address, posted(body))).blob();

export async function send(address, file, more = {}) {
  const query = new URLSearchParams({ name: file.name, ...more });
  return (await asked(`${address}?${query}`, { method: "POST", body: file })).json();
}
