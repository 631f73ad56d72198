"""Uniform cost search over latents (Dijkstra 1959; with a heuristic, A*: Hart, Nilsson and Raphael 1968).

A node is a simulator state reached by a sequence of held latents; its cost is the time they took. `ask` proposes
expansions (node, latent, duration), the cheapest nodes first and several at once; `tell` takes the outcomes. The search
never sees a simulator: states are opaque arrays.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from skillcli import metrics
from skillcli.composition.latent_environment import Outcome
from skillcli.composition.plan import Choices, Segment
from skillcli.composition.route import STRAIGHT, CostToGo, Route, risk_adjusted
from skillcli.trajectories import Array


@dataclass(frozen=True, eq=False)
class Node:
    """A state reached by a sequence of latents."""

    parent: Node | None
    choice: int  # index into the choices, -1 at the root
    steps: int  # control steps that the last latent was held
    cost: float  # control steps from the start
    next_waypoint: Array  # (M,) index of the next waypoint, on each robot
    keypoints: Array  # (M, L, 3) m, the achieved goal first
    sim_state: Array  # (S,) the simulator's state
    speed: float  # m/s, of the achieved goal at the end


@dataclass(frozen=True)
class SearchSetup:
    """Settings of a search; lengths in m, durations in control steps."""

    durations: tuple[int, ...]
    tolerance: float  # a waypoint is met within this
    resolution: float  # states closer than this, with the same next waypoint, count as one
    step_seconds: float
    weight: float  # of the heuristic: 0 uniform cost, 1 A*, above 1 bounded suboptimal (Pohl 1970)
    max_speed: float  # m/s, highest speed of the achieved goal, for the heuristic; 0 for none
    approach_speed: float  # m/s, highest speed along a detour, for the heuristic; 0 to leave it out
    final_speed: float  # m/s, the last waypoint is met only at or below this speed
    budget: int  # most nodes to expand
    cost_to_go: CostToGo = STRAIGHT


class UniformCostSearch:
    """Expands the node with the lowest cost first: time so far, plus the weighted estimate of the remaining time.

    Args:
        root: the start state.
        keypoints: (M, L, 3) m in that state on M robots, the achieved goal first.
        waypoints: (W, 3) m, to meet in order, each at any step; the plan ends where the last one is met.
        choices: latents.
        settings: see `SearchSetup`.
        barred: choices that must not come first.
        begun: control steps from the start of the plan to the root.
    """

    def __init__(
        self,
        root: Array,
        keypoints: Array,
        waypoints: Array,
        choices: Choices,
        settings: SearchSetup,
        barred: Collection[int] = (),
        begun: int = 0,
    ) -> None:
        self._barred = barred
        self.waypoints, self.choices, self.settings = waypoints, choices, settings
        self._route = Route(waypoints, settings.tolerance, settings.cost_to_go)
        start = Node(None, -1, 0, float(begun), np.zeros(len(keypoints), dtype=int), keypoints, root, 0.0)
        self._order = itertools.count()
        self._open: list[tuple[float, int, Node]] = [(self._priority(start), next(self._order), start)]
        self._cheapest: dict[tuple[int, ...], float] = {self._cell(start): start.cost}
        self.best, self.goal = start, None if len(waypoints) else start
        self.expanded = 0

    @property
    def finished(self) -> bool:
        """Whether the cheapest plan is found, the budget is spent, or no node is left."""
        while self._open and self._stale(self._open[0][2]):
            heapq.heappop(self._open)
        if not self._open or self.expanded >= self.settings.budget:
            return True
        return self.goal is not None and self.goal.cost <= self._open[0][0]

    @property
    def standing(self) -> str:
        """Describe how far the best plan so far comes."""
        count = len(self.waypoints)
        if self.goal is not None:
            return f"a plan meets {'the waypoint' if count == 1 else f'all {count} waypoints'}"
        left = float(self._route.remaining_length(self.best.next_waypoint, self.best.keypoints).max())
        met = f"{int(self.best.next_waypoint.min())} of {count} waypoints met, " if count > 1 else ""
        return f"{met}{left:.3f} m to go"

    def ask(self, count: int) -> list[Node]:
        """Return the next nodes to expand, at most `count`; try every choice and duration from each."""
        left = min(count, self.settings.budget - self.expanded)
        nodes: list[Node] = []
        while self._open and len(nodes) < left:
            node = heapq.heappop(self._open)[2]
            if not self._stale(node):
                nodes.append(node)
        self.expanded += len(nodes)
        return nodes

    def tell(self, nodes: Sequence[Node], choice: Array, outcome: Outcome, steps: int) -> list[Node]:
        """Take the outcome of holding a choice (n,) from each of n nodes; return the children that were kept."""
        children = []
        achieved_goal = outcome.path[:, :, :, 0]
        speed = np.linalg.norm(np.diff(achieved_goal, axis=2), axis=3).mean(axis=1) / self.settings.step_seconds  # (n, steps)
        following, met = self._progress(np.array([node.next_waypoint for node in nodes]), achieved_goal, speed)
        for i, node in enumerate(nodes):
            if outcome.failed[i].any() or (node.parent is None and int(choice[i]) in self._barred):
                continue
            held = int(met[i]) or steps  # a plan ends at the step that meets its last goal
            keypoints = outcome.path[i, :, held]
            child = Node(
                node,
                int(choice[i]),
                held,
                node.cost + held,
                following[i],
                keypoints,
                outcome.sim_states[i],
                float(speed[i, held - 1]),
            )
            cell = self._cell(child)
            if child.cost >= self._cheapest.get(cell, float("inf")):
                continue
            self._cheapest[cell] = child.cost
            children.append(child)
            self._keep(child)
        return children

    def plan(self, node: Node) -> list[Segment]:
        """Return the segments to a node; the same latent twice in a row becomes one segment."""
        segments: list[Segment] = []
        held = -1  # choice of the following segment
        while node.parent is not None:
            if node.choice == held:
                segments[0] = replace(segments[0], steps=segments[0].steps + node.steps)
            else:
                latent, skill = self.choices.latent[node.choice], int(self.choices.skill[node.choice])
                segments.insert(0, Segment(latent, skill, self.choices.label[node.choice], node.steps))
            node, held = node.parent, node.choice
        return segments

    def _stale(self, node: Node) -> bool:
        """Whether a cheaper way to the node's cell was found after this node."""
        return node.cost > self._cheapest[self._cell(node)]

    def _keep(self, child: Node) -> None:
        if self._met(child):
            if self.goal is None or child.cost < self.goal.cost:
                self.goal = self.best = child
            return
        heapq.heappush(self._open, (self._priority(child), next(self._order), child))
        # every latent moves the arm: a plan without segments cannot stay at the root
        if self.goal is None and (self.best.parent is None or self._merit(child) < self._merit(self.best)):
            self.best = child

    def _met(self, node: Node) -> bool:
        """Whether a node has met every waypoint."""
        return bool(node.next_waypoint.min() >= len(self.waypoints))

    def _progress(self, next_waypoint: Array, path: Array, speed: Array) -> tuple[Array, Array]:
        """Return the next waypoint after each path, and the step at which the last one was met, 0 if it was not.

        The last waypoint is met only at low speed, and when the risk-adjusted distance over all robots is small.

        Args:
            next_waypoint: (n, M) before.
            path: (n, M, T+1, 3) m.
            speed: (n, T) m/s.
        """
        last, tolerance = len(self.waypoints) - 1, self.settings.tolerance
        following, met = next_waypoint, np.zeros(len(path), dtype=int)
        for t in range(1, path.shape[2]):
            following = metrics.next_waypoint(following, path[:, :, t], self.waypoints, tolerance, keep_last=True)
            gap = risk_adjusted(np.linalg.norm(path[:, :, t] - self.waypoints[last], axis=2))
            slow = speed[:, t - 1] <= self.settings.final_speed
            met[(met == 0) & (following == last).all(axis=1) & slow & (gap <= tolerance)] = t
        return np.where((met > 0)[:, None], last + 1, following), met

    def _remaining(self, node: Node) -> float:
        """Return the length of the straight way through all waypoints not yet met, m."""
        return 0.0 if self._met(node) else self.remaining_length(node)

    def remaining_length(self, node: Node) -> float:
        """Return the same length; the last waypoint always counts as not met, m."""
        following = np.minimum(node.next_waypoint, len(self.waypoints) - 1)
        return float(risk_adjusted(self._route.remaining_length(following, node.keypoints)))

    def _priority(self, node: Node) -> float:
        if self._met(node):
            return node.cost
        seconds = 0.0
        if self.settings.max_speed > 0:
            # each waypoint may be met a tolerance early and left a tolerance late: the way is shorter than the straight one
            slack = self.settings.tolerance * (2 * (len(self.waypoints) - int(node.next_waypoint.min())) - 1)
            seconds += max(0.0, self._remaining(node) - slack) / self.settings.max_speed
        if self.settings.approach_speed > 0:
            seconds += (
                float(risk_adjusted(self._route.detour(node.next_waypoint, node.keypoints))) / self.settings.approach_speed
            )
        return node.cost + self.settings.weight * seconds / self.settings.step_seconds

    def _merit(self, node: Node) -> tuple[int, float]:
        """Return how far a node is from the end, to compare nodes if no plan meets every waypoint."""
        return (-int(node.next_waypoint.min()), self._remaining(node))

    def _cell(self, node: Node) -> tuple[int, ...]:
        """Return the cell of a node; nodes in one cell count as one state.

        Cells of the achieved goal have the size of the resolution, cells of the other keypoints twice that. With several robots
        the median position counts: two plans would almost never agree on all of them.
        """
        keypoints = node.keypoints.mean(axis=0)
        size = np.where(np.arange(len(keypoints)) == 0, 1.0, 2.0) * self.settings.resolution
        at = np.floor(keypoints / size[:, None]).astype(int).ravel()
        return (int(node.next_waypoint.min()), *at.tolist(), int(node.speed > self.settings.final_speed))
