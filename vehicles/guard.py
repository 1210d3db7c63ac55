"""Which setpoints a robot takes: fresh ones, in order, of one planner at a time."""

from dataclasses import dataclass

from vehicles.messages import Setpoint


@dataclass(slots=True)
class _Planner:
    """The planner that is being followed."""

    boot: str
    seq: int
    fastest_s: float
    """Smallest difference so far between our clock at receipt and its clock at sending: the
    clocks' offset plus the quickest way. What takes longer was delayed by the excess."""

    alive_until_s: float
    """Until its last setpoint has expired, no other planner is listened to."""


class SetpointGuard:
    """Judges setpoints as they arrive. Sans-I/O; times are on the receiver's own clock.

    Args:
        robot_id: Whose setpoints.
    """

    def __init__(self, robot_id: int) -> None:
        self.robot_id = robot_id
        self._planner: _Planner | None = None

    def refusal(self, message: Setpoint, now_s: float) -> str | None:
        """Return why a setpoint is not taken, None when it is."""
        if message.robot_id != self.robot_id:
            return f"meant for robot {message.robot_id}"
        current = self._planner
        offset_s = now_s - message.stamp_s
        if current is None or message.boot != current.boot:
            if current is not None and now_s < current.alive_until_s:
                return "another planner is in charge"
            self._planner = _Planner(message.boot, message.seq, offset_s, now_s + message.ttl_s)
            return None
        if message.seq <= current.seq:
            return "older than the last one"
        current.seq = message.seq
        current.fastest_s = min(current.fastest_s, offset_s)
        if offset_s - current.fastest_s > message.ttl_s:
            return "expired on its way"
        current.alive_until_s = now_s + message.ttl_s
        return None
