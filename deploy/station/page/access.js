// SPDX-License-Identifier: MIT
// The session, and the form that begins one.

import { byId, text, visible } from "./dom.js";

/** The session by the station: {login, who, role}; null where it does not answer. */
export async function session() {
  try {
    const response = await fetch("/session", { cache: "no-store" });
    return response.ok ? await response.json() : null;
  } catch {
    return null;
  }
}

async function post(path, body) {
  return fetch(path, {
    method: "POST",
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify(body),
  });
}

async function refusal(response) {
  try {
    const { error } = await response.json();
    return String(error);
  } catch {
    return `The station answered ${response.status}`;
  }
}

/** Sign in; why it failed, or an empty text. */
async function signIn(name, token) {
  try {
    const response = await post("/login", { name, token });
    return response.ok ? "" : await refusal(response);
  } catch {
    return "No connection to the base station";
  }
}

/** End the session; a station that does not answer is no error: the session expires. */
export async function signOut() {
  try {
    await post("/logout", {});
  } catch {
    // The form is shown all the same.
  }
}

/** Show the form, and call `done` after a sign-in. */
export class LoginForm {
  constructor(done) {
    this._done = done;
    byId("login-form").addEventListener("submit", (event) => {
      event.preventDefault();
      void this._submit();
    });
  }

  show() {
    if (!byId("login").hidden) return;
    visible(byId("login"), true);
    byId("login-name").focus();
  }

  hide() {
    visible(byId("login"), false);
  }

  async _submit() {
    const name = byId("login-name").value.trim();
    const error = await signIn(name, byId("login-token").value);
    text(byId("login-error"), error);
    if (error) return;
    byId("login-token").value = "";
    this._done();
  }
}
