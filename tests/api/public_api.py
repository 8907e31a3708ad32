"""Every public name of the library in use, for type checkers; `test_typed_results` runs one on it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from contid import Client, ElasticRod, Robot, Session, Sim, Wrench, __version__
from contid.client import ServoState


def kinematics() -> NDArray[np.float64]:
    robot = Robot("finger", si=False)
    names: tuple[str, ...] = (robot.name, *robot.names, *robot.axes, *robot.bend_columns, *robot.limit_names)
    answer = robot.ik([[30.0, 85.0]], seed=[[60.0, 60.0]])
    pose = robot.fk(answer.actuation, load=None)
    assert answer.converged.all(), (names, robot.units, robot.description.model, answer.residual.max())
    limited: tuple[str, ...] = robot.limits_in(int(answer.limited_by[0]))
    low, high, velocity = robot.limits.min, robot.limits.max, robot.limits.velocity
    lines = robot.backbone([60.0, 60.0], points=robot.dimension * 10)
    bends = robot.bends([60.0, 60.0])
    again = robot.ik_bends(bends).actuation
    loaded = robot.fk_under([60.0, 60.0]).tip if limited else pose.tip
    changes = robot.jacobian([60.0, 60.0]) + 0.0 * robot.compliance([60.0, 60.0]).sum()
    print(low, high, velocity, lines.shape, again.shape, loaded.shape, changes.shape)
    print(robot["finger"].workspace(across=8), robot.plot([60.0, 60.0], label="finger"))
    return pose.tip


def simulation(path: str) -> float:
    with Sim("finger", unreachable="nearest", record=path) as sim:
        state = sim.step({"left_mm": 50.0, "right_mm": 55.0}, ticks=5)
        sim.hold()
        sim.clear_fault()
        sim.resume()
        print(sim.names, sim.rate_hz, sim.units, sim.events, sim.state.time_s, state.tick)
        tip: NDArray[np.float64] = state["finger"].tip
        sim.close()
    with Sim("finger") as again:
        first = again.reset(3)["finger"]
        print(first.mode, first.fault, first.command, first.measured, first.tracked, first.converged)
        return float(tip[0]) + first.residual + len(first.refused)


def recording(path: str) -> int:
    session = Session(path)
    loaded = session.robot_file(real_buses=False)
    print(
        session.path,
        session.rate_hz,
        session.robots,
        session.robot_text,
        session.virtual,
        session.option("input"),
    )
    print(session.trajectory(loaded, played=0), session.to_pandas().shape, session.plot())
    rows: list[dict[str, float]] = list(session)
    return len(rows) + len(list(session.ticks())) + len(list(session.events())) + len(list(session.entries()))


def rod() -> NDArray[np.float64]:
    shape = ElasticRod(200.0, 1.0, modulus_pa=1e9, poisson=0.3, density_kg_m3=1200.0).statics(
        np.linspace(0.0, 200.0, 5), loads=[Wrench(200.0, force=[0.01, 0.0, 0.0])], gravity=[0.0, 0.0, -9.81]
    )
    return shape.points


def controller(state: ServoState) -> Mapping[str, float] | None:
    return None if state.time_s > 1.0 else {"x_mm": 50.0, "y_mm": 75.0}


def orders(socket: str) -> list[str]:
    with Client(socket, name="script", timeout_s=5.0, valid_s=1.0) as client:
        client.ping()
        client.acquire(2.0, takeover=True)
        print(client.describe(), client.status(), client.request("status"), __version__)
        number: int = client.move({"x_mm": 50.0, "y_mm": 75.0}, wait=False)
        client.wait(number)
        waiting = client.load(["t_s", "x_mm", "y_mm"], [[0.0, 50.0, 75.0], [1.0, 45.0, 75.0]])
        print(
            client.start(waiting, at_s=None),
            client.started(waiting),
            client.servo(20.0, controller, nearest=True),
        )
        for frame in client.telemetry(20.0, fields=["command"], events=False):
            print(frame)
        client.hold()
        client.stop(end=False)
        client.clear_fault()
        client.recover(after_stop=True)
        client.resume(wait=True, after_stop=True)
        client.measure([50.0, 75.0, 0.0], robot="finger", age_ms=5.0)
        client.grip(0.5)
        client.record(end=True)
        client.estop()
        client.release()
        refused: list[str] = client.stream(["x_mm", "y_mm"], [[50.0, 75.0]], wait=True)
        client.close()
        return refused
