"""Uniform cost search over latents (Dijkstra 1959; with a heuristic, A*: Hart, Nilsson and Raphael 1968).

A node is a simulator state reached by holding latents one after the other; its cost is the time that took. `ask` proposes
(node, latent, duration) expansions, the cheapest nodes first, several at once; `tell` takes what they led to. The search
never sees a simulator: states are opaque rows.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from skillcli.composition.latent_environment import LatentEnvironment, Outcome
from skillcli.composition.plan import Choices, Segment
from skillcli.composition.planner import Proposal, run
from skillcli.trajectories import Array


@dataclass(frozen=True, eq=False)
class Node:
    """A state that some sequence of latents leads to."""

    parent: Node | None
    choice: int  # index into the choices, -1 at the root
    steps: int  # control steps that the last latent was held
    cost: float  # control steps from the start
    due: int  # index of the waypoint that has to be met next
    points: Array  # (L, 3) m, the landmarks, the judged point first
    row: Array  # (S,) the simulator's state
    speed: float  # m/s of the judged point at the end


@dataclass(frozen=True)
class Settings:
    """How to search; lengths in m, durations in control steps."""

    durations: tuple[int, ...]
    tolerance: float  # a waypoint is met within this
    resolution: float  # states closer than this, with the same waypoint due, count as one
    step_seconds: float
    weight: float  # of the heuristic: 0 uniform cost, 1 A*, above 1 bounded suboptimal (Pohl 1970)
    max_speed: float  # m/s of the judged point, for the heuristic, 0 for none
    approach_speed: float  # m/s of the gripper on its way behind the box, 0 where there is none
    standoff: float  # m from the centre of the box to the gripper that pushes it
    final_speed: float  # m/s, the last waypoint counts as met only at or below this
    budget: int  # expanded nodes


class UniformCostSearch:
    """The cheapest node first: time so far, plus the weighted time still needed at the top speed where one is given.

    Args:
        root: the start state.
        points: (L, 3) m, the landmarks there: the judged point, and the gripper where that is a box.
        waypoints: (W, 3) m, to be met in order, each at any step; the plan ends where the last one is met.
        choices: latents.
        settings: see `Settings`.
    """

    def __init__(self, root: Array, points: Array, waypoints: Array, choices: Choices, settings: Settings) -> None:
        self.waypoints, self.choices, self.settings = waypoints, choices, settings
        legs = np.linalg.norm(np.diff(waypoints, axis=0), axis=1)
        self._legs_behind = np.concatenate([np.cumsum(legs[::-1])[::-1], [0.0]])  # m, path behind each waypoint
        start = Node(None, -1, 0, 0.0, 0, points, root, 0.0)
        self._order = itertools.count()
        self._open: list[tuple[float, int, Node]] = [(self._priority(start), next(self._order), start)]
        self._cheapest: dict[tuple[int, ...], float] = {self._cell(start): start.cost}
        self.best, self.goal = start, None if len(waypoints) else start
        self.expanded = 0

    @property
    def finished(self) -> bool:
        """Whether the cheapest plan is found, the budget is spent, or nothing is left to expand."""
        while self._open and self._stale(self._open[0][2]):
            heapq.heappop(self._open)
        if not self._open or self.expanded >= self.settings.budget:
            return True
        return self.goal is not None and self.goal.cost <= self._open[0][0]

    def ask(self, count: int) -> list[Node]:
        """The next nodes to expand, at most `count`; each is to be continued with every choice and duration."""
        left = min(count, self.settings.budget - self.expanded)
        nodes: list[Node] = []
        while self._open and len(nodes) < left:
            node = heapq.heappop(self._open)[2]
            if not self._stale(node):
                nodes.append(node)
        self.expanded += len(nodes)
        return nodes

    def tell(self, nodes: Sequence[Node], choice: Array, outcome: Outcome, steps: int) -> list[Node]:
        """Take what holding a choice (n,) from each of n nodes for some steps led to; returns the children kept."""
        children = []
        speed = np.linalg.norm(np.diff(outcome.path[:, :, 0], axis=1), axis=2) / self.settings.step_seconds  # (n, steps)
        for i, node in enumerate(nodes):
            if outcome.failed[i]:
                continue
            path, speeds = outcome.path[i], speed[i]
            due, met = self._progress(node.due, path[:, 0], speeds)
            held = met or steps  # a plan ends the moment its last goal is met
            child = Node(
                node, int(choice[i]), held, node.cost + held, due, path[held], outcome.rows[i], float(speeds[held - 1])
            )
            cell = self._cell(child)
            if child.cost >= self._cheapest.get(cell, float("inf")):
                continue
            self._cheapest[cell] = child.cost
            children.append(child)
            self._keep(child)
        return children

    def plan(self, node: Node) -> list[Segment]:
        """The segments that lead to a node; the same latent twice in a row becomes one segment."""
        segments: list[Segment] = []
        while node.parent is not None:
            choice = node.choice
            if segments and segments[0].label == self.choices.label[choice]:
                last = segments.pop(0)
                segments.insert(0, Segment(last.latent, last.skill, last.label, last.steps + node.steps))
            else:
                latent, skill = self.choices.latent[choice], int(self.choices.skill[choice])
                segments.insert(0, Segment(latent, skill, self.choices.label[choice], node.steps))
            node = node.parent
        return segments

    def _stale(self, node: Node) -> bool:
        """Whether a cheaper way to the node's cell was found after the node was."""
        return node.cost > self._cheapest[self._cell(node)]

    def _keep(self, child: Node) -> None:
        if child.due == len(self.waypoints):
            if self.goal is None or child.cost < self.goal.cost:
                self.goal = self.best = child
            return
        heapq.heappush(self._open, (self._priority(child), next(self._order), child))
        if self.goal is None and self._merit(child) < self._merit(self.best):
            self.best = child

    def _progress(self, due: int, path: Array, speed: Array) -> tuple[int, int]:
        """Which waypoint is due behind a path, and the step at which the last one was met, 0 where it was not."""
        last = len(self.waypoints) - 1
        for t in range(1, len(path)):
            while due < last and np.linalg.norm(path[t] - self.waypoints[due]) <= self.settings.tolerance:
                due += 1
            slow = speed[t - 1] <= self.settings.final_speed
            if due == last and slow and np.linalg.norm(path[t] - self.waypoints[last]) <= self.settings.tolerance:
                return due + 1, t
        return due, 0

    def _remaining(self, node: Node) -> float:
        """Length of the straight way through all waypoints that are due, m."""
        if node.due >= len(self.waypoints):
            return 0.0
        return float(np.linalg.norm(node.points[0] - self.waypoints[node.due]) + self._legs_behind[node.due])

    def _approach(self, node: Node) -> float:
        """How far the gripper is from where it can push the box straight at the waypoint that is due, m."""
        box, gripper = node.points[:2, :2]
        gap = self.waypoints[node.due, :2] - box
        behind = box - self.settings.standoff * gap / max(float(np.linalg.norm(gap)), 1e-6)
        return float(np.linalg.norm(gripper - behind))

    def _priority(self, node: Node) -> float:
        if self.settings.max_speed <= 0 or node.due >= len(self.waypoints):
            return node.cost
        # each waypoint may be met a tolerance early and left a tolerance late: less way than the straight one
        slack = self.settings.tolerance * (2 * (len(self.waypoints) - node.due) - 1)
        seconds = max(0.0, self._remaining(node) - slack) / self.settings.max_speed
        if self.settings.approach_speed > 0:
            seconds += self._approach(node) / self.settings.approach_speed
        return node.cost + self.settings.weight * seconds / self.settings.step_seconds

    def _merit(self, node: Node) -> tuple[int, float]:
        """How far from the end a node is, for the best plan where none meets everything."""
        return (-node.due, self._remaining(node))

    def _cell(self, node: Node) -> tuple[int, ...]:
        """States that count as one: judged points in one cell, other landmarks in cells of twice the size."""
        size = np.where(np.arange(len(node.points)) == 0, 1.0, 2.0) * self.settings.resolution
        at = np.floor(node.points / size[:, None]).astype(int).ravel()
        return (node.due, *at.tolist(), int(node.speed > self.settings.final_speed))


class Expansions:
    """A search as a `Planner`: several nodes at once, every choice from each, held for every duration.

    A longer segment goes on where a shorter one ended: every control step is spent once.
    """

    def __init__(self, search: UniformCostSearch, batch: int) -> None:
        self.search, self._batch = search, batch
        self._durations = sorted(search.settings.durations)
        self._left: list[int] = []  # durations that the nodes under way still have before them
        self._held = 0

    def _begin(self, nodes: list[Node]) -> None:
        count = len(self.search.choices.latent)
        self._parents = [node for node in nodes for _ in range(count)]
        self._choice: Array = np.tile(np.arange(count), len(nodes))
        self._rows = np.stack([node.row for node in self._parents])
        self._path: Array = np.empty((len(self._parents), 0, *self.search.best.points.shape))
        self._failed: Array = np.zeros(len(self._parents), dtype=bool)
        self._left, self._held = list(self._durations), 0

    @property
    def finished(self) -> bool:
        """See `Planner`."""
        return not self._left and self.search.finished

    @property
    def done(self) -> tuple[int, int, str]:
        """See `Planner`."""
        met = f"{self.search.best.due} of {len(self.search.waypoints)} waypoints met"
        return self.search.expanded, self.search.settings.budget, met

    def plan(self) -> list[Segment]:
        """See `Planner`: to the goal node, or to the nearest one when the budget is spent."""
        return self.search.plan(self.search.best)

    def ask(self) -> Proposal:
        """See `Planner`."""
        if not self._left:
            self._begin(self.search.ask(self._batch))
        return Proposal(self._rows, self.search.choices.latent[self._choice], self._left[0] - self._held)

    def tell(self, outcome: Outcome) -> None:
        """See `Planner`."""
        self._path = np.concatenate([self._path[:, :-1] if self._held else self._path, outcome.path], axis=1)
        self._failed |= outcome.failed
        self._rows, self._held = outcome.rows, self._left.pop(0)
        so_far = Outcome(self._path, self._failed, self._rows)
        self.search.tell(self._parents, self._choice, so_far, self._held)


def search(planner: UniformCostSearch, world: LatentEnvironment, batch: int, tell: Callable[[int, int, str], None]) -> Node:
    """Run a search to its end, `batch` nodes at once; returns the goal node, or the nearest one when the budget is spent."""
    run(Expansions(planner, batch), world, tell)
    return planner.best
