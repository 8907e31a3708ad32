"""The process of a model that is not contid's: builds it and answers questions until its socket closes."""

from __future__ import annotations

import pickle
import socket
from contextlib import suppress
from typing import Any, Final

from contid.control.process.isolation.model_wire import ANSWERS, ModelQuestion, pack_answer, pack_error
from contid.control.process.isolation.served_process import ServedProcess, defect, json_answer
from contid.control.process.isolation.wire import KeptAnswer, RequestKind
from contid.kinematics.model import Model, Searching, build_model
from contid.targets import Target

#: What contid's own models have beside the protocol: objects that kernels call, and a change of the model
#: that one built anew would not have.
_INSIDE: Final = ("taut", "capstan", "shared", "avoid")


class ModelProcess(ServedProcess):
    """The model, from the first question to the last; ``body`` is the pickled description of its robot."""

    what = "model"

    def __init__(self, connection: socket.socket, body: bytes) -> None:
        """See `ServedProcess`."""
        super().__init__(connection, body)
        #: With thorough searches, and with short ones.
        self._models: tuple[Model, Model] | None = None

    def _answer(self, kind: RequestKind, body: bytes) -> KeptAnswer | None:
        if kind is RequestKind.ASK:
            return KeptAnswer(kind, self._ask(body))
        if kind is RequestKind.HURRY:
            self._hurry()
            return None
        return json_answer(kind, self._build())

    def _ask(self, body: bytes) -> bytes:
        brief, method, arguments = ModelQuestion.unpack(body)
        assert self._models is not None
        try:
            answer = getattr(self._models[brief], method)(*arguments)
        except BaseException as error:  # here it costs no other robot
            return pack_error(error)
        return pack_answer(method, answer)

    def _build(self) -> dict[str, Any]:
        """Build the model; what it is, or why there is none."""
        try:
            model = build_model(pickle.loads(self._packed))
            brief = model.for_ticks() if isinstance(model, Searching) else model
            for name in _INSIDE:
                if getattr(model, name, None) is not None:
                    return {"error": f"it has {name!r}, which only models inside contid may have"}
            self._models = (model, brief)
            found = {
                "axis_names": [str(name) for name in model.axis_names],
                "lower": [float(end) for end in model.lower],
                "upper": [float(end) for end in model.upper],
                "dimension": int(model.dimension),
                "straight_approach": bool(getattr(model, "straight_approach", False)),
                "methods": [name for name in ANSWERS if getattr(model, name, None) is not None],
                "searches": isinstance(model, Searching),
            }
        except BaseException as error:
            return {"error": defect(error)}
        self._warm_up()
        return found

    def _warm_up(self) -> None:
        """The first call may import and compile what later ones do not."""
        assert self._models is not None
        for model in self._models:
            with suppress(BaseException):
                middle = tuple((low + high) / 2.0 for low, high in zip(model.lower, model.upper, strict=True))
                model.inverse(Target(tip_m=model.forward(middle).tip_m), middle)
