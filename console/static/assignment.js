// Arrows go from cell to cell of the matrix; Enter presses one.
"use strict";

addEventListener("keydown", (event) => {
  const cell = event.target.closest?.(".matrix [data-tap]");
  const step = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] };
  const [down, along] = step[event.key] ?? [];
  if (!cell || down === undefined || event.ctrlKey || event.metaKey || event.altKey) return;
  const rows = [...cell.closest("tbody").rows].map((row) => [...row.querySelectorAll("[data-tap]")]);
  const here = rows.findIndex((row) => row.includes(cell));
  const column = rows[here].indexOf(cell);
  const row = rows[here + down] ?? [];
  row[Math.min(column + along, row.length - 1)]?.focus();
  event.preventDefault();
});
