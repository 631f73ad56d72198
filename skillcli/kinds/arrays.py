"""Arrays of several kinds of artifacts."""

from __future__ import annotations

from skillcli.kinds.spec import COUNT, POSITIVE, TRUTH, Field, Values, index

POSITIONS = {
    "trajectories/joint_position": Field("episode,step+1,joint", "rad", required=False),
    "trajectories/gripper_position": Field("episode,step+1,xyz", "m", required=False),
    "trajectories/object_pose": Field("episode,step+1,pose", "m", required=False),
    "trajectories/position": Field("episode,step+1,xy", "m", required=False),
}
"""At least one of them is required."""

TRAJECTORIES = {
    "trajectories/time": Field("step+1", "s"),
    "trajectories/latent": Field("episode,step,latent"),
    "trajectories/skill": Field("episode,step", values=index("skill", none=True)),
    "trajectories/action": Field("episode,step,action", "rad or m"),
    "trajectories/reward": Field("episode,step"),
    "trajectories/target": Field("episode,xyz", "m"),
    "trajectories/success": Field("episode", values=TRUTH),
    "trajectories/length": Field("episode", "step", values=Values("i", 1, of="trajectories: step")),
    "trajectories/violations": Field("episode,limit", "step", required=False, values=COUNT),
    "trajectories/violated": Field("episode,step,limit", required=False, values=TRUTH),
    "trajectories/unstable": Field("episode", required=False, values=TRUTH),
    "trajectories/gave_up": Field("episode", required=False, values=TRUTH),
    "trajectories/judged_position": Field("episode,step+1,xyz", "m", required=False),
    **POSITIONS,
}
"""Recorded episodes."""

EMBEDDING = {
    "embedding/mean": Field("skill,latent"),
    "embedding/std": Field("skill,latent", values=POSITIVE),
    "skills/goal": Field("skill,xyz", "m"),
}
"""Skills: their latents, and the goals that they were trained for."""
