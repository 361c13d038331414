// Requests to the local server, the only host the page contacts.

export class Refused extends Error {}

async function checked(answer) {
  if (answer.ok) return answer;
  const text = await answer.text();
  let message = text;
  try { message = JSON.parse(text).message; } catch { /* plain text */ }
  throw new Refused(message);
}

async function request(address, options = {}) {
  let answer;
  try {
    answer = await fetch(address, { credentials: "same-origin", ...options });
  } catch {
    throw new Refused("no reply from the studio; is `turnout studio` still running?");
  }
  return checked(answer);
}

const posted = (body) => ({
  method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body),
});

export const get = async (address) => (await request(address)).json();
export const post = async (address, body) => (await request(address, posted(body))).json();
export const postForFile = async (address, body) => (await request(address, posted(body))).blob();

export async function send(address, file, more = {}) {
  const query = new URLSearchParams({ name: file.name, ...more });
  return (await request(`${address}?${query}`, { method: "POST", body: file })).json();
}
