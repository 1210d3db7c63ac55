// Stopping must work whatever else does not: Hold and Resume go straight to REST from here,
// by button or key, also while the scene has the focus.
"use strict";

const falconer = {
  mission: "",
  state: "",
  noticeTimer: 0,

  show(mission, state) {
    this.mission = mission;
    this.state = state;
    document.documentElement.dataset.state = state;
    const live = ["running", "held", "paused"].includes(state);
    for (const button of document.querySelectorAll("[data-steer]")) {
      button.disabled = !live || (button.dataset.steer === "resume" && state === "running");
    }
  },

  tell(words) {
    const notice = document.getElementById("notice");
    notice.textContent = words;
    notice.classList.add("shown");
    clearTimeout(this.noticeTimer);
    this.noticeTimer = setTimeout(() => notice.classList.remove("shown"), 8000);
  },

  async steer(op) {
    if (!this.mission) return;
    try {
      const path = `/api/v1/missions/${encodeURIComponent(this.mission)}/${op}`;
      const answer = await fetch(path, { method: "POST" });
      const body = await answer.json();
      if (answer.ok) this.show(body.id, body.state);
      else this.tell(body.error.message);
    } catch {
      this.tell(`${op === "hold" ? "Hold" : "Resume"} did not reach the server. Vehicles hold by ` +
        "themselves when the planner is gone.");
    }
  },

  toggleTheme() {
    const root = document.documentElement;
    root.dataset.theme = root.dataset.theme === "dark" ? "light" : "dark";
    localStorage.setItem("falconer-theme", root.dataset.theme);
  },

  onKey(event) {
    const typing = event.target.closest?.("input, textarea, [contenteditable=true]");
    // Whoever has said something, or thinks better of it, must be able to hold by Space again.
    if (typing && event.key === "Escape") typing.blur();
    if (typing && event.key === "Enter" && !event.shiftKey) setTimeout(() => typing.blur());
    if (typing || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.code === "Space") this.steer("hold");
    else if (event.key === "r") this.steer("resume");
    else if (event.key === "/") document.querySelector(".comment-box")?.focus();
    else return;
    event.preventDefault();
    event.stopPropagation();
  },

  listenIn(frame) {
    const attach = () => {
      try {
        frame.contentWindow.addEventListener("keydown", onKey, true);
      } catch {
        this.tell("Keys do not reach the console while the scene has the focus.");
      }
    };
    frame.addEventListener("load", attach);
    attach();
  },
};
window.falconer = falconer;
// One function: attached twice to a window it still runs once.
const onKey = (event) => falconer.onKey(event);

addEventListener("keydown", onKey, true);
// A button that has the focus would take Space on key-up as a click on itself.
addEventListener("keyup", (event) => {
  if (event.code === "Space" && event.target.closest?.("button")) event.preventDefault();
}, true);
addEventListener("click", (event) => {
  const steer = event.target.closest("[data-steer]");
  if (steer) falconer.steer(steer.dataset.steer);
  if (event.target.closest("[data-theme-toggle]")) falconer.toggleTheme();
});
// The page is built by the server's script: the scene's frame may come later than this file.
new MutationObserver((_, observer) => {
  const frame = document.getElementById("scene");
  if (!frame) return;
  observer.disconnect();
  falconer.listenIn(frame);
}).observe(document.documentElement, { childList: true, subtree: true });
