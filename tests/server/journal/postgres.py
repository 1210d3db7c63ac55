"""A PostgreSQL server of the tests' own, on a free port of 127.0.0.1."""

import os
import pwd
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any, Self

START_S = 60.0


def program(name: str) -> str:
    """Return one of PostgreSQL's programs (`scripts/postgres` installs them)."""
    found = shutil.which("postgres")
    if found is not None:
        return str(Path(found).resolve().with_name(name))
    folders = sorted(Path("/usr/lib/postgresql").glob("*/bin/postgres"))
    assert folders, "PostgreSQL is not installed: run scripts/postgres"
    return str(folders[-1].with_name(name))


def free_port() -> int:
    """Return a port that nobody listens on now."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port: int = probe.getsockname()[1]
    return port


class Postgres:
    """One server; it refuses to run as root, so root starts it as the user `postgres`."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="falconer-postgres-"))
        self.port = free_port()
        self._process: subprocess.Popen[bytes] | None = None
        self._user = "postgres" if os.getuid() == 0 else pwd.getpwuid(os.getuid()).pw_name
        if os.getuid() == 0:
            shutil.chown(self.folder, self._user, self._user)
        self._run("initdb", "-D", str(self.folder / "data"), "-U", "falconer", "-A", "trust")

    @property
    def url(self) -> str:
        return f"postgresql://falconer:unused-password@127.0.0.1:{self.port}/postgres"

    def start(self) -> Self:
        """Start it and wait until it answers."""
        options = {
            "listen_addresses": "127.0.0.1",
            "unix_socket_directories": "",
            "fsync": "off",
        }
        flags = [part for name, value in options.items() for part in ("-c", f"{name}={value}")]
        self._process = subprocess.Popen(
            [program("postgres"), "-D", str(self.folder / "data"), "-p", str(self.port), *flags],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            cwd=self.folder,
            **self._as_user(),
        )
        until = time.monotonic() + START_S
        ready = [program("pg_isready"), "-q", "-h", "127.0.0.1", "-p", str(self.port)]
        while subprocess.run(ready, check=False).returncode != 0:
            assert self._process.poll() is None, "PostgreSQL did not start"
            assert time.monotonic() < until, "PostgreSQL is not ready"
            time.sleep(0.05)
        return self

    def stop(self) -> None:
        """End it as if the machine had lost power: connections break."""
        if self._process is not None:
            self._process.send_signal(signal.SIGQUIT)
            self._process.wait(START_S)
            self._process = None

    def remove(self) -> None:
        """End it and remove what it wrote."""
        self.stop()
        shutil.rmtree(self.folder)

    def _run(self, name: str, *arguments: str) -> None:
        subprocess.run(
            [program(name), *arguments],
            check=True,
            capture_output=True,
            cwd=self.folder,
            env={"LC_ALL": "C", "PATH": os.environ["PATH"]},
            **self._as_user(),
        )

    def _as_user(self) -> dict[str, Any]:
        root = os.getuid() == 0
        return {"user": self._user, "group": self._user} if root else {}
