"""Run franky-sim with one arm at the Panda's start, in real time, until standard input ends; print where it is.

    python franka_server.py [ADDRESS]

Its own loop sleeps a whole step after every step; this one catches up, so that a second of the arm is one of the clock.
"""

from __future__ import annotations

import sys
import threading
import time

from franky_sim import SimulationServer
from franky_sim.mujoco_simulator import MujocoSimulator

START = (0.0, -0.1993, 0.0, -2.4869, 0.0, 2.2876, 0.785)  # of skillcli/robots/panda/panda.toml
STEP = 0.001  # s
GIVE_UP = 0.05  # s behind, after which it no longer catches up


def main() -> None:
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    with MujocoSimulator() as simulator:
        arm = simulator.add_robot(initial_q=START)
        candidates = {"hostname_candidates": sys.argv[1:]} if sys.argv[1:] else {}
        with SimulationServer(simulator, **candidates) as server:
            print(arm.hostname, flush=True)
            due = time.perf_counter()
            while not ended.is_set():
                server.run_once(realtime=False)
                due = max(due + STEP, time.perf_counter() - GIVE_UP)
                time.sleep(max(0.0, due - time.perf_counter()))


if __name__ == "__main__":
    main()
