"""Policies as ONNX files: one input, the observation, and one output, the action, with what they are for.

The metadata of the file has a key ``contid`` with JSON: robots and their axes, observation, rate. A file
without it is refused: nothing in its tensors distinguishes one robot from another of the same size.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, Self

import numpy as np

from contid.errors import ContidError, require_extra
from contid.kinematics.array import Array
from contid.whole_file import replacing
from contid_learn.views import Observation, RobotView

#: Layout of the observation (`contid_learn.views`); a policy for another one is refused.
OBSERVATION: Final = 1
KEY: Final = "contid"


@dataclass(frozen=True, slots=True)
class PolicyAbout:
    """What a policy is for.

    Attributes:
        columns: axes that it moves, in the order of its action: ``left_mm``.
        width: numbers of the observation.
        rate_hz: actions per second that it learnt with.
        task: that it learnt.
        observation: layout of the observation.
    """

    columns: tuple[str, ...]
    width: int
    rate_hz: float
    task: str
    observation: int = OBSERVATION

    @classmethod
    def of(cls, views: Sequence[RobotView], rate_hz: float, task: str) -> Self:
        """For the robots of an environment."""
        columns = tuple(column for view in views for column in view.columns)
        return cls(columns, sum(view.width for view in views), rate_hz, task)

    @classmethod
    def parse(cls, text: str) -> Self:
        """From the metadata of a file.

        Raises:
            ValueError, TypeError, KeyError: it is no such JSON.
        """
        raw: dict[str, Any] = json.loads(text)
        raw["columns"] = tuple(str(each) for each in raw["columns"])
        about = cls(**raw)
        if not (isinstance(about.rate_hz, float | int) and 0.0 < about.rate_hz <= 1000.0):
            raise ValueError(f"rate_hz {about.rate_hz!r}: allowed: above 0, up to 1000")
        return about


class Policy:
    """A policy read from an ONNX file.

    Args:
        path: of the file.

    Attributes:
        about: what it is for.

    Raises:
        ContidError: it is missing, no policy of this layout, or its tensors have other sizes; or onnxruntime
            is not installed.
    """

    def __init__(self, path: str | Path) -> None:
        require_extra("a policy", "onnxruntime")
        # From 1.29 on it sends names and hashes of models to its maker, by default; it looks at its import.
        os.environ["ORT_DISABLE_TELEMETRY"] = "1"
        import onnxruntime  # type: ignore[import-untyped, unused-ignore]

        if not Path(path).is_file():
            raise ContidError(f"{path}: no such file")
        options = onnxruntime.SessionOptions()
        # One thread: the tick of the robot runs on the same machine.
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4
        try:
            self._session = onnxruntime.InferenceSession(str(path), options, ["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime has no common base of its errors
            raise ContidError(
                f"{path}: no ONNX file that onnxruntime can run: {_first_line(error)}"
            ) from None
        text = self._session.get_modelmeta().custom_metadata_map.get(KEY)
        if text is None:
            raise ContidError(
                f"{path}: its metadata has no key {KEY!r}, which names the robot; write it with "
                "contid_learn.write_policy, or add it to your export (docs/robots/learning.md)"
            )
        try:
            self.about = PolicyAbout.parse(text)
        except (ValueError, TypeError, KeyError) as error:
            raise ContidError(f"{path}: metadata {KEY!r}: {error}") from None
        if self.about.observation != OBSERVATION:
            raise ContidError(f"{path}: observation {self.about.observation}; this version has {OBSERVATION}")
        inputs, outputs = self._session.get_inputs(), self._session.get_outputs()
        if len(inputs) != 1 or not outputs:
            raise ContidError(f"{path}: {len(inputs)} inputs, {len(outputs)} outputs; expected: 1 of each")
        self._input, self._output = inputs[0].name, outputs[0].name
        self._path = str(path)
        self(np.zeros(self.about.width, np.float32))

    def __call__(self, observed: Observation) -> Array:
        """The action to an observation, shape ``(n,)``; its numbers may be anything.

        Raises:
            ContidError: the network refuses the observation, or answers another number of axes.
        """
        try:
            answer = self._session.run([self._output], {self._input: observed[None, :]})[0]
        except Exception as error:
            raise ContidError(f"{self._path}: {_first_line(error)}") from None
        try:
            action = np.asarray(answer, dtype=np.float64).ravel()
        except Exception:  # text, a map, a sequence of tensors, nothing
            raise ContidError(f"{self._path}: its output {self._output!r} is no tensor of numbers") from None
        if action.shape != (len(self.about.columns),):
            raise ContidError(
                f"{self._path}: it answers {action.size} numbers for {len(self.about.columns)} axes"
            )
        return action


def write_policy(path: str | Path, about: PolicyAbout, layers: Sequence[tuple[Array, Array]]) -> None:
    """Write a policy of dense layers with tanh after each.

    Args:
        path: of the file; replaced as a whole.
        about: what it is for.
        layers: weights, shape ``(outputs, inputs)``, and biases of each layer.

    Raises:
        ContidError: sizes do not fit, or onnx is not installed.
    """
    require_extra("writing a policy", "onnx")
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    sizes = [about.width, *(len(bias) for _, bias in layers)]
    for number, ((weights, bias), inputs) in enumerate(zip(layers, sizes, strict=False)):
        if weights.shape != (len(bias), inputs):
            raise ContidError(f"layer {number}: weights {weights.shape}; expected: {(len(bias), inputs)}")
    if sizes[-1] != len(about.columns):
        raise ContidError(f"the last layer has {sizes[-1]} outputs for {len(about.columns)} axes")
    nodes, numbers, flow = [], [], "observation"
    for index, (weights, bias) in enumerate(layers):
        numbers.append(numpy_helper.from_array(weights.astype(np.float32), f"weights{index}"))
        numbers.append(numpy_helper.from_array(bias.astype(np.float32), f"bias{index}"))
        given = [flow, f"weights{index}", f"bias{index}"]
        nodes.append(helper.make_node("Gemm", given, [f"sum{index}"], transB=1))
        flow = "action" if index == len(layers) - 1 else f"layer{index}"
        nodes.append(helper.make_node("Tanh", [f"sum{index}"], [flow]))
    seen = helper.make_tensor_value_info("observation", TensorProto.FLOAT, [None, about.width])
    done = helper.make_tensor_value_info("action", TensorProto.FLOAT, [None, len(about.columns)])
    graph = helper.make_graph(nodes, "policy", [seen], [done], numbers)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    helper.set_model_props(model, {KEY: json.dumps(asdict(about))})
    onnx.checker.check_model(model)
    with replacing(Path(path)) as file:
        file.write(model.SerializeToString())


def _first_line(error: Exception) -> str:
    lines = str(error).splitlines()
    return lines[0] if lines else type(error).__name__
