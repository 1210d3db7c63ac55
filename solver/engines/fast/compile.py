"""Compile the kernels ahead: `python -m solver.engines.fast.compile [--generic]`.

Fills the cache that `compiled.py` describes, so that the first mission does not wait. With
`--generic` the machine code is made for any processor of the architecture, for an image that
is built on one machine and run on others; processes that shall use it need the environment
variable NUMBA_CPU_NAME=generic as well.
"""

import argparse
import os
import subprocess
import sys
import time

from solver.engines.fast.compiled import cache_directory, compiled, source_key

_PROCESSOR = "NUMBA_CPU_NAME"
_GENERIC = "generic"


def main(arguments: list[str]) -> int:
    """Compile, say where to and how long it took; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m solver.engines.fast.compile")
    parser.add_argument("--generic", action="store_true", help="machine code for any processor")
    options = parser.parse_args(arguments)
    if options.generic and os.environ.get(_PROCESSOR) != _GENERIC:
        # Numba reads the variable when it is imported, which has happened by now.
        again = [sys.executable, "-m", "solver.engines.fast.compile", "--generic"]
        return subprocess.run(
            again, env={**os.environ, _PROCESSOR: _GENERIC}, check=False
        ).returncode
    began = time.monotonic()
    compiled()
    seconds = time.monotonic() - began
    sys.stdout.write(f"kernels ready after {seconds:.1f} s: {cache_directory(source_key())}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
