// Before the first paint: the theme this browser chose last, else the system's.
"use strict";
{
  const chosen = localStorage.getItem("falconer-theme");
  const system = matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark";
  document.documentElement.dataset.theme = chosen === "light" || chosen === "dark" ? chosen : system;
}
