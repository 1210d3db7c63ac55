"""Make small errors in the code one by one and see whether a test fails (`make mutants`).

    python -m benchmarks.mutants [--sample N] [--seed N] [--report] [MODULE ...]

mutmut makes the errors, in a copy of the code in `mutants/`: another operator, another number,
an argument left out, a value of None. Each is tried with the quickest tests that reach its
function, a fixed time of them (`quick_first.py`); pyproject.toml names the modules and the tests.
All errors in the verification of answers are tried, then a seeded sample of N from every module
of the solver. With a MODULE, such as `solver.fusion`, all errors in that module and no others are
tried.

The kernels of the fast engine are tried last, as plain Python in a copy of their own
(`kernels.py`), with tests that compare them with finite differences, with the symbolic model and
with IPOPT; `kernels.toml` names them. A mutant of theirs is shown by `mutmut show` in that copy.

Prints how many were noticed, module by module, then every one that was not: `mutmut show NAME`
shows it. A survivor is either a change that changes nothing, or a test that is missing.
"""

import argparse
import subprocess
import sys
from pathlib import Path

from benchmarks.mutants.kernels import stage
from benchmarks.mutants.results import drawn, modules, summary

ROOT = Path(__file__).resolve().parents[2]
_FOLDER = "mutants"
"""Where mutmut works, in the project and in the copy of the kernels."""

_COPY = ROOT / _FOLDER / "kernels"
_MUTMUT = Path(sys.executable).with_name("mutmut")
_WHOLE = "llm"
_SAMPLED = "solver."
_KERNELS = "solver.engines.fast."
_FIRST_KERNELS = "solver.engines.fast.hinges"
"""Tried whole: mutmut makes the mutants of all modules when it is asked to try any."""


def main(arguments: list[str]) -> int:
    """Try the mutants and print the table; return the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sample", type=int, default=20, help="of each module of the solver")
    parser.add_argument("--seed", type=int, default=0, help="of the sample")
    parser.add_argument("--report", action="store_true", help="only print what was tried before")
    parser.add_argument("modules", nargs="*", metavar="MODULE")
    options = parser.parse_args(arguments)
    stage(ROOT, _COPY)
    if not options.report and options.modules:
        chosen = [name for name in options.modules if name.startswith(_KERNELS)]
        _mutmut(ROOT, [f"{name}.*" for name in options.modules if name not in chosen])
        _mutmut(_COPY, [f"{name}.*" for name in chosen])
    elif not options.report:
        _sample(ROOT, _WHOLE, options.sample, options.seed)
        _sample(_COPY, _FIRST_KERNELS, options.sample, options.seed)
    sys.stdout.write(summary([*modules(ROOT / _FOLDER), *modules(_COPY / _FOLDER)]))
    return 0


def _sample(folder: Path, whole: str, count: int, seed: int) -> None:
    """Try all mutants of one module, then some of every module of the solver."""
    _mutmut(folder, [f"{whole}.*"])
    sampled = [module for module in modules(folder / _FOLDER) if module.name.startswith(_SAMPLED)]
    names = [name for m in sampled if m.name != whole for name in drawn(m, count, seed)]
    _mutmut(folder, names)


def _mutmut(folder: Path, names: list[str]) -> None:
    """Try mutants by name or pattern. Raises CalledProcessError where the tests fail as it is."""
    if names:
        command = [str(_MUTMUT), "run", "--max-children", "1", *names]
        subprocess.run(command, cwd=folder, check=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
