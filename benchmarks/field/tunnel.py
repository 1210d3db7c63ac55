"""Two network namespaces joined by a link in user space: two TUN devices and what is between.

Packets of one device come out of the other, late or not at all, as `Weather` says. The devices
are made where this process lives; the far one is then moved, and stays ours to read and write.
"""

import asyncio
import fcntl
import os
import struct
import subprocess
from collections import deque
from contextlib import suppress
from typing import Self

from benchmarks.field.ways import PacketWay, Weather

NEAR, FAR = "10.83.0.1", "10.83.0.2"
"""Addresses of the two ends. They exist in the two namespaces and nowhere else."""

_TUNSETIFF = 0x400454CA
_IFF_TUN, _IFF_NO_PI = 0x0001, 0x1000
_MTU = 1500
_QUEUE = 2000
"""Packets on their way at most; a full link drops the newest."""


class Tunnel:
    """The link between this namespace and that of another process. `async with`.

    Args:
        weather: How the link is; may change at any time.
        far: Id of a process that lives in the other namespace.
        seed: Of the dice.

    Raises:
        OSError, subprocess.CalledProcessError: A device cannot be made or moved.
    """

    def __init__(self, weather: Weather, far: int, seed: int) -> None:
        self._far = far
        self.ways = (PacketWay(weather, seed), PacketWay(weather, seed + 1))
        """From here to there, and back."""

        self._devices: list[int] = []
        self._queues: tuple[deque[tuple[float, bytes]], ...] = (deque(), deque())

    async def __aenter__(self) -> Self:
        self._devices = [_device("near"), _device("far")]
        within = entered(self._far)
        _ip("link", "set", "far", "netns", str(self._far))
        _up("near", NEAR, FAR)
        _up("far", FAR, NEAR, within)
        loop = asyncio.get_running_loop()
        for way in (0, 1):
            loop.add_reader(self._devices[way], self._take, way)
        return self

    async def __aexit__(self, *exception: object) -> None:
        for device in self._devices:
            asyncio.get_running_loop().remove_reader(device)
            os.close(device)
        for queue in self._queues:
            queue.clear()

    def _take(self, way: int) -> None:
        """Take every packet that waits at a device."""
        loop, queue = asyncio.get_running_loop(), self._queues[way]
        with suppress(BlockingIOError):
            while packet := os.read(self._devices[way], _MTU + 100):
                due_s = self.ways[way].due_s(loop.time())
                if due_s is None or len(queue) >= _QUEUE:
                    continue
                queue.append((due_s, packet))
                if len(queue) == 1:
                    loop.call_at(due_s, self._give, way)

    def _give(self, way: int) -> None:
        """Hand out what is due; come back for the rest."""
        loop, queue = asyncio.get_running_loop(), self._queues[way]
        while queue and queue[0][0] <= loop.time():
            _, packet = queue.popleft()
            # A device that is full drops, as a modem does.
            with suppress(BlockingIOError):
                os.write(self._devices[1 - way], packet)
        if queue:
            loop.call_at(queue[0][0], self._give, way)


def entered(pid: int) -> tuple[str, ...]:
    """Return what is put before a command to let it run in the network of a process."""
    return ("nsenter", "--target", str(pid), "--net", "--")


def _device(name: str) -> int:
    """Make a TUN device and return the file its packets come from."""
    device = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    try:
        asked = struct.pack("16sH22x", name.encode(), _IFF_TUN | _IFF_NO_PI)
        fcntl.ioctl(device, _TUNSETIFF, asked)
    except BaseException:
        os.close(device)
        raise
    return device


def _up(name: str, own: str, other: str, within: tuple[str, ...] = ()) -> None:
    _ip("address", "add", own, "peer", other, "dev", name, within=within)
    _ip("link", "set", name, "up", "mtu", str(_MTU), within=within)


def _ip(*words: str, within: tuple[str, ...] = ()) -> None:
    subprocess.run((*within, "ip", *words), check=True, capture_output=True, timeout=10.0)
