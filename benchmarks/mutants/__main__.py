"""Make small errors in the code one by one and see whether a test fails (`make mutants`).

    python -m benchmarks.mutants [--sample N] [--seed N] [--report] [MODULE ...]

mutmut makes the errors, in a copy of the code in `mutants/`: another operator, another number,
an argument left out, a value of None. Each is tried with the tests that reach its function;
pyproject.toml names the modules and the tests. All errors in the verification of answers are
tried, then a seeded sample of N from every module of the solver. With a MODULE, such as
`solver.fusion`, all errors in that module and no others are tried.

Prints how many were noticed, module by module, then every one that was not: `mutmut show NAME`
shows it. A survivor is either a change that changes nothing, or a test that is missing.
"""

import argparse
import subprocess
import sys
from pathlib import Path

from benchmarks.mutants.results import drawn, modules, summary

ROOT = Path(__file__).resolve().parents[2]
_FOLDER = ROOT / "mutants"
_MUTMUT = Path(sys.executable).with_name("mutmut")
_WHOLE = "llm.*"
_SAMPLED = "solver."


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
    if not options.report:
        _mutmut([f"{name}.*" for name in options.modules] or [_WHOLE])
        if not options.modules:
            sampled = [m for m in modules(_FOLDER) if m.name.startswith(_SAMPLED)]
            _mutmut([name for m in sampled for name in drawn(m, options.sample, options.seed)])
    sys.stdout.write(summary(modules(_FOLDER)))
    return 0


def _mutmut(names: list[str]) -> None:
    """Try mutants by name or pattern. Raises CalledProcessError where the tests fail as it is."""
    command = [_MUTMUT, "run", "--max-children", "1", *names]
    subprocess.run(command, cwd=ROOT, check=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
