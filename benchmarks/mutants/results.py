"""What became of the mutants: the files that mutmut leaves, counted and set out."""

import json
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

_FLOORS = ("solver", "llm")
_KERNELS = "solver.engines.fast."

_SURVIVED = frozenset({0, 5, 33})
"""mutmut's codes: every test passed; no test reaches the function (the last two)."""


@dataclass(frozen=True)
class Module:
    """The mutants of one module."""

    name: str
    results: Mapping[str, int | None]
    """Name of a mutant to mutmut's code for what became of it, None where it was not tried."""

    @property
    def group(self) -> str:
        """What it is counted with: kernels, or its floor."""
        return "kernels" if self.name.startswith(_KERNELS) else self.name.split(".")[0]

    @property
    def tried(self) -> int:
        """How many of the mutants were tried."""
        return sum(code is not None for code in self.results.values())

    @property
    def survivors(self) -> tuple[str, ...]:
        """The mutants that no test noticed. One that ran for ever or crashed was noticed."""
        return tuple(name for name, code in self.results.items() if code in _SURVIVED)

    @property
    def killed(self) -> float:
        """The share of the tried mutants that a test noticed, 0 to 1."""
        return 1.0 - len(self.survivors) / self.tried


def modules(folder: Path) -> list[Module]:
    """Return the modules that have mutants, by name, from mutmut's folder."""
    found = []
    files = [file for floor in _FLOORS for file in (folder / floor).rglob("*.py.meta")]
    for file in sorted(files):
        results = json.loads(file.read_text("utf-8"))["exit_code_by_key"]
        if results:
            name = ".".join(file.relative_to(folder).parts).removesuffix(".py.meta")
            found.append(Module(name.removesuffix(".__init__"), results))
    return found


def drawn(module: Module, count: int, seed: int) -> list[str]:
    """Return some of a module's mutants, the same ones for the same seed."""
    names = sorted(module.results)
    chance = random.Random(f"{seed} {module.name}")
    return sorted(chance.sample(names, min(count, len(names))))


def summary(found: Sequence[Module]) -> str:
    """Return a table of the modules with tried mutants, the whole, and every survivor.

    The share of a group weighs each module's share by the number of its mutants, since a sample
    takes as many from a small module as from a large one.
    """
    tried = [module for module in found if module.tried]
    lines = ["| module | mutants | tried | killed |", "|---|---|---|---|"]
    lines += [
        f"| `{m.name}` | {len(m.results)} | {m.tried} | {100 * m.killed:.0f} % |" for m in tried
    ]
    groups = {floor: [m for m in tried if m.group == floor] for floor in (*_FLOORS, "kernels")}
    for floor, group in groups.items():
        if group:
            mutants = sum(len(module.results) for module in group)
            killed = sum(len(module.results) * module.killed for module in group) / mutants
            count = sum(module.tried for module in group)
            lines.append(f"| **{floor}** | {mutants} | {count} | **{100 * killed:.0f} %** |")
    survivors = [name for module in tried for name in module.survivors]
    return "\n".join([*lines, "", f"{len(survivors)} survived:", *survivors, ""])
