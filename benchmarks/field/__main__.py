"""A team on two sites: its link is cut and healed, then slow and lossy.

    python -m benchmarks.field [--quick] [--sites namespaces|loopback] [--cuts N] [--seconds S]

Every site has a router of its own. The sites are two network namespaces, joined by a link in user
space, where such can be made (root, or a kernel that lets users make them; `ip`, `unshare` and
`nsenter`; /dev/net/tun); otherwise two loopback addresses joined by a TCP forwarder. Prints the
figures as JSON; exit 1 when a promise of the safety table is broken.
"""

import argparse
import asyncio
import os
import shlex
import sys

from benchmarks.field.measure import Plan, broken, measure
from benchmarks.field.sites import Separation, namespace_maker
from benchmarks.report import verdict

_INSIDE = "inside"


def main(arguments: list[str]) -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.field",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    known = Plan()
    parser.add_argument("--sites", choices=[*Separation, _INSIDE], help="what keeps them apart")
    parser.add_argument("--quick", action="store_true", help="about a minute")
    parser.add_argument("--cuts", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=60.0, help="of good and of poor link")
    parser.add_argument("--delay", type=float, default=known.delay_s, help="seconds, one way")
    parser.add_argument("--loss", type=float, default=known.loss, help="share of packets")
    parser.add_argument("--seed", type=int, default=known.seed)
    asked = parser.parse_args(arguments)
    if asked.sites not in {Separation.LOOPBACK, _INSIDE}:
        maker = namespace_maker()
        if maker is not None:
            _move(maker, arguments)
        if asked.sites is not None:
            parser.error("no network namespaces can be made here")
    plan = (
        Plan(delay_s=asked.delay, loss=asked.loss, seed=asked.seed)
        if asked.quick
        else Plan(
            good_s=asked.seconds,
            poor_s=asked.seconds,
            cuts=asked.cuts,
            delay_s=asked.delay,
            loss=asked.loss,
            seed=asked.seed,
        )
    )
    inside = asked.sites == _INSIDE
    separation = Separation.NAMESPACES if inside else Separation.LOOPBACK
    figures = asyncio.run(measure(plan, separation))
    found = broken(figures)
    load = round(os.getloadavg()[0], 1)
    return verdict({"figures": figures.as_dict(), "broken": found, "load": load}, found)


def _move(maker: tuple[str, ...], arguments: list[str]) -> None:
    """Go on in a network of our own."""
    again = shlex.join((sys.executable, "-m", "benchmarks.field", *arguments, "--sites", _INSIDE))
    os.execvp(maker[0], (*maker, "sh", "-c", f"ip link set lo up && exec {again}"))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
