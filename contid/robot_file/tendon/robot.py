"""A tendon robot in its file; what spans its sections and its statics is checked here."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from contid.robot_file.base import Quantity
from contid.robot_file.dynamics import Dynamics
from contid.robot_file.robot import RobotDescription, SectionLength, TipSurface
from contid.robot_file.simulated_body import SimulatedTendons
from contid.robot_file.tendon.drives import Drive, check_drives, drive_matrix
from contid.robot_file.tendon.sections import TendonRobotGeometry, TendonRobotLimits
from contid.robot_file.tendon.statics import TendonFriction, TendonResidual, TendonRodStatics, Tension
from contid.targets import Actuation, Vec3
from contid.units import MM_PER_M

#: Least range of pulls on either side of the straight robot; no drive resolves less.
_ROOM_MM: Final = 1e-3


class TendonRobot(RobotDescription):
    """A tendon robot of one to eight sections; it grows along +z.

    Axes: ``s1.t1``, ``s1.t2`` and so on: section, tendon; their values are pulls from the straight robot.
    With ``drives``, the names of the drives; their values are travels from the straight robot.
    Targets: a tip; from three sections on also its direction, its whole frame, or a mid-point beside it.

    Attributes:
        model: ``tendon``.
        geometry: dimensions.
        limits: limits of pulls and bends.
        drives: motors that wind several tendons at once, by name; a motor per tendon when left out.
        tension: tension of the tendons; bounds them and adds the stretch of tendons to the pulls.
        friction: friction of the tendons; off when left out.
        rod: statics of the backbone under loads; off when left out.
        residual: correction of the tip from a calibration; off when left out.
        dynamics: masses, damping and answer of the actuators, for the robot in motion; off when left out.
        sim: payload and tracker of the simulated robot in motion, for ``--mock`` and ``driver: sim``.
    """

    quantity: ClassVar[Quantity] = Quantity.LENGTH
    dimension: ClassVar[int] = 3

    model: Literal["tendon"]
    geometry: TendonRobotGeometry
    limits: TendonRobotLimits
    drives: dict[str, Drive] | None = None
    tension: Tension | None = None
    friction: TendonFriction | None = None
    rod: TendonRodStatics | None = None
    residual: TendonResidual | None = None
    dynamics: Dynamics | None = None
    sim: SimulatedTendons | None = None

    @model_validator(mode="after")
    def _consistent(self) -> TendonRobot:
        count = self.sections
        self._check_drives()
        pull_mm = self.limits.pull_mm or ()
        rows: list[tuple[str, Sequence[object]]] = [("limits.bend_max_deg", self.limits.bend_max_deg)]
        if pull_mm:
            rows.append(("limits.pull_mm", pull_mm))
        if self.tension is not None:
            for key in ("bending_n_mm2", "tendon_n_per_mm", "spring_n_per_mm"):
                if (values := getattr(self.tension, key)) is not None:
                    rows.append((f"tension.{key}", values))
        if self.rod is not None:
            if self.tension is None:
                raise ValueError("rod needs tension, which has the stiffness of the backbone and the tendons")
            for key in ("weight_n_per_m", "torsion_n_mm2", "stretch_n"):
                if (values := getattr(self.rod, key)) is not None:
                    rows.append((f"rod.{key}", values))
        if self.friction is not None:
            rows.append(("friction.capstan", self.friction.capstan))
            self._check_capstan(self.friction)
        if self.dynamics is not None:
            if self.tension is None:
                raise ValueError("dynamics needs tension, which has the stiffness of backbone and tendons")
            weighed = self.rod is not None and all(self.per_section(self.rod.weight_n_per_m))
            self.dynamics.check(count, len(self.axis_names), weighed)
        if self.sim is not None and self.dynamics is None:
            raise ValueError("sim needs dynamics, which has the masses")
        for what, values in rows:
            if len(values) not in (1, count):
                raise ValueError(f"{what} has {len(values)} entries; allowed: 1 or {count}, one per section")
        if self.residual is not None:
            self._check_residual(self.residual)
        backlash = () if self.friction is None else self.friction.play_mm
        axes = len(self.axis_names)
        counts = [1, count, axes] if self.drives is None else [1, axes]
        if backlash and len(backlash) not in counts:
            allowed = ", ".join(map(str, counts[:-1])) + f" or {axes}"
            raise ValueError(f"friction.play_mm has {len(backlash)} numbers; allowed: {allowed}")
        for low, high in pull_mm:
            if not low <= -_ROOM_MM <= _ROOM_MM <= high:
                raise ValueError(
                    f"limits.pull_mm [{low:g}, {high:g}] has no room on both sides of 0, the straight robot"
                )
        return self

    def _check_drives(self) -> None:
        if self.drives is None:
            if self.tension is not None and self.tension.pretension_n is not None:
                raise ValueError("tension.pretension_n is for drives; a motor per tendon keeps floor_n")
            if self.limits.pull_mm is None:
                raise ValueError("limits: pull_mm is missing; only a robot with drives may leave it out")
            for number, section in enumerate(self.geometry.sections):
                if len(section.angles_deg) == 2:
                    raise ValueError(
                        f"geometry.sections.{number}.angles_deg has two tendons, which bend in one plane; "
                        "three or more are needed, or drives that pull them together"
                    )
            return
        for key in ("rod", "residual", "dynamics"):
            if getattr(self, key) is not None:
                raise ValueError(f"{key} is for robots with a motor per tendon; leave out drives or {key}")
        if self.friction is not None and any(self.friction.capstan):
            raise ValueError(
                "friction.capstan is for robots with a motor per tendon; play_mm goes with drives"
            )
        if self.tension is not None and self.tension.pretension_n is None:
            raise ValueError(
                "tension: pretension_n is missing; drives pull and pay out, but tighten no tendon"
            )
        elastic = self.tension is not None
        for finding in check_drives(self.drives, self.tendon_names, self.geometry, elastic=elastic):
            raise ValueError(finding)

    def _check_capstan(self, friction: TendonFriction) -> None:
        if any(friction.capstan) and self.tension is None:
            raise ValueError("friction.capstan needs tension, which has the stiffness of the tendons")
        if any(friction.capstan) and self.rod is not None:
            raise ValueError("friction.capstan leads the model of arcs; leave out rod or capstan")

    def _check_residual(self, residual: TendonResidual) -> None:
        if self.tension is None:
            raise ValueError("residual needs tension, from which bends and stretches follow")
        bends = 2 * self.sections
        features = bends + len(self.axis_names)
        terms = features + bends * (bends + 1) // 2 + 1
        for key, count in (
            ("low_rad_mm", features), ("high_rad_mm", features),
            ("gain_x_mm", terms), ("gain_y_mm", terms), ("gain_z_mm", terms),
        ):  # fmt: skip
            if len(getattr(residual, key)) != count:
                raise ValueError(
                    f"residual.{key} has {len(getattr(residual, key))} numbers; allowed: {count}"
                )
        for low, high in zip(residual.low_rad_mm, residual.high_rad_mm, strict=True):
            if low > high:
                raise ValueError(f"residual: the range {low:g} to {high:g} is empty")

    @property
    def sections(self) -> int:
        """Number of sections."""
        return len(self.geometry.sections)

    @property
    def axis_names(self) -> tuple[str, ...]:
        """The tendons, or with ``drives`` those, in file order."""
        return self.tendon_names if self.drives is None else tuple(self.drives)

    @property
    def tendon_names(self) -> tuple[str, ...]:
        """Section by section from the base, tendon by tendon."""
        return tuple(
            f"s{s + 1}.t{t + 1}"
            for s, section in enumerate(self.geometry.sections)
            for t in range(len(section.angles_deg))
        )

    @property
    def has_weight(self) -> bool:
        """True where ``rod.weight_n_per_m`` is not 0."""
        return self.rod is not None and any(self.rod.weight_n_per_m)

    @property
    def depends_on_down(self) -> bool:
        """True where a residual was fitted beside a weight."""
        return self.has_weight and self.residual is not None

    @property
    def accepts(self) -> frozenset[str]:
        """A tip, or bends; from three sections on also a direction, its whole frame or a mid-point."""
        more = {"direction", "mid"} if self.sections > 2 else set()
        if self.rod is not None:
            more = more | {"load"}
        elif self.sections > 2:
            more = more | {"rotation"}
        return super().accepts | more

    @property
    def section_lengths(self) -> tuple[SectionLength, ...]:
        """Sections keep their length; none where loads bend them away from arcs."""
        lengths_mm = () if self.rod is not None else (each.length_mm for each in self.geometry.sections)
        return tuple(SectionLength(length_mm / MM_PER_M, changes=False) for length_mm in lengths_mm)

    @property
    def tip_surface(self) -> TipSurface | None:
        """Of one section whose tip is on its axis; none where loads or a residual bring it elsewhere."""
        beside = any(self.geometry.tip_offset_mm[:2])
        if len(self.section_lengths) != 1 or beside or self.residual is not None:
            return None
        (section,) = self.geometry.sections
        behind_mm = section.rigid_mm + self.geometry.tip_offset_mm[2]
        return None if behind_mm < 0.0 else TipSurface(section.length_mm / MM_PER_M, behind_mm / MM_PER_M)

    @property
    def kinematics(self) -> str:
        """``tendon``, with drives ``tendon.driven``, or with loads ``tendon.rod``."""
        if self.drives is not None:
            return "tendon.driven"
        return self.model if self.rod is None else "tendon.rod"

    @property
    def lower(self) -> Actuation:
        """Least pull of every tendon, or travel of every drive [m]."""
        if self.drives is not None:
            return tuple(drive.travel_mm[0] / MM_PER_M for drive in self.drives.values())
        return tuple(low for low, _ in self.pull_limits_m)

    @property
    def upper(self) -> Actuation:
        """Largest pull of every tendon, or travel of every drive [m]."""
        if self.drives is not None:
            return tuple(drive.travel_mm[1] / MM_PER_M for drive in self.drives.values())
        return tuple(high for _, high in self.pull_limits_m)

    @property
    def pull_limits_m(self) -> tuple[tuple[float, float], ...]:
        """Least and largest pull of every tendon [m]; empty where ``limits.pull_mm`` is left out."""
        if self.limits.pull_mm is None:
            return ()
        low, high = (
            self._per_tendon(tuple(pair[side] / MM_PER_M for pair in self.limits.pull_mm)) for side in (0, 1)
        )
        return tuple(zip(low, high, strict=True))

    @property
    def drive_matrix(self) -> NDArray[np.float64] | None:
        """Pulls of tendons by travels of ``drives``, shape ``(tendons, drives)``; None without."""
        return None if self.drives is None else drive_matrix(self.drives, self.tendon_names)

    @property
    def rest(self) -> Actuation:
        """Pulls that a stop of policy ``rest`` moves to: ``rest_mm``, or those of the straight robot."""
        return super().rest if self.rest_mm is not None else (0.0,) * len(self.axis_names)

    @property
    def backlash(self) -> Actuation | None:
        """``friction.play_mm`` per tendon [m]; None where it is off."""
        if self.friction is None or not any(self.friction.play_mm):
            return None
        backlash = tuple(r / MM_PER_M for r in self.friction.play_mm)
        if self.drives is not None and len(backlash) == 1:
            return backlash * len(self.axis_names)
        return backlash if len(backlash) == len(self.axis_names) else self._per_tendon(backlash)

    @property
    def capstan(self) -> tuple[float, ...] | None:
        """``friction.capstan`` per section; None where it is off."""
        if self.friction is None or not any(self.friction.capstan):
            return None
        return self.per_section(self.friction.capstan)

    @property
    def tip_offset_m(self) -> Vec3:
        """``geometry.tip_offset_mm`` [m]."""
        x, y, z = self.geometry.tip_offset_mm
        return x / MM_PER_M, y / MM_PER_M, z / MM_PER_M

    def per_section(self, values: tuple[float, ...]) -> tuple[float, ...]:
        """Repeat the numbers of a key so that there is one per section."""
        return values * self.sections if len(values) == 1 else values

    def _per_tendon(self, values: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(
            value
            for value, section in zip(self.per_section(values), self.geometry.sections, strict=True)
            for _ in section.angles_deg
        )
