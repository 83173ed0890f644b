// The form with which a user of the daemon logs in.
import { useRef, useState } from "preact/hooks";

import type { State } from "./state";

export function LogIn({ state }: { state: State }) {
  const [why, setWhy] = useState("");
  const [waits, setWaits] = useState(false);
  const password = useRef<HTMLInputElement>(null);
  const submit = async (event: SubmitEvent) => {
    event.preventDefault();
    const given = new FormData(event.currentTarget as HTMLFormElement);
    setWaits(true);
    const refused = await state.connection.logIn(String(given.get("user")), String(given.get("password")));
    setWaits(false);
    setWhy(refused);
    if (refused !== "" && password.current !== null) {
      password.current.value = "";
      password.current.focus();
    }
  };
  return (
    <main class="refused">
      <h1>Log in to see the bus</h1>
      <form class="login" onSubmit={(event) => void submit(event)}>
        <label>User<input name="user" autocomplete="username" autocapitalize="none" spellcheck={false} required autofocus aria-invalid={why !== ""} aria-describedby="why-not" /></label>
        <label>Password<input name="password" type="password" autocomplete="current-password" required ref={password} aria-invalid={why !== ""} aria-describedby="why-not" /></label>
        <button type="submit" class="do" disabled={waits}>{waits ? "Logging in …" : "Log in"}</button>
        <p id="why-not" class="text-bad" role="alert">{why}</p>
      </form>
      <p class="muted">You may then do here what <code>[[gateway.user]]</code> of the daemon allows you. On the machine of the bus, <code>sudo ecatctl remote login NAME</code> makes a login.</p>
    </main>
  );
}
