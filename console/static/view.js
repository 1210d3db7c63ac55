// Keys of the scene: F fits the field, Z begins a zone.
"use strict";

falconer.bind("f", () => document.querySelector("[data-view=fit]")?.click());
falconer.bind("z", () => document.querySelector("[data-draw=start]")?.click());
