// Messages and prompts.

const $ = (id) => document.getElementById(id);

let timer;

/** Shows a short message for a moment. */
export function toast(text) {
  $("toast").textContent = text;
  $("toast").classList.add("on");
  clearTimeout(timer);
  timer = setTimeout(() => $("toast").classList.remove("on"), 1800);
}

/** Shows an error until the next success. */
export function alarm(text) {
  $("alarm").textContent = text;
  $("alarm").hidden = false;
}

/** Hides the error. */
export function calm() {
  $("alarm").hidden = true;
}

/** Asks for a line of text; null if the user cancels. */
export function ask(label, value = "") {
  const dialog = $("ask");
  $("ask-label").textContent = label;
  $("ask-text").value = value;
  dialog.showModal();
  $("ask-text").select();
  return new Promise((resolve) => {
    const end = (text) => {
      dialog.onclose = null;
      dialog.close();
      resolve(text);
    };
    dialog.onclose = () => resolve(null);
    $("ask-cancel").onclick = () => end(null);
    dialog.querySelector("form").onsubmit = (event) => {
      event.preventDefault();
      end($("ask-text").value.trim());
    };
  });
}
