"""The graph of an exported policy, built by hand from plain arrays: normaliser, network, action limit, target."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from skillcli import __version__
from skillcli.execution.policy_ports import Port, Targets
from skillcli.learning.agent import Agent
from skillcli.learning.networks import CLIP, EPSILON
from skillcli.trajectories import Array

OPSET, IR = 17, 8  # of 2022: runtimes of that time and of today read the file


@dataclass(frozen=True, eq=False)
class Weights:
    """A frozen policy as plain arrays, float32."""

    mean: Array  # (o,) of the observations
    scale: Array  # (o,) one over their standard deviation
    layers: tuple[tuple[Array, Array], ...]  # weight (inputs, outputs) and bias (outputs,) of each; tanh between them
    latent: int  # size d
    linear: bool  # whether the action is affine in the latent; else the latent is one more input of the first layer

    @staticmethod
    def of(agent: Agent, latent: int) -> Weights:
        """Read those of an agent whose latents have size d."""
        arrays = agent.arrays()
        numbers = sorted(int(name.split(".")[2]) for name in arrays if name.startswith("policy.body.") and "weight" in name)
        return Weights(
            mean=arrays["normalizer.mean"],
            scale=1 / np.sqrt(arrays["normalizer.variance"] + np.float32(EPSILON)),
            layers=tuple((arrays[f"policy.body.{k}.weight"].T, arrays[f"policy.body.{k}.bias"]) for k in numbers),
            latent=latent,
            linear=agent.policy.linear,
        )


@dataclass
class Graph:
    """Nodes and constants of a graph that grows; every node has one output, which names it."""

    nodes: list[Any] = field(default_factory=list)
    constants: list[Any] = field(default_factory=list)

    def constant(self, name: str, array: Any, dtype: Any = np.float32) -> str:
        """Add a constant; return its name."""
        self.constants.append(numpy_helper.from_array(np.ascontiguousarray(array, dtype=dtype), name))
        return name

    def add(self, operator: str, inputs: Sequence[str], name: str, **attributes: Any) -> str:
        """Add a node; return the name of its output."""
        self.nodes.append(helper.make_node(operator, list(inputs), [name], name=name, **attributes))
        return name


def build_model(
    weights: Weights,
    limit: float,
    targets: Targets | None,
    inputs: Sequence[Port],
    outputs: Sequence[Port],
    metadata: Mapping[str, str],
) -> onnx.ModelProto:
    """Build the model.

    Args:
        weights: of the policy.
        limit: action limit, rad; m without an arm.
        targets: what the commanded targets are held to; None leaves them out.
        inputs: described inputs.
        outputs: described outputs.
        metadata: further texts by name.
    """
    graph = Graph()
    _action(graph, weights)
    _increment(graph, limit)
    if targets is not None:
        _target(graph, targets)
    made = helper.make_graph(
        graph.nodes, "policy", [_value(port) for port in inputs], [_value(port) for port in outputs], graph.constants
    )
    model = helper.make_model(
        made, producer_name="skill", producer_version=__version__, ir_version=IR, opset_imports=[helper.make_opsetid("", OPSET)]
    )
    helper.set_model_props(model, dict(metadata))
    onnx.checker.check_model(model, full_check=True)
    return model


def _value(port: Port) -> Any:
    said = f"{port.meaning}; unit {port.unit}; in this order: {', '.join(port.order)}"
    return helper.make_tensor_value_info(port.name, TensorProto.FLOAT, list(port.shape), said)


def _action(graph: Graph, weights: Weights) -> None:
    """Add normaliser and network: observation (N, o) and latent (N, d) to action (N, a)."""
    centred = graph.add("Sub", ["observation", graph.constant("normalizer/mean", weights.mean)], "centred")
    scaled = graph.add("Mul", [centred, graph.constant("normalizer/scale", weights.scale)], "scaled")
    bounds = graph.constant("normalizer/low", -CLIP), graph.constant("normalizer/high", CLIP)
    x = graph.add("Clip", [scaled, *bounds], "normalized")
    if not weights.linear:
        x = graph.add("Concat", [x, "latent"], "network_input", axis=1)
    last = len(weights.layers) - 1
    for k, (weight, bias) in enumerate(weights.layers):
        product = graph.add("MatMul", [x, graph.constant(f"policy/{k}/weight", weight)], f"product_{k}")
        name = f"layer_{k}" if weights.linear or k < last else "action"
        x = graph.add("Add", [product, graph.constant(f"policy/{k}/bias", bias)], name)
        if k < last:
            x = graph.add("Tanh", [x], f"hidden_{k}")
    if weights.linear:
        _affine(graph, x, weights)


def _affine(graph: Graph, parts: str, weights: Weights) -> None:
    """Add f + G z: parts (N, (1 + d) * a) hold f first, then a column of G for each component of z."""
    width = len(weights.layers[-1][1])
    size = width // (1 + weights.latent)
    sizes = graph.constant("affine/sizes", [size, width - size], np.int64)
    graph.nodes.append(helper.make_node("Split", [parts, sizes], ["offset", "columns"], name="split", axis=1))
    # 0 keeps the number of rows
    shape = graph.constant("affine/shape", [0, weights.latent, size], np.int64)
    slopes = graph.add("Reshape", ["columns", shape], "slopes")  # (N, d, a)
    axis = graph.constant("affine/axis", [1], np.int64)
    row = graph.add("Unsqueeze", ["latent", axis], "latent_row")  # (N, 1, d)
    change = graph.add("Squeeze", [graph.add("MatMul", [row, slopes], "change_row"), axis], "change")
    graph.add("Add", ["offset", change], "action")


def _increment(graph: Graph, limit: float) -> None:
    """Add the action limit: action (N, a) to increment (N, a)."""
    scaled = graph.add("Mul", ["action", graph.constant("action/limit", limit)], "scaled_action")
    bounds = graph.constant("increment/low", -limit), graph.constant("increment/high", limit)
    graph.add("Clip", [scaled, *bounds], "increment")


def _target(graph: Graph, targets: Targets) -> None:
    """Add what `simulation.targets.next_target` does: commanded and increment (N, J) to target (N, J)."""
    ends = (targets.measured.start, targets.measured.stop, 1)
    columns = [
        graph.constant(f"measured/{name}", [end], np.int64) for name, end in zip(("first", "end", "axis"), ends, strict=True)
    ]
    measured = graph.add("Slice", ["observation", *columns], "measured")
    lead = graph.constant("target/lead", targets.lead)
    wanted = graph.add("Add", ["commanded", "increment"], "wanted")
    led = graph.add("Max", [wanted, graph.add("Sub", [measured, lead], "lowest_led")], "led_low")
    led = graph.add("Min", [led, graph.add("Add", [measured, lead], "highest_led")], "led")
    inside = graph.add("Max", [led, graph.constant("target/low", targets.low)], "inside_low")
    graph.add("Min", [inside, graph.constant("target/high", targets.high)], "target")
