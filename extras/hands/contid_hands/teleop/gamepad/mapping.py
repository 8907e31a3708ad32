"""The file that maps buttons and axes of a gamepad to motions and orders (`contid jog --mapping`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Final, Literal

from pydantic import AfterValidator, Field, model_validator

from contid.errors import BadInputError, Located, first_findings
from contid.robot_file.base import Strict
from contid.robot_file.findings import allowed_names, validated
from contid.robot_file.positions import Document, KeyPath, read_document, read_text
from contid_hands.teleop.gamepad.device import Capabilities
from contid_hands.teleop.gamepad.events import ABSOLUTE, BUTTONS, EV_ABS, EV_REL, RELATIVE

INPUTS: Final = {**ABSOLUTE, **RELATIVE}


def _one_of(names: Mapping[str, int], what: str) -> AfterValidator:
    def check(value: str) -> str:
        if value not in names:
            raise ValueError(f"{value!r} is no {what}; {allowed_names(names, value)}")
        return value

    return AfterValidator(check)


ButtonName = Annotated[str, _one_of(BUTTONS, "button")]
InputName = Annotated[str, _one_of(INPUTS, "axis of a device")]
DeadBand = Annotated[float, Field(ge=0.01, le=0.9)]


class StickInput(Strict):
    """One axis of the device.

    Attributes:
        input: its name, ``ABS_X`` or ``REL_X``.
        invert: the other way round.
        scale: share of the chosen speed at full deflection.
        dead_band: share of the deflection that counts as centred; that of the file when left out.
    """

    input: InputName
    invert: bool = False
    scale: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0
    dead_band: DeadBand | None = None


class TipInputs(Strict):
    """The axes that move the tip, in the world frame."""

    x: StickInput | None = None
    y: StickInput | None = None
    z: StickInput | None = None


class OrderButtons(Strict):
    """Buttons beside dead-man and stop, each of which may be left out."""

    resume: ButtonName | None = None
    space: ButtonName | None = None
    faster: ButtonName | None = None
    slower: ButtonName | None = None
    next_axes: ButtonName | None = None


class MappingFile(Strict):
    """The whole file.

    Attributes:
        contid_gamepad: version of this format.
        dead_man: the button that is held while the robot moves.
        estop: the button that stops, whatever else is pressed.
        dead_band: see `StickInput`.
        full: value of a relative axis at full deflection.
        silence_s: the robot holds when a deflected device sent no event for this time [s]; None: never.
        buttons, tip, axes: what moves what; ``axes`` in the order of the robot's.
    """

    contid_gamepad: Literal[1]
    dead_man: ButtonName
    estop: ButtonName
    dead_band: DeadBand = 0.15
    full: Annotated[float, Field(ge=1.0, le=1e6)] = 350.0
    silence_s: Annotated[float, Field(ge=0.05, le=60.0)] | None = None
    buttons: OrderButtons = OrderButtons()
    tip: TipInputs = TipInputs()
    axes: Annotated[tuple[StickInput, ...], Field(max_length=16)] = ()

    @model_validator(mode="after")
    def _moves(self) -> MappingFile:
        if not self.axes and not self.tip.model_dump(exclude_none=True):
            raise ValueError("nothing moves: tip: {x: {input: ABS_X}}, or axes: [{input: ABS_X}]")
        return self


@dataclass(frozen=True, slots=True)
class BoundInput:
    """An axis of a device with its range: values to shares of the speed.

    Attributes:
        type, code: type and code of its events.
        centre, half: middle and half of its range.
        dead_band: share of ``half`` that counts as centred.
        scale: share at full deflection; negative: inverted.
    """

    type: int
    code: int
    centre: float
    half: float
    dead_band: float
    scale: float

    def share(self, value: float) -> float:
        """Share of the speed, -1 to 1; 0 within the dead-band, from whose edge it rises steadily."""
        deflection = min(max((value - self.centre) / self.half, -1.0), 1.0)
        beyond = max(abs(deflection) - self.dead_band, 0.0) / (1.0 - self.dead_band)
        return beyond * self.scale if deflection > 0.0 else -beyond * self.scale


@dataclass(frozen=True, slots=True)
class BoundMapping:
    """A mapping for one device.

    Attributes:
        dead_man, estop: codes of the buttons.
        dead_man_name, estop_name: their names.
        orders: order by code of its button.
        tip: inputs of x, y and z.
        axes: inputs of the robot's axes.
        silence_s: see `MappingFile`.
    """

    dead_man: int
    estop: int
    dead_man_name: str
    estop_name: str
    orders: dict[int, str]
    tip: tuple[BoundInput | None, ...]
    axes: tuple[BoundInput, ...]
    silence_s: float | None

    @property
    def help(self) -> str:
        """One line for the operator."""
        return (
            f"{self.dead_man_name} held: the sticks move; released: hold. {self.estop_name}: STOP. "
            "Keys: Tab tip/axes, 1-9 first axis, +/- speed, space STOP, e resume, q quit"
        )

    @property
    def inputs(self) -> Iterator[BoundInput]:
        """Every axis that moves something."""
        yield from (each for each in (*self.tip, *self.axes) if each is not None)


def default_mapping(kind: str | None) -> Path:
    """The shipped mapping for a kind of device; that of gamepads for None."""
    name = "spacemouse" if kind == "spacemouse" else "gamepad"
    return Path(str(files("contid_hands.teleop.gamepad") / "mappings" / f"{name}.yaml"))


def read_mapping(path: Path, has: Capabilities) -> BoundMapping:
    """Read a mapping for a device.

    Raises:
        ContidError: the file cannot be read.
        BadInputError: mistakes, or the device has not what the file names; with their places.
    """
    document = read_document(read_text(path), str(path))
    file = validated(document, MappingFile)
    return _Binder(file, document, has).bind()


class _Binder:
    """One file and one device."""

    def __init__(self, file: MappingFile, document: Document, has: Capabilities) -> None:
        self._file, self._document, self._has = file, document, has
        self._findings: list[Located] = []
        self._meanings: dict[str, str] = {}  # of the buttons so far

    def bind(self) -> BoundMapping:
        file = self._file
        orders = file.buttons.model_dump(exclude_none=True)
        bound = BoundMapping(
            dead_man=self._button(file.dead_man, ("dead_man",)),
            estop=self._button(file.estop, ("estop",)),
            dead_man_name=file.dead_man,
            estop_name=file.estop,
            orders={self._button(name, ("buttons", order)): order for order, name in orders.items()},
            tip=tuple(self._input(getattr(file.tip, name), ("tip", name)) for name in "xyz"),
            axes=tuple(
                found
                for index, each in enumerate(file.axes)
                if (found := self._input(each, ("axes", index))) is not None
            ),
            silence_s=file.silence_s,
        )
        if self._findings:
            raise BadInputError(first_findings(self._findings))
        return bound

    def _button(self, name: str, path: KeyPath) -> int:
        meaning = str(path[-1])
        if (before := self._meanings.setdefault(name, meaning)) != meaning:
            message = f"{name} is {before} already; a button has one meaning"
            self._findings.append(self._document.at_value(path, message))
        if BUTTONS[name] not in self._has.keys:
            self._missing(name, path, [each for each, code in BUTTONS.items() if code in self._has.keys])
        return BUTTONS[name]

    def _input(self, written: StickInput | None, path: KeyPath) -> BoundInput | None:
        if written is None:
            return None
        dead_band = written.dead_band or self._file.dead_band
        scale = -written.scale if written.invert else written.scale
        code = INPUTS[written.input]
        relative, absolute = code in self._has.relative, code in self._has.absolute
        # A 3D mouse has relative or absolute axes, depending on the kernel; their numbers are the same.
        if code < len(RELATIVE) and relative and (written.input in RELATIVE or not absolute):
            return BoundInput(EV_REL, code, 0.0, self._file.full, dead_band, scale)
        if not absolute:
            have = [each for each, number in ABSOLUTE.items() if number in self._has.absolute]
            have += [each for each, number in RELATIVE.items() if number in self._has.relative]
            self._missing(written.input, (*path, "input"), have)
            return None
        info = self._has.absolute[code]
        if info.maximum <= info.minimum:
            message = f"{written.input} of {self._has.name} has no range"
            self._findings.append(self._document.at_value((*path, "input"), message))
            return None
        if not info.minimum < info.value < info.maximum:
            message = (
                f"{written.input} of {self._has.name} is at an end of its range: a trigger rests there and "
                "has no centre; name a stick, or let go of it"
            )
            self._findings.append(self._document.at_value((*path, "input"), message))
            return None
        half = 0.5 * (info.maximum - info.minimum)
        dead_band = max(dead_band, min(info.flat / half, 0.9))
        return BoundInput(EV_ABS, code, 0.5 * (info.maximum + info.minimum), half, dead_band, scale)

    def _missing(self, name: str, path: KeyPath, have: Sequence[str]) -> None:
        message = f"{self._has.name} has no {name}; {allowed_names(have, name)}"
        self._findings.append(self._document.at_value(path, message))
