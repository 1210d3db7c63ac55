"""Commands that are run to their end, and what the system knows of a process."""

import asyncio
import os
from collections.abc import Mapping
from pathlib import Path

from benchmarks.fleet import FALCONER, ROOT
from tests.patience import PATIENCE_S


async def falconer(*arguments: str) -> tuple[int, str]:
    """Run a command of the product; return its exit code and what it said."""
    return await _run((*FALCONER, *arguments), {})


async def python(program: str, environment: Mapping[str, str]) -> tuple[int, str]:
    """Run a line of Python in an environment; return its exit code and what it said."""
    return await _run((FALCONER[0], "-c", program), environment)


async def _run(command: tuple[str, ...], environment: Mapping[str, str]) -> tuple[int, str]:
    process = await asyncio.create_subprocess_exec(
        *command,
        cwd=ROOT,
        env={**os.environ, **environment},
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
    )
    async with asyncio.timeout(PATIENCE_S):
        words, _ = await process.communicate()
    assert process.returncode is not None
    return process.returncode, words.decode()


def memory_kib(pid: int) -> int:
    """Return the resident memory of a process."""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1])
    raise AssertionError(f"process {pid} says nothing of its memory")
