"""Arrays of several kinds of artifacts."""

from __future__ import annotations

from skillcli.kinds.spec import COUNT, POSITIVE, TRUTH, Field, Values, index
from skillcli.trajectories import AXES

POSITIONS = {
    "trajectories/joint_position": Field(*AXES["joint_position"], required=False),
    "trajectories/gripper_position": Field(*AXES["gripper_position"], required=False),
    "trajectories/object_pose": Field(*AXES["object_pose"], required=False),
    "trajectories/finger_position": Field(*AXES["finger_position"], required=False),
    "trajectories/position": Field(*AXES["position"], required=False),
}
"""At least one of them is required."""

TRAJECTORIES = {
    "trajectories/time": Field(*AXES["time"]),
    "trajectories/latent": Field(*AXES["latent"]),
    "trajectories/skill": Field(*AXES["skill"], values=index("skill", none=True)),
    "trajectories/action": Field(*AXES["action"]),
    "trajectories/reward": Field(*AXES["reward"]),
    "trajectories/target": Field(*AXES["target"]),
    "trajectories/success": Field(*AXES["success"], values=TRUTH),
    "trajectories/length": Field(*AXES["length"], values=Values("i", 1, of="trajectories: step")),
    "trajectories/violations": Field(*AXES["violations"], required=False, values=COUNT),
    "trajectories/violated": Field(*AXES["violated"], required=False, values=TRUTH),
    "trajectories/unstable": Field(*AXES["unstable"], required=False, values=TRUTH),
    "trajectories/gave_up": Field(*AXES["gave_up"], required=False, values=TRUTH),
    "trajectories/judged_position": Field(*AXES["judged_position"], required=False),
    "trajectories/other_poses": Field(*AXES["other_poses"], required=False),
    **POSITIONS,
}
"""Recorded episodes."""

EMBEDDING = {
    "embedding/mean": Field("skill,latent"),
    "embedding/std": Field("skill,latent", values=POSITIVE),
    "skills/goal": Field("skill,xyz", "m"),
}
"""Skills: their latents, and the goals that they were trained for."""
