// Decision cards: which are shown, and the prompts and answers behind them, fetched when opened.
"use strict";
{
  const show = (list, which) => {
    list.dataset.show = which;
    for (const button of list.parentElement.querySelectorAll("[data-filter]")) {
      button.setAttribute("aria-pressed", button.dataset.filter === which);
    }
  };

  addEventListener("click", (event) => {
    const button = event.target.closest("[data-filter]");
    if (button) show(button.closest("[role=tabpanel]").querySelector(".decisions"), button.dataset.filter);
  });

  // A card that is hidden by the choice above is shown when somebody is led to it.
  addEventListener("falconer-reveal", (event) => {
    const list = event.target.closest?.(".decisions");
    if (list && event.target.closest(".quiet")) show(list, "all");
  });

  const part = (kind, words) => {
    const element = document.createElement(kind);
    element.textContent = words;
    return element;
  };

  const fill = async (details) => {
    const box = details.querySelector(".exchange");
    if (box.childElementCount) return;
    const [mission, decision] = details.dataset.exchange.split("/").map(encodeURIComponent);
    box.replaceChildren(part("p", "Fetching …"));
    try {
      const answer = await fetch(`/api/v1/missions/${mission}/decisions/${decision}`);
      const body = await answer.json();
      if (!answer.ok) throw new Error(body.error.message);
      const parts = (body.exchange ?? []).flatMap((attempt, i) => [
        part("h3", `Prompt ${i + 1}`),
        part("pre", attempt.prompt),
        part("h3", `Answer ${i + 1}`),
        part("pre", attempt.answer || "(none)"),
        ...attempt.reasons.map((reason) => part("p", `Refused: ${reason}`)),
      ]);
      box.replaceChildren(...(parts.length ? parts : [part("p", "They are not kept any more.")]));
    } catch (error) {
      box.replaceChildren(part("p", `They could not be fetched: ${error.message}`));
    }
  };

  addEventListener("toggle", (event) => {
    if (event.target.dataset?.exchange && event.target.open) fill(event.target);
  }, true);

  const first = (verb) => document.querySelector(`.approvals [data-tap^="${verb}:"]`);
  const focusFirst = (verb) => {
    if (!first(verb)) return;
    falconer.openAside(0);
    first(verb).focus();
  };
  // They point, and Enter acts: no single key approves anything.
  falconer.bind("a", () => focusFirst("approve"));
  falconer.bind("x", () => focusFirst("refuse"));
}
