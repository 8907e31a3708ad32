"""The ``sense`` of a pneumatic arm: the force on its tip from a tracker, and the error of its model."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from contid.robot_file.base import ContactPolicy, NonNegative, Positive, Strict

_Numbers = tuple[float, ...]


class ModelErrors(Strict):
    """Error of the model without load; written by `contid calibrate load`.

    A model with these errors has the measured tips without load: pressures ``p + offset + gain (p - middle) +
    loop side``, where side is -1 to 1 with the last motion of the axis, and other moduli, moments and masses.

    Attributes:
        offset_bar: offset of every axis.
        gain: gain of every axis.
        loop_bar: half the hysteresis loop of every axis.
        modulus: part by which the modulus of every section is greater than ``geometry`` has it.
        moment: part by which the pressure moment of every section is greater.
        density_kg_m3: density of every section beyond that of ``geometry``; none in older calibrations.
        link_mass_g: mass of every link beyond that of ``geometry``, likewise.
        creep_per_decade: part of the modulus that each decade of time takes after a command; the numbers
            above are for poses of 1 s.
        creep_sigma: standard deviation of it at one pose.
        axis_sigma_bar: standard deviation of what remains at an axis.
        tip_sigma_mm: standard deviation of what remains at the tip beside it.
        covariance_factor: rows of a lower triangle L; L times its transpose is the covariance of the numbers
            above in this order, without the creep, in their units.
        corrects: ``robot``: the robot's kinematics has moduli, moments, offsets and gains with these errors,
            for targets, limits, telemetry and estimate alike; ``estimate``: only the load estimate has.
    """

    offset_bar: _Numbers
    gain: _Numbers
    loop_bar: _Numbers
    modulus: _Numbers
    moment: _Numbers
    density_kg_m3: _Numbers = ()
    link_mass_g: _Numbers = ()
    creep_per_decade: float = 0.0
    creep_sigma: NonNegative = 0.0
    axis_sigma_bar: NonNegative
    tip_sigma_mm: NonNegative
    covariance_factor: tuple[_Numbers, ...]
    corrects: Literal["estimate", "robot"] = "estimate"


class LoadSensing(Strict):
    """Estimates the force on the tip in every tick, from measured tips.

    Attributes:
        noise_mm: standard deviation of a measured tip, per component.
        window_s: time constant of the average over measurements.
        expected_g: standard deviation of a component of the load before any measurement.
        swings: true: a measured tip may be off by the swing that commands start, by ``dynamics``.
        calibration: the error of the model without load.
    """

    noise_mm: Positive = 0.3
    window_s: Annotated[float, Field(ge=0.05, le=10)] = 0.4
    expected_g: Annotated[float, Field(ge=0.1, le=1000)] = 20.0
    swings: bool = False
    calibration: ModelErrors


class Sense(Strict):
    """What an arm senses.

    Attributes:
        load: the force on its tip.
        contact: reaction to a force on the tip that was not expected; none is looked for when left out.
    """

    load: LoadSensing
    contact: ContactPolicy | None = None
