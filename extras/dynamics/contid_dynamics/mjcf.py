"""Robots as MuJoCo models (MJCF): rigid links with a joint in the middle of each element of the moving rod.

A joint has the stiffness and the damping of its element: hinges for bends and twist, slides for stretch and
shear. Tendons are MuJoCo's fixed tendons, lengths that are linear in the bends as in the statics, each with
an actuator whose control is the pull [m] and whose force only pulls; what tight tendons add to the stiffness
of a twist, ``tension r^2 / h``, is in its joint, for the tensions of one actuation. The pressures of a
pneumatic arm are controls [bar] with constant moments; MuJoCo has no modulus that depends on pressure, so its
stiffness is that of one actuation, at which the model is exact.

Shapes are within 1 % of the length and the first frequency within 3 % with 16 links a section.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final
from xml.etree import ElementTree

import numpy as np

from contid.kinematics.array import Array
from contid.robot_file.robot import RobotDescription
from contid.robot_file.tendon.robot import TendonRobot
from contid.units import BAR, STANDARD_GRAVITY
from contid_dynamics.arm import MovingArm
from contid_dynamics.rod import MovingElements

#: Joints of an element in the order of the strains: name, kind, axis. v turns about -x.
_JOINTS: Final = (
    ("u", "hinge", "0 1 0"),
    ("v", "hinge", "-1 0 0"),
    ("t", "hinge", "0 0 1"),
    ("e", "slide", "0 0 1"),
    ("a", "slide", "1 0 0"),
    ("b", "slide", "0 1 0"),
)
#: Share of the shortest period / 2 pi that a step takes.
_STEP: Final = 0.5
#: More elements are not worth their steps.
_LEAST_STEP_S: Final = 1e-5


def mjcf(robot: RobotDescription, name: str, actuation: Sequence[float], elements: int = 16) -> str:
    """A robot as an MJCF document.

    Args:
        robot: description with ``dynamics``.
        name: of the model.
        actuation: pulls [m] or pressures [Pa] of the key frame; pressures also decide the stiffness.
        elements: links of a section.

    Raises:
        ContidError: the robot has no moving body.
        ArithmeticError: there is no equilibrium for the actuation.
    """
    arm = MovingArm(robot, elements=elements)
    arm.settle(actuation)
    root = ElementTree.Element("mujoco", model=name)
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="true")
    down = np.array(robot.down_unit) * (STANDARD_GRAVITY if robot.has_weight else 0.0)
    ElementTree.SubElement(
        root, "option", gravity=_text(down), timestep=f"{_step_s(arm):.3g}", integrator="implicitfast"
    )
    world = ElementTree.SubElement(root, "worldbody")
    base = ElementTree.SubElement(
        world, "body", name="base", pos=_text(robot.base.position_m), quat=_text(_quaternion(robot))
    )
    _links(base, arm)
    strain = arm.rod.strain
    values = list(actuation)
    if isinstance(robot, TendonRobot):
        _tendons(root, arm)
    else:
        _chambers(root, arm)
        values = [each / BAR for each in actuation]
    qpos = _positions(arm.rod.elements, strain)
    frames = ElementTree.SubElement(root, "keyframe")
    ElementTree.SubElement(frames, "key", name="rest", qpos=_text(qpos), ctrl=_text(values))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _links(parent: ElementTree.Element, arm: MovingArm) -> None:
    rod = arm.rod
    elements, stiffness = rod.elements, rod.stiffness.copy()
    stiffness[:, 2] += _by_tension(elements, rod.tensions_n)
    before = elements.base_m
    for k, length in enumerate(elements.lengths):
        body = ElementTree.SubElement(
            parent, "body", name=f"link{k}", pos=_text((0.0, 0.0, before + length / 2))
        )
        for strain, (letter, kind, axis) in enumerate(_JOINTS[: elements.strains]):
            # A slide moves by the strain times the length.
            scale = 1.0 if strain < 3 else 1.0 / length**2
            damping = scale * rod.damping_s * rod.stiffness[k, strain]
            ElementTree.SubElement(
                body, "joint", name=f"{letter}{k}", type=kind, axis=axis,
                stiffness=f"{scale * stiffness[k, strain]:.12g}",
                damping=f"{damping:.12g}",
            )  # fmt: skip
        before = length / 2 + elements.rigid[k]
        _inertial(body, elements.middles[k], elements.ends[k], before)
        ElementTree.SubElement(
            body, "geom", type="capsule", fromto=_text((0, 0, -length / 2, 0, 0, before)),
            size=f"{arm.radius_m:.6g}", mass="0", contype="0", conaffinity="0", rgba="0.3 0.5 0.8 1",
        )  # fmt: skip
        parent = body
    ElementTree.SubElement(parent, "site", name="tip", pos=_text(arm.offset_m + np.array([0.0, 0.0, before])))


def _by_tension(elements: MovingElements, tensions_n: Array) -> Array:
    """Stiffness that tight tendons give to the twist of every element [N m]."""
    squared = np.nan_to_num(np.sum(elements.arms**2, axis=2))
    stiffness: Array = squared @ tensions_n / elements.lengths
    return stiffness


def _inertial(body: ElementTree.Element, middle: Array, end: Array, at_m: float) -> None:
    """The masses in the middle and at the end of an element, which its link carries."""
    mass = middle[0] + end[0]
    centre = end[0] * at_m / mass
    across = middle[1] + end[1] + middle[0] * centre**2 + end[0] * (at_m - centre) ** 2
    about = 2.0 * (middle[1] + end[1])
    ElementTree.SubElement(
        body, "inertial", pos=_text((0.0, 0.0, centre)), mass=f"{mass:.12g}",
        # MuJoCo refuses principal moments of which one is above the sum of the others.
        diaginertia=_text((across, across, min(about, 2.0 * across))),
    )  # fmt: skip


def _tendons(root: ElementTree.Element, arm: MovingArm) -> None:
    elements = arm.rod.elements
    tendons = ElementTree.SubElement(root, "tendon")
    actuators = ElementTree.SubElement(root, "actuator")
    for j, axis in enumerate(arm.robot.axis_names):
        k = elements.tendon[j]
        cable = ElementTree.SubElement(tendons, "fixed", name=axis, damping=f"{arm.rod.damping_s * k:.12g}")
        for e in range(arm.rod.count):
            x, y = elements.arms[e, j]
            if not np.isnan(x):
                ElementTree.SubElement(cable, "joint", joint=f"u{e}", coef=f"{-x:.12g}")
                ElementTree.SubElement(cable, "joint", joint=f"v{e}", coef=f"{-y:.12g}")
        # tension = rest + k (pull + length), as force along the tendon its negative.
        ElementTree.SubElement(
            actuators, "general", name=axis, tendon=axis, biastype="affine", gainprm=f"{-k:.12g}",
            biasprm=_text((-elements.rest[j], -k, 0.0)), forcerange="-1e6 0",
        )  # fmt: skip


def _chambers(root: ElementTree.Element, arm: MovingArm) -> None:
    """Moments per bar of every pressure on the joints, from those of the statics at the actuation."""
    tendons = ElementTree.SubElement(root, "tendon")
    actuators = ElementTree.SubElement(root, "actuator")
    per_bar = arm.moments_per_bar
    for j, axis in enumerate(arm.robot.axis_names):
        cable = ElementTree.SubElement(tendons, "fixed", name=axis)
        for e in range(arm.rod.count):
            for strain, letter in ((0, "u"), (1, "v"), (3, "e")):
                moment = per_bar[j, e, strain] / (1.0 if strain < 3 else arm.rod.elements.lengths[e])
                if moment != 0.0:
                    ElementTree.SubElement(cable, "joint", joint=f"{letter}{e}", coef=f"{moment:.12g}")
        ElementTree.SubElement(actuators, "motor", name=axis, tendon=axis, ctrllimited="false")


def _positions(elements: MovingElements, strain: Array) -> Array:
    """Joint positions of strains: slides move by the strain times the length."""
    scale = np.ones((len(elements.lengths), elements.strains))
    scale[:, 3:] = elements.lengths[:, None]
    return (scale * strain[:, : elements.strains]).ravel()


def _step_s(arm: MovingArm) -> float:
    """A step that MuJoCo's springs, which are explicit, bear."""
    fastest_hz = float(arm.rod.modes().frequency_hz[-1])
    return max(_LEAST_STEP_S, _STEP / (2.0 * np.pi * fastest_hz))


def _quaternion(robot: RobotDescription) -> Array:
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(np.array(robot.base.rotation).reshape(3, 3)).as_quat()
    return np.array([w, x, y, z])


def _text(values: Sequence[float] | Array) -> str:
    return " ".join(f"{value:.12g}" for value in values)
