"""Which zones the team knows, and who of it."""

import numpy as np

from solver import exposure
from solver.arrays import BoolArray, frozen_bool
from solver.exposure import Prices
from solver.observations import Link
from solver.problem import ZoneTable
from solver.zones import Zone, ZoneKind

MAX_ZONES = 256
"""More are refused: bounded memory whatever is reported or drawn."""


class ZoneKnowledge:
    """The registry of known zones with the mask of who knows which.

    Connected robots share at once, so each of them knows what any of them knows; a jammed
    robot knows what it knew when it was cut off (what it learns meanwhile is on board).
    """

    def __init__(self, robot_ids: tuple[int, ...]) -> None:
        self._rows = {robot_id: row for row, robot_id in enumerate(robot_ids)}
        self._zones: dict[str, Zone] = {}
        self._known: dict[str, set[int]] = {}
        self._version = 0
        self._mask: tuple[int, BoolArray] | None = None
        self._tables: tuple[object, tuple[ZoneTable, ZoneTable]] | None = None

    @property
    def zones(self) -> tuple[Zone, ...]:
        """Every zone anybody knows, in the order they became known."""
        return tuple(self._zones.values())

    def learn(self, zone: Zone, links: dict[int, Link]) -> bool:
        """Tell all connected robots of a zone; return whether it is a new one.

        A zone that is known already is replaced: the newest word on an id counts.
        """
        new = zone.id not in self._zones
        if new and len(self._zones) >= MAX_ZONES:
            return False
        self._zones[zone.id] = zone
        holders = self._known.setdefault(zone.id, set())
        holders.update(r for r, link in links.items() if link is Link.CONNECTED)
        self._version += 1
        return new

    def restore(self, zone: Zone, holders: tuple[int, ...]) -> None:
        """Take a zone from a checkpoint, known to whoever knew it; unknown robots are left out."""
        self._zones[zone.id] = zone
        self._known[zone.id] = {robot_id for robot_id in holders if robot_id in self._rows}
        self._version += 1

    def holders(self, zone_id: str) -> tuple[int, ...]:
        """Return the robots that know a zone, ascending."""
        return tuple(sorted(self._known.get(zone_id, ())))

    def forget(self, zone_id: str) -> None:
        """Let nobody know a zone any more."""
        self._zones.pop(zone_id, None)
        self._known.pop(zone_id, None)
        self._version += 1

    def share(self, links: dict[int, Link]) -> None:
        """Tell every connected robot all that the team knows (after a return)."""
        for holders in self._known.values():
            holders.update(r for r, link in links.items() if link is Link.CONNECTED)
        self._version += 1

    def known(self) -> BoolArray:
        """Return the mask (M, Z), zones in the order of `zones`."""
        if self._mask is None or self._mask[0] != self._version:
            mask = np.zeros((len(self._rows), len(self._zones)), dtype=bool)
            for column, zone_id in enumerate(self._zones):
                for robot_id in self._known[zone_id]:
                    mask[self._rows[robot_id], column] = True
            self._mask = self._version, frozen_bool(mask)
        return self._mask[1]

    def tables(
        self, rows: tuple[int, ...], severities: tuple[tuple[str, float], ...], prices: Prices
    ) -> tuple[ZoneTable, ZoneTable]:
        """Return the optimizer's sensing and communication zones for the robots of some rows.

        They change seldom and are the same objects until they do.
        """
        key = (self._version, rows, severities, prices)
        if self._tables is None or self._tables[0] != key:
            zones, known, factors = self.zones, self.known()[list(rows)], dict(severities)
            tables = (
                _zone_table(zones, known, ZoneKind.SENSING, factors, prices.sensing),
                _zone_table(zones, known, ZoneKind.COMMUNICATION, factors, prices.communication),
            )
            self._tables = key, tables
        return self._tables[1]


def _zone_table(
    zones: tuple[Zone, ...],
    known: BoolArray,
    kind: ZoneKind,
    severities: dict[str, float],
    price: float,
) -> ZoneTable:
    """Return the zones of one kind as the optimizer's arrays, severity folded in.

    `known` is (M, Z) over all `zones`, rows being the planned robots; `price` is that of
    exposure (`solver.exposure`). Where communication has a price, what is left to its hinge is
    what the price does not know: the disc of `margin * spread` in which jamming is certain.
    Around the chance-constrained rim that disc would count twice, and send a team that has
    to spread far out of its way.
    """
    columns = [i for i, zone in enumerate(zones) if zone.kind is kind]
    chosen = [zones[i] for i in columns]
    severity = [severities.get(zone.id, 1.0) for zone in chosen]
    quantiles = [zone.quantile(s) for zone, s in zip(chosen, severity, strict=True)]
    if kind is ZoneKind.COMMUNICATION and price > 0.0:
        quantiles = [0.0] * len(chosen)
    return exposure.zone_table(
        chosen,
        known[:, columns],
        quantiles,
        [z.margin for z in chosen],
        severity,
        price,
    )
