"""One valid message of every kind, as plain JSON objects."""

from typing import Any

from vehicles import messages as wire
from vehicles import world_messages

HEADER = {"v": 1, "boot": "b1", "seq": 3, "stamp_s": 1.5}
ZONE: dict[str, Any] = {
    "id": "s1",
    "kind": "sensing",
    "mean": [1.0, 2.0],
    "covariance": [[0.5, 0.1], [0.1, 0.5]],
    "margin": 0.1,
    "risk": 0.1,
    "risk_single": 0.2,
}
TRACK: dict[str, Any] = {
    "target_id": 122,
    "mean": [1.0, 2.0],
    "covariance": [[0.2, 0.0], [0.0, 0.2]],
}
RULES: dict[str, Any] = {
    "step_s": 0.5,
    "horizon": 5,
    "dynamics": "single_integrator",
    "control_lower": [-1.0, -1.0],
    "control_upper": [1.0, 1.0],
    "speed_limit_m_s": 1.0,
    "field_lower": [-10.0, -10.0],
    "field_upper": [10.0, 10.0],
    "min_dist_m": 0.4,
    "separation_weight": 100.0,
    "sensor": {
        "range_peak": 15.0,
        "range_shape": 0.2,
        "bearing_peak": 15.0,
        "bearing_shape": 0.2,
    },
    "filter": {
        "model": "random_walk",
        "process_noise": 0.1,
        "prior_variance": 100.0,
        "gate_probability": None,
        "drop_after_s": 30.0,
        "speed_variance": 0.25,
        "near_field": "moments",
    },
    "inference": {
        "period_s": 1.0,
        "step_s": 0.2,
        "recover_density": 0.08,
        "zones_per_m2": 0.01,
        "faults_per_s": 0.0005,
        "deviation_m": 0.7,
        "memory_s": 600.0,
        "confidence": 0.5,
        "risk": 0.02,
        "risk_single": 0.05,
    },
}
ROBOT = {**HEADER, "robot_id": 21}
SAMPLES: dict[type[wire.Message], dict[str, Any]] = {
    wire.State: {
        **ROBOT,
        "position": [1.0, 2.0],
        "velocity": [0.1, 0.0],
        "altitude_m": 1.5,
        "sensing_failed": False,
        "mode": "flying",
    },
    wire.Detections: {
        **ROBOT,
        "position": [1.0, 2.0],
        "sightings": [{"target_id": 122, "range_m": 3.0, "bearing_rad": 0.5}],
    },
    wire.Health: {
        **ROBOT,
        "mode": "holding",
        "reason": "no setpoint",
        "uptime_s": 12.0,
        "battery": 0.8,
        "heartbeat_age_s": 0.1,
        "setpoints": 10,
        "refused": 0,
        "dropped": 0,
        "plan_s": None,
    },
    wire.Event: {
        **ROBOT,
        "age_s": 0.0,
        "event": {"type": "attack", "kind": "sensing", "zone": ZONE},
    },
    wire.Setpoint: {
        **ROBOT,
        "mission": "m1",
        "ttl_s": 0.5,
        "velocity": [0.1, 0.2],
        "waypoint": [1.0, 2.0],
        "altitude_m": 1.5,
    },
    wire.Knowledge: {
        **ROBOT,
        "mission": "m1",
        "rules": RULES,
        "weights": [10.0, 0.05, 50.0, 50.0],
        "targets": [122],
        "tracks": [TRACK],
        "zones": [ZONE],
        "severities": [["s1", 2.0]],
        "mates": [{"robot_id": 26, "position": [3.0, 4.0]}],
        "prices": [2.0, 3.0],
    },
    wire.Command: {**ROBOT, "command": "hold", "command_id": "c1", "author": "operator"},
    wire.Heartbeat: {**HEADER, "mission": "m1", "tick": 12, "time_s": 1.2, "state": "running"},
    wire.Truth: {
        **HEADER,
        "time_s": 1.0,
        "step": 10,
        "state": "running",
        "robots": [
            {
                "id": 21,
                "position": [1.0, 2.0],
                "velocity": [0.0, 0.0],
                "altitude_m": 1.5,
                "sensing_failed": False,
                "jammed": True,
            }
        ],
        "targets": [{"id": 122, "position": [1.0, 2.0], "velocity": [0.0, 0.0]}],
        "zones": [ZONE],
        "hits": {"sensing": 1, "communication": 0},
    },
    wire.WorldControl: {**HEADER, "action": "reset", "seed": 7},
    world_messages.Pose: {
        **ROBOT,
        "position": [1.0, 2.0],
        "velocity": [0.1, 0.0],
        "altitude_m": 1.5,
    },
    world_messages.Senses: {
        **ROBOT,
        "sensing_failed": False,
        "jammed": True,
        "position": [1.0, 2.0],
        "sightings": [{"target_id": 122, "range_m": 3.0, "bearing_rad": 0.5}],
    },
    world_messages.Incident: {
        **ROBOT,
        "happening": "struck",
        "kind": "sensing",
        "zone": ZONE,
    },
}
