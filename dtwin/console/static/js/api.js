// Requests to the server; commands carry the session's token.
import { store } from "./store.js";

export async function findSession() {
  let response = await fetch("/api/session", { signal: AbortSignal.timeout(3000) });
  if (response.status === 401) {
    const page = await fetch("/", { signal: AbortSignal.timeout(3000) });
    if (page.redirected) {
      location.assign("/login");
      throw new Error("log in first");
    }
    response = await fetch("/api/session", { signal: AbortSignal.timeout(3000) });
  }
  if (!response.ok) throw new Error("no session");
  store.session = await response.json();
}

export async function get(path) {
  const response = await fetch(path);
  const content = await response.json();
  if (!response.ok) throw new Error(content.text ?? "the server refused");
  return content;
}

/** The answer of the server, or a refusal in words. */
export async function post(path, content = {}) {
  try {
    const response = await fetch(path, {
      method: "POST",
      headers: { "content-type": "application/json", "x-csrf-token": store.session?.token ?? "" },
      body: JSON.stringify(content),
    });
    const answer = await response.json();
    return { done: response.ok, text: "", ...answer };
  } catch {
    return { done: false, text: "the server does not answer" };
  }
}
