"""From wire messages to the vocabulary and back.

Messages have been checked when they were decoded; what they say is passed on as it is.
"""

from math import pi
from typing import Any

from solver import observations as facts
from solver.beliefs import FilterSettings
from solver.directives import Weights
from solver.exposure import Prices
from solver.hypotheses import Law
from solver.problem import SensorModel
from solver.setpoints import Setpoint
from solver.zones import Zone, ZoneKind
from vehicles import messages as wire
from vehicles import world_messages
from vehicles.inference import InferenceRules
from vehicles.knowledge import FlightRules, Knowledge, Mate
from vehicles.rule_parts import FilterPart, InferencePart, RulesPart, SensorPart
from vehicles.world.state import Failures, Hit, Truth, WorldEvent


class Sender:
    """Stamps the messages of one run of one party: boot id, count per key, own clock.

    Args:
        boot: Names this run.
    """

    def __init__(self, boot: str) -> None:
        self.boot = boot
        self._counts: dict[str, int] = {}

    def header(self, key: str, now_s: float) -> dict[str, Any]:
        """Return the common fields of the next message on a key, sent at `now_s`."""
        seq = self._counts.get(key, 0)
        self._counts[key] = seq + 1
        return {"v": wire.VERSION, "boot": self.boot, "seq": seq, "stamp_s": now_s}


# ---------------------------------------------------------------------- parts


def zone_part(zone: Zone) -> wire.ZonePart:
    """Return a zone for the wire."""
    return wire.ZonePart(
        id=zone.id,
        kind=zone.kind,
        mean=zone.mean,
        covariance=zone.covariance,
        margin=zone.margin,
        risk=zone.risk,
        risk_single=zone.risk_single,
    )


def zone_of(part: wire.ZonePart) -> Zone:
    """Return the zone a part tells of."""
    return Zone(
        id=part.id,
        kind=part.kind,
        mean=part.mean,
        covariance=part.covariance,
        margin=part.margin,
        risk=part.risk,
        risk_single=part.risk_single,
    )


def track_part(track: facts.OnboardTrack) -> wire.TrackPart:
    """Return a track for the wire."""
    return wire.TrackPart(target_id=track.target_id, mean=track.mean, covariance=track.covariance)


def track_of(part: wire.TrackPart) -> facts.OnboardTrack:
    """Return the track a part tells of."""
    return facts.OnboardTrack(part.target_id, part.mean, part.covariance)


# ---------------------------------------------------------------------- upward


def state_message(header: dict[str, Any], state: facts.RobotState, mode: wire.Mode) -> wire.State:
    """Return a robot's own state for the wire."""
    return wire.State(
        **header,
        robot_id=state.robot_id,
        position=state.position,
        velocity=state.velocity,
        altitude_m=state.altitude_m,
        sensing_failed=state.sensing_failed,
        mode=mode,
    )


def state_of(message: wire.State) -> facts.RobotState:
    """Return the state a message tells."""
    return facts.RobotState(
        robot_id=message.robot_id,
        position=message.position,
        velocity=message.velocity,
        altitude_m=message.altitude_m,
        sensing_failed=message.sensing_failed,
    )


def detections_message(header: dict[str, Any], seen: facts.Detections) -> wire.Detections:
    """Return what a robot saw for the wire."""
    return wire.Detections(
        **header,
        robot_id=seen.robot_id,
        position=seen.position,
        sightings=sighting_parts(seen),
    )


def sighting_parts(seen: facts.Detections) -> tuple[wire.SightingPart, ...]:
    """Return sightings for the wire; bearings are within [-pi, pi]."""
    return tuple(
        wire.SightingPart(
            target_id=one.target_id,
            range_m=one.range_m,
            bearing_rad=min(max(one.bearing_rad, -pi), pi),
        )
        for one in seen.sightings
    )


def detections_of(message: wire.Detections) -> facts.Detections:
    """Return what a message says a robot saw."""
    return facts.Detections(
        robot_id=message.robot_id,
        position=message.position,
        sightings=tuple(
            facts.Sighting(one.target_id, one.range_m, one.bearing_rad) for one in message.sightings
        ),
    )


def attack_part(kind: ZoneKind, zone: Zone | None) -> wire.AttackPart:
    """Return a hit for the wire."""
    return wire.AttackPart(kind=kind, zone=None if zone is None else zone_part(zone))


def attack_of(robot_id: int, part: wire.AttackPart, time_s: float) -> facts.Attack:
    """Return the attack a robot tells of, at a mission time."""
    zone = None if part.zone is None else zone_of(part.zone)
    return facts.Attack(robot_id, part.kind, zone, time_s)


def return_part(report: facts.TrackReport) -> wire.ReturnPart:
    """Return what a robot brings when it is back, for the wire."""
    return wire.ReturnPart(
        tracks=tuple(track_part(track) for track in report.tracks),
        zones=tuple(zone_part(zone) for zone in report.zones),
        silent=report.silent,
    )


def report_of(robot_id: int, part: wire.ReturnPart) -> facts.TrackReport:
    """Return what a robot says it brings."""
    return facts.TrackReport(
        robot_id,
        tuple(track_of(track) for track in part.tracks),
        tuple(zone_of(zone) for zone in part.zones),
        part.silent,
    )


# ---------------------------------------------------------------------- downward


def setpoint_message(header: dict[str, Any], setpoint: Setpoint, mission: str) -> wire.Setpoint:
    """Return a setpoint for the wire."""
    return wire.Setpoint(
        **header,
        robot_id=setpoint.robot_id,
        mission=mission,
        ttl_s=setpoint.ttl_s,
        velocity=setpoint.velocity,
        waypoint=setpoint.waypoint,
        altitude_m=setpoint.altitude_m,
    )


def setpoint_of(message: wire.Setpoint) -> Setpoint:
    """Return the setpoint a message gives."""
    return Setpoint(
        robot_id=message.robot_id,
        velocity=message.velocity,
        waypoint=message.waypoint,
        altitude_m=message.altitude_m,
        ttl_s=message.ttl_s,
    )


class MateParts:
    """Team mates for the wire, each made once however many robots are told of it."""

    def __init__(self) -> None:
        # By identity: hashing what a mate says takes as long as making its part. The mate is
        # kept, so that no other object can get its identity.
        self._made: dict[int, tuple[Mate, wire.MatePart]] = {}

    def of(self, mates: tuple[Mate, ...]) -> tuple[wire.MatePart, ...]:
        """Return mates for the wire."""
        made = self._made
        for mate in mates:
            if id(mate) not in made:
                part = wire.MatePart(robot_id=mate.robot_id, position=mate.position)
                made[id(mate)] = (mate, part)
        return tuple([made[id(mate)][1] for mate in mates])


def knowledge_message(header: dict[str, Any], known: Knowledge, mates: MateParts) -> wire.Knowledge:
    """Return what a robot is told of the team, for the wire. The time of the tracks is now.

    `mates` remembers what was said of team mates to others in the same round.
    """
    rules, weights = known.rules, known.weights
    sensor, settings = rules.sensor, rules.filter
    return wire.Knowledge(
        **header,
        robot_id=known.robot_id,
        mission=known.mission,
        rules=RulesPart(
            step_s=rules.step_s,
            horizon=rules.horizon,
            dynamics=rules.dynamics,
            control_lower=rules.control_lower,
            control_upper=rules.control_upper,
            speed_limit_m_s=rules.speed_limit_m_s,
            field_lower=rules.field_lower,
            field_upper=rules.field_upper,
            min_dist_m=rules.min_dist_m,
            separation_weight=rules.separation_weight,
            sensor=SensorPart(
                range_peak=sensor.range_peak,
                range_shape=sensor.range_shape,
                bearing_peak=sensor.bearing_peak,
                bearing_shape=sensor.bearing_shape,
            ),
            filter=FilterPart(
                model=settings.model,
                process_noise=settings.process_noise,
                prior_variance=settings.prior_variance,
                gate_probability=settings.gate_probability,
                drop_after_s=settings.drop_after_s,
                speed_variance=settings.speed_variance,
                near_field=settings.near_field,
            ),
            inference=None if rules.inference is None else _inference_part(rules.inference),
        ),
        weights=(weights.tracking, weights.control, weights.sensing, weights.communication),
        targets=known.targets,
        tracks=tuple(track_part(track) for track in known.tracks),
        zones=tuple(zone_part(zone) for zone in known.zones),
        severities=known.severities,
        mates=mates.of(known.mates),
        prices=(known.prices.sensing, known.prices.communication),
    )


def knowledge_of(message: wire.Knowledge, now_s: float) -> Knowledge:
    """Return what a message tells a robot, its tracks being of `now_s` on the robot's clock."""
    rules = message.rules
    return Knowledge(
        robot_id=message.robot_id,
        mission=message.mission,
        time_s=now_s,
        rules=FlightRules(
            step_s=rules.step_s,
            horizon=rules.horizon,
            dynamics=rules.dynamics,
            control_lower=rules.control_lower,
            control_upper=rules.control_upper,
            speed_limit_m_s=rules.speed_limit_m_s,
            field_lower=rules.field_lower,
            field_upper=rules.field_upper,
            min_dist_m=rules.min_dist_m,
            separation_weight=rules.separation_weight,
            sensor=SensorModel(**rules.sensor.model_dump()),
            filter=FilterSettings(**rules.filter.model_dump()),
            inference=None if rules.inference is None else _inference_of(rules.inference),
        ),
        weights=Weights(*message.weights),
        targets=message.targets,
        tracks=tuple(track_of(track) for track in message.tracks),
        zones=tuple(zone_of(zone) for zone in message.zones),
        severities=message.severities,
        mates=tuple(Mate(mate.robot_id, mate.position) for mate in message.mates),
        prices=Prices(*message.prices),
    )


def _inference_part(rules: InferenceRules) -> InferencePart:
    law = rules.law
    return InferencePart(
        period_s=law.period_s,
        step_s=law.step_s,
        recover_density=law.recover_density,
        zones_per_m2=law.per_m2,
        faults_per_s=law.fault_rate,
        deviation_m=law.deviation_m,
        memory_s=rules.memory_s,
        confidence=rules.confidence,
        risk=rules.risk,
        risk_single=rules.risk_single,
    )


def _inference_of(part: InferencePart) -> InferenceRules:
    return InferenceRules(
        law=Law(
            period_s=part.period_s,
            step_s=part.step_s,
            recover_density=part.recover_density,
            per_m2=part.zones_per_m2,
            fault_rate=part.faults_per_s,
            deviation_m=part.deviation_m,
        ),
        memory_s=part.memory_s,
        confidence=part.confidence,
        risk=part.risk,
        risk_single=part.risk_single,
    )


# ---------------------------------------------------------------------- the world


def truth_message(
    header: dict[str, Any], truth: Truth, state: wire.WorldState, hits: wire.HitsPart
) -> wire.Truth:
    """Return the world as it is, for the wire."""
    return wire.Truth(
        **header,
        time_s=truth.time_s,
        step=truth.step,
        state=state,
        robots=tuple(
            wire.TrueRobotPart(
                id=robot.id,
                position=robot.position,
                velocity=robot.velocity,
                altitude_m=robot.altitude_m,
                sensing_failed=robot.failures.sensing,
                jammed=robot.failures.communication,
            )
            for robot in truth.robots
        ),
        targets=tuple(
            wire.TrueTargetPart(id=target.id, position=target.position, velocity=target.velocity)
            for target in truth.targets
        ),
        zones=tuple(zone_part(zone) for zone in truth.zones),
        hits=hits,
    )


def senses_message(
    header: dict[str, Any],
    state: facts.RobotState,
    failures: Failures,
    seen: facts.Detections | None,
) -> world_messages.Senses:
    """Return what a robot that is flown elsewhere can do and sees, for the wire."""
    return world_messages.Senses(
        **header,
        robot_id=state.robot_id,
        sensing_failed=failures.sensing,
        jammed=failures.communication,
        position=state.position,
        sightings=None if seen is None else sighting_parts(seen),
    )


def incident_message(header: dict[str, Any], event: WorldEvent) -> world_messages.Incident:
    """Return what the world did to a robot that is flown elsewhere, for the wire."""
    zone = event.zone if isinstance(event, Hit) else None
    happening = world_messages.Happening
    return world_messages.Incident(
        **header,
        robot_id=event.robot_id,
        happening=happening.STRUCK if isinstance(event, Hit) else happening.RECOVERED,
        kind=event.kind,
        zone=None if zone is None else zone_part(zone),
    )
