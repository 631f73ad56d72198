"""Target domains: robots that differ from the simulation, as ranges of parameters drawn anew for every episode."""

from __future__ import annotations

from dataclasses import dataclass

from skillcli.errors import UsageError
from skillcli.perturbation import Range, log_uniform, one_of, uniform


@dataclass(frozen=True)
class Domain:
    """A named target: what differs from the source, by how much, and why."""

    name: str
    description: str
    parameters: dict[str, Range]


# Sources. robosuite: defaults of its dynamics randomisation (mass 2 %, friction 10 %, table height 1.5 mm). Peng et al.
# 2018 (arXiv:1710.06537): latency 40 ms, gains, damping. OpenAI 2018 (arXiv:1808.00177): one step of latency with
# probability one half, friction 0.7-1.3, masses 0.5-1.5. The widths of real-like are those with which composed pushes
# were seen to fail: friction and mass 40 %, gains 30 %, one control step of latency, 5 mrad and 3 mm of noise.
DOMAINS: dict[str, Domain] = {
    domain.name: domain
    for domain in (
        Domain("nominal", "the simulation itself, nothing changed", {}),
        Domain(
            "random-starts",
            "the simulation itself, but arm and box start elsewhere",
            {"start_offset": uniform(-0.15, 0.15), "object_offset": uniform(-0.12, 0.12)},
        ),
        Domain(
            "mild",
            "a well identified robot: small errors of mass, friction, gains and sensors, no latency",
            {
                "link_mass": uniform(0.98, 1.02),
                "joint_damping": uniform(0.9, 1.1),
                "joint_friction": uniform(0.9, 1.1),
                "gain": uniform(0.95, 1.05),
                "object_mass": uniform(0.98, 1.02),
                "contact_friction": uniform(0.9, 1.1),
                "table_height": uniform(-0.0015, 0.0015),
                "joint_noise": one_of(0.001),
                "position_noise": one_of(0.001),
                "start_offset": uniform(-0.005, 0.005),
            },
        ),
        Domain(
            "real-like",
            "a robot known from its data sheet only: wide errors, latency in half of the episodes, noisy sensors",
            {
                "link_mass": uniform(0.6, 1.4),
                "gravity_compensation": uniform(0.9, 1.1),
                "joint_damping": log_uniform(0.5, 2.0),
                "joint_friction": uniform(0.6, 1.4),
                "gain": uniform(0.7, 1.3),
                "object_mass": uniform(0.6, 1.4),
                "contact_friction": uniform(0.6, 1.4),
                "table_height": uniform(-0.005, 0.005),
                "latency": one_of(0.0, 0.05),
                "joint_noise": one_of(0.005),
                "position_noise": one_of(0.003),
                "start_offset": uniform(-0.02, 0.02),
            },
        ),
    )
}


def find_domain(name: str) -> Domain:
    """The preset of this name.

    Raises:
        UsageError: there is none.
    """
    if name not in DOMAINS:
        raise UsageError(f"no domain {name!r}", f"domains: {', '.join(DOMAINS)}; see `skill domains`")
    return DOMAINS[name]
