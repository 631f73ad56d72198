"""Results of the original study: Julian et al. 2018, the article and its recorded rollouts.

Lengths in m and angles as displacements in m; "real" is the paper's Sawyer, "sim" its simulation.
"""

from __future__ import annotations

POINT_EFFICIENCY = 0.484  # ellipses over hull of the means
POINT_STEPS = 15_000  # control steps until the embedding separates the four tasks
REACH_CORRELATION = 0.92  # between latent and goal distances
REACH_FINAL = {  # real: final distance by goal
    (0.5, 0.3, 0.15): 0.092,
    (0.5, -0.3, 0.15): 0.071,
    (0.5, 0.3, 0.3): 0.140,
    (0.5, -0.3, 0.3): 0.093,
    (0.7, 0.3, 0.15): 0.191,
    (0.7, -0.3, 0.15): 0.124,
    (0.7, 0.3, 0.3): 0.215,
    (0.7, -0.3, 0.3): 0.128,
}
REACH_TOLERANCE = 0.05  # real: none of them within
REACH_UNSEEN = {  # real: a DDPG composer, final distance by goal
    (0.5, 0.0, 0.15): 0.0504,
    (0.5, 0.0, 0.3): 0.137,
    (0.7, 0.0, 0.3): 0.082,
}
TRIANGLE_SECONDS = 60.0  # sim: a plan in less than
TRIANGLE_TOLERANCE = 0.05  # sim: every vertex within
PUSH_GOALS = {"up": (0.15, 0.0), "down": (-0.15, 0.0), "left": (0.0, 0.15), "right": (0.0, -0.15)}  # displacements
PUSH_MOVED = {  # real: displacement of the box by skill
    "up": (0.166, 0.002),
    "down": (-0.082, 0.001),
    "left": (-0.038, 0.116),
    "right": (0.044, -0.145),
}
PUSH_MEANS = {  # real: displacement at the mean of two neighbouring latents
    frozenset(("up", "left")): (0.098, 0.020),
    frozenset(("up", "right")): (0.157, -0.109),
    frozenset(("down", "left")): (-0.032, 0.022),
    frozenset(("down", "right")): (-0.072, -0.006),
}
PUSH_SEARCHED = {  # sim: final distance by goal, a displacement
    (-0.2, 0.1): 0.004,
    (-0.2, -0.1): 0.064,
    (0.2, 0.1): 0.042,
    (0.2, -0.1): 0.026,
}
TRANSFER = {"push": "“not able to reliably transfer” (real)"}  # of compositions, by task
ARMS = "full space clearly better"
