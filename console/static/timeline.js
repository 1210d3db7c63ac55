// The timeline: scales, cursor and what the pointer and the keys ask for. The server makes the
// lines and sends only what is new; which stretch of time is shown is this browser's own choice.
"use strict";
{
  const LEAST_SPAN_S = 30;
  const SEND_MS = 150;
  const NEAR_END_S = 0.6;
  const STEPS_S = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 36000];

  const words = (seconds) => {
    const whole = Math.max(0, Math.round(seconds));
    return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
  };

  falconer.timeline = {
    until: 0, // mission time of the newest point
    at: null, // the instant that is looked at; null for the present
    kept: null, // from when on pictures are kept; null for nowhere
    dragged: null,
    sentMs: 0,

    get root() { return document.getElementById("timeline"); },
    get plane() { return this.root?.querySelector(".plane"); },

    // What stretch of mission time is shown: [from, length].
    get stretch() {
      const chosen = Number(localStorage.getItem("falconer-window")) || Infinity;
      const all = Math.max(LEAST_SPAN_S, this.until);
      const length = Math.min(chosen, all);
      const at = this.dragged ?? this.at;
      let from = Math.max(0, all - length);
      if (at !== null && at < from) from = Math.max(0, at - 0.1 * length);
      return [from, length];
    },

    show(state) {
      Object.assign(this, state);
      document.documentElement.toggleAttribute("data-away", state.away);
      this.lay();
    },

    add(news) {
      for (const [name, points] of Object.entries(news.lines)) {
        const line = this.root.querySelector(`[data-line="${name}"]`);
        if (line && points) line.setAttribute("points", `${line.getAttribute("points")} ${points}`);
      }
      for (const [name, [low, high]] of Object.entries(news.scales)) {
        const lane = this.root.querySelector(`[data-lane="${name}"]`);
        if (!lane) continue;
        Object.assign(lane.dataset, { low, high });
        lane.querySelector("b").innerHTML = news.words[name];
      }
      if (news.marks)
        this.root.querySelector(".marks g").insertAdjacentHTML("beforeend", news.marks);
      this.lay();
    },

    lay() {
      const root = this.root;
      if (!root || !this.plane) return;
      const [from, length] = this.stretch;
      for (const lane of root.querySelectorAll("[data-lane]")) {
        const [low, high] = [Number(lane.dataset.low), Number(lane.dataset.high)];
        const svg = lane.querySelector("svg");
        svg.setAttribute("viewBox", `${from} ${-high} ${length} ${Math.max(1e-9, high - low)}`);
      }
      root.querySelector(".marks svg")?.setAttribute("viewBox", `${from} 0 ${length} 3`);
      const share = (seconds) => `${(100 * (seconds - from)) / length}%`;
      const at = this.dragged ?? this.at;
      const cursor = root.querySelector(".cursor");
      cursor.style.left = share(Math.min(at ?? this.until, from + length));
      cursor.classList.toggle("gone", at !== null);
      cursor.dataset.words = at === null ? "" : words(at);
      const unkept = this.kept === null ? this.until : this.kept;
      root.querySelector(".unkept").style.width =
        `${Math.min(100, Math.max(0, (100 * (unkept - from)) / length))}%`;
      this.plane.setAttribute("aria-valuemax", String(Math.round(this.until)));
      this.plane.setAttribute("aria-valuenow", String(Math.round(at ?? this.until)));
      this.plane.setAttribute("aria-valuetext", at === null ? "now" : words(at));
      this.layTicks(from, length, share);
      const chosen = localStorage.getItem("falconer-window") || "all";
      for (const button of root.querySelectorAll("[data-window]"))
        button.setAttribute("aria-pressed", String(button.dataset.window === chosen));
    },

    layTicks(from, length, share) {
      const step = STEPS_S.find((s) => length / s <= 10) ?? 86400;
      const ticks = [];
      const axis = this.root.querySelector(".axis");
      // Where the buttons stand there is no room for words.
      const room = axis.clientWidth - this.root.querySelector(".choose").offsetWidth - 18;
      for (let t = Math.ceil(from / step) * step; t <= from + length; t += step) {
        if (((t - from) / length) * axis.clientWidth > room) break;
        const tick = document.createElement("span");
        tick.textContent = words(t);
        tick.style.left = share(t);
        if (t < from + 0.02 * length) tick.className = "first";
        ticks.push(tick);
      }
      axis.replaceChildren(...ticks);
    },

    // Ask for an instant; at the end that is the present.
    seek(seconds) {
      const at = Math.min(this.until, Math.max(0, seconds));
      if (at >= this.until - NEAR_END_S && !this.replay) this.live();
      else emitEvent("falconer-seek", at);
    },

    live() { emitEvent("falconer-live"); },

    step(seconds) { this.seek((this.at ?? this.until) + seconds); },

    timeAt(event) {
      const box = this.plane.getBoundingClientRect();
      const [from, length] = this.stretch;
      const share = Math.min(1, Math.max(0, (event.clientX - box.left) / box.width));
      return Math.min(this.until, from + share * length);
    },

    onPointer(event) {
      if (!event.target.closest?.("#timeline .plane")) return;
      if (event.type === "pointerdown" && event.button === 0) {
        this.plane.setPointerCapture(event.pointerId);
        this.dragged = this.timeAt(event);
      } else if (this.dragged === null) return;
      if (event.type === "pointercancel") this.dragged = null;
      if (event.type === "pointermove") {
        this.dragged = this.timeAt(event);
        if (event.timeStamp - this.sentMs > SEND_MS) {
          this.sentMs = event.timeStamp;
          this.seek(this.dragged);
        }
      }
      if (event.type === "pointerup") {
        const at = this.timeAt(event);
        this.at = at; // until the server says so: the cursor must not jump back meanwhile
        this.dragged = null;
        this.seek(at);
      }
      this.lay();
    },

    onKey(event) {
      if (!event.target.closest?.("#timeline .plane")) return;
      const steps = { ArrowLeft: -1, ArrowRight: 1, PageUp: -10, PageDown: 10 };
      if (event.key in steps) this.step(steps[event.key]);
      else if (event.key === "Home") this.seek(this.kept ?? 0);
      else if (event.key === "End") this.seek(this.until);
      else return;
      event.preventDefault();
    },
  };

  const timeline = falconer.timeline;
  for (const type of ["pointerdown", "pointermove", "pointerup", "pointercancel"])
    addEventListener(type, (event) => timeline.onPointer(event));
  addEventListener("keydown", (event) => timeline.onKey(event));
  addEventListener("click", (event) => {
    const button = event.target.closest?.("#timeline [data-window]");
    if (!button) return;
    localStorage.setItem("falconer-window", button.dataset.window);
    timeline.lay();
  });
  falconer.bind("l", () => timeline.live());
  falconer.bind(",", () => timeline.step(-10));
  falconer.bind(".", () => timeline.step(10));
}
