// Stopping must work whatever else does not: Hold and Resume go straight to REST from here,
// by button or key, also while the scene has the focus.
"use strict";

const SLOW_MS = 1500; // an answer that takes longer is told of
const TYPING_MS = 1500; // who has typed so lately may still believe to be in the box

const falconer = {
  mission: "",
  state: "",
  noticeTimer: 0,
  typedMs: -Infinity,
  keys: {},
  builders: [],
  built: new WeakSet(),
  open: new Set(),
  pressed: null,
  focused: "",

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
    const name = op === "hold" ? "Hold" : "Resume";
    if (!this.mission) {
      this.tell(`${name} did nothing: this page knows of no mission yet.`);
      return;
    }
    const slow = setTimeout(
      () => this.tell(`${name} is on its way: the server has not answered yet.`), SLOW_MS);
    try {
      const path = `/api/v1/missions/${encodeURIComponent(this.mission)}/${op}`;
      const answer = await fetch(path, { method: "POST", headers: this.proof() });
      const body = await answer.json();
      if (answer.ok) this.show(body.id, body.state);
      else this.tell(body.error.message);
    } catch {
      this.tell(`${name} did not reach the server. Vehicles hold by themselves when the planner ` +
        "is gone.");
    } finally {
      clearTimeout(slow);
    }
  },

  // What shows the server that this page, and no other, asks in the session's name.
  proof() {
    const name = location.port ? `falconer_csrf_${location.port}` : "falconer_csrf";
    const found = document.cookie.split("; ").find((cookie) => cookie.startsWith(`${name}=`));
    return found ? { "X-CSRF-Token": found.slice(name.length + 1) } : {};
  },

  toggleTheme() {
    const root = document.documentElement;
    root.dataset.theme = root.dataset.theme === "dark" ? "light" : "dark";
    localStorage.setItem("falconer-theme", root.dataset.theme);
  },

  // A key of a panel. Space, R and / stay the console's own.
  bind(key, act) {
    this.keys[key] = act;
  },

  // The page is built by the server's script, later than this file and its like: call `act` with
  // each element of a kind, once, as soon as it is there.
  whenBuilt(selector, act) {
    this.builders.push([selector, act]);
    this.onBuilt();
  },

  onBuilt() {
    for (const [selector, act] of this.builders) {
      for (const element of document.querySelectorAll(selector)) {
        if (this.built.has(element)) continue;
        this.built.add(element);
        act(element);
      }
    }
    // What is drawn anew has lost what was open in it, and the focus: give them back.
    for (const key of this.open) {
      const details = document.querySelector(`details[data-keep="${CSS.escape(key)}"]`);
      if (details && !details.open) details.open = true;
    }
    if (this.focused && document.activeElement === document.body) {
      const again = document.querySelector(`[data-tap="${CSS.escape(this.focused)}"]`);
      again?.focus({ preventScroll: true });
    }
  },

  // Tabs: which one is open is this browser's own business.
  setUpTabs(card) {
    const key = `falconer-tab-${card.dataset.tabs}`;
    const tabs = [...card.querySelectorAll("[role=tab]")];
    const open = (number, focus) => {
      for (const tab of tabs) {
        const chosen = tab.dataset.tab === String(number);
        tab.setAttribute("aria-selected", chosen);
        tab.tabIndex = chosen ? 0 : -1;
        if (chosen && focus) tab.focus();
      }
      for (const page of card.querySelectorAll("[data-tab-of]")) {
        page.hidden = page.dataset.tabOf !== String(number);
      }
      sessionStorage.setItem(key, number);
    };
    card.openTab = open;
    for (const tab of tabs) tab.addEventListener("click", () => open(tab.dataset.tab));
    card.querySelector("[role=tablist]")?.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      const at = tabs.indexOf(document.activeElement);
      if (!step || at < 0) return;
      open((at + step + tabs.length) % tabs.length, true);
      event.preventDefault();
    });
    const kept = Number(sessionStorage.getItem(key));
    if (kept > 0 && kept < tabs.length) open(kept);
  },

  // Open the tab that an element stands in, and show the element.
  reveal(element) {
    const page = element.closest("[role=tabpanel]");
    page?.closest("[data-tabs]").openTab(page.dataset.tabOf);
    element.dispatchEvent(new CustomEvent("falconer-reveal", { bubbles: true }));
    element.scrollIntoView({ block: "nearest" });
    if (element.matches(".scroll")) return;
    element.classList.add("pointed");
    setTimeout(() => element.classList.remove("pointed"), 2000);
  },

  onKey(event) {
    // A number and a list take no space, and a slider no letter: Space holds there, too.
    const typing = event.target.closest?.(
      "input:not([type=number], [type=range]), textarea, [contenteditable=true]",
    );
    const number = event.target.closest?.("input[type=number], select");
    const key = (event.key ?? "").toLowerCase(); // Caps Lock takes no key away
    const amidTyping = this.typedLately();
    if (typing || (amidTyping && key !== "r")) this.typedMs = performance.now();
    if (event.key === "Escape") this.escape();
    if (number && event.key === "Escape") number.blur();
    if (number && event.code !== "Space") return;
    // Whoever has said something, or thinks better of it, must be able to hold by Space again.
    if (typing && event.key === "Escape") typing.blur();
    if (typing && event.key === "Enter" && !event.shiftKey) setTimeout(() => typing.blur());
    if (typing || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.code === "Space") this.once(event, "hold");
    else if (key === "r" && amidTyping) this.tell("R came amid typing: wait a moment, press it again.");
    else if (key === "r") this.once(event, "resume");
    else if (key === "/") this.comment();
    else if (/^[1-9]$/.test(key)) this.openAside(Number(key) - 1);
    else if (this.keys[key]) this.keys[key]();
    else return;
    event.preventDefault();
    event.stopPropagation();
  },

  // Enter leaves the box. Who has not noticed and types on must not set vehicles moving by it.
  typedLately() {
    return performance.now() - this.typedMs < TYPING_MS;
  },

  // A key that is kept down is one word.
  once(event, op) {
    if (!event.repeat) this.steer(op);
  },

  // Whatever is begun and not yet done offers a way out of it.
  escape() {
    for (const out of document.querySelectorAll("[data-escape]")) {
      if (out.offsetParent !== null) out.click();
    }
  },

  openAside(number) {
    const card = document.querySelector("aside [data-tabs]");
    if (card?.querySelector(`[data-tab="${number}"]`)) card.openTab(number, true);
  },

  comment() {
    this.openAside(0);
    document.querySelector(".comment-box")?.focus();
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
  const link = event.target.closest("[data-reveal]");
  if (!link) return;
  const goal = document.querySelector(`[data-id="${CSS.escape(link.dataset.reveal)}"]`);
  if (goal) falconer.reveal(goal);
  else falconer.tell("That is too long ago to be listed here.");
});
// A control that is drawn anew while it is pressed gets no click from the browser.
addEventListener("pointerdown", (event) => {
  falconer.pressed = event.target.closest?.("[data-tap]") ?? null;
}, true);
addEventListener("pointerup", (event) => {
  const { pressed } = falconer;
  falconer.pressed = null;
  if (!pressed || pressed.isConnected) return;
  event.target.closest?.(`[data-tap="${CSS.escape(pressed.dataset.tap)}"]`)?.click();
}, true);
addEventListener("toggle", (event) => {
  const key = event.target.dataset?.keep;
  if (key && event.target.open) falconer.open.add(key);
  else if (key && event.target.isConnected) falconer.open.delete(key);
}, true);
addEventListener("focusin", (event) => {
  falconer.focused = event.target.dataset?.tap ?? "";
});
new MutationObserver(() => falconer.onBuilt()).observe(document.documentElement, {
  childList: true,
  subtree: true,
});
// Hold works from the page's first moment on, before the server's script has said a word.
falconer.whenBuilt("#console", (page) => {
  if (!falconer.mission) falconer.show(page.dataset.mission, page.dataset.state);
});
falconer.whenBuilt("#scene", (frame) => falconer.listenIn(frame));
falconer.whenBuilt("[data-tabs]", (card) => falconer.setUpTabs(card));
