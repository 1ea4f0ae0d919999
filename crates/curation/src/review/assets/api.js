// Requests to the server. Addresses are relative: the page's own address contains the token.

async function answer(response) {
  if (!response.ok) {
    throw new Error((await response.text()).trim() || `the server answered ${response.status}`);
  }
  return response.json();
}

const get = async (path) => answer(await fetch(path));

const post = async (path, body) =>
  answer(await fetch(path, {
    method: "POST",
    headers: { "content-type": "application/json" },
    body: JSON.stringify(body ?? {}),
  }));

export const session = () => get("api/session");
export const scenario = (index) => get(`api/scenario/${index}`);
export const setReviewer = (name) => post("api/reviewer", { name });
export const decide = (request) => post("api/decide", request);
export const undo = () => post("api/undo");
