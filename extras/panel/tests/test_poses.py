"""Named poses at the panel: those of the pose file, inside the limits and under the lease."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.support.command import contid_in
from tests.support.daemons import HERE, Running
from tests.support.panels import PanelClient, PanelProcess, page

pytestmark = [pytest.mark.process, pytest.mark.realtime]

#: By hand: two that suit the robots, one outside a limit, one of another robot.
POSES = """\
contid_poses: 1  # kept
poses:
  home: {target: {f0.x_mm: 50, f0.y_mm: 75}}
  bent: {target: {f0.left_mm: 60, f0.right_mm: 52, f1.left_mm: 45, f1.right_mm: 55}, saved: "yesterday"}
  far: {target: {f0.left_mm: 5000, f0.right_mm: 52}}
  foreign: {target: {arm.x_mm: 5}}
"""


@pytest.fixture
def running(both: tuple[Running, PanelProcess]) -> Running:
    (both[0].folder / "fingers.poses.yaml").write_text(POSES)
    return both[0]


@pytest.fixture
def served(running: Running, both: tuple[Running, PanelProcess]) -> PanelProcess:
    """The panel, beside the file."""
    return both[1]


@asynccontextmanager
async def leading(served: PanelProcess) -> AsyncIterator[PanelClient]:
    """A page that holds the lease and has the robots' positions and poses."""

    async def alive() -> None:
        while True:
            await it.send("beat")
            await asyncio.sleep(0.2)

    async with page(served) as it:
        await it.until(lambda page: "poses" in page.newest and page.state() == "HOLD")
        assert (await it.order("acquire"))["ok"]
        beats = asyncio.create_task(alive())
        yield it
        beats.cancel()


def _poses(it: PanelClient) -> dict[str, dict[str, Any]]:
    return {pose["name"]: pose for pose in it.newest["poses"]["poses"]}


async def test_poses_are_listed_with_provenance_and_what_does_not_suit(served: PanelProcess) -> None:
    async with page(served) as it:
        await it.until(lambda page: "poses" in page.newest)
        poses = _poses(it)
        assert list(poses) == ["home", "bent", "far", "foreign"]
        assert poses["bent"]["saved"] == "yesterday"
        assert poses["home"]["problem"] == poses["bent"]["problem"] == ""
        assert "fingers.poses.yaml:5" in poses["far"]["problem"]
        assert "5000 is outside its limits" in poses["far"]["problem"]
        assert "unknown column 'arm.x_mm'" in poses["foreign"]["problem"]
        reply = await it.order("pose", name="home")
        assert reply["error"]["code"] == "lease-held"
        reply = await it.order("save_pose", name="here")
        assert reply["error"]["code"] == "lease-held"


async def test_only_what_suits_the_robots_moves_them(served: PanelProcess) -> None:
    async with leading(served) as it:
        assert (await it.order("pose", name="bent"))["ok"]

        def measured(page: PanelClient) -> list[float]:
            robots = page.newest["frame"]["robots"]
            return [*robots["f0"]["measured"], *robots["f1"]["measured"]]

        await it.until(lambda page: measured(page) == pytest.approx([60.0, 52.0, 45.0, 55.0], abs=0.2))
        assert (await it.order("pose", name="home"))["ok"]
        await it.until(lambda page: page.tip_mm()[:2] == pytest.approx([*HERE.values()], abs=0.5))
        for name in ("far", "foreign", "absent", "../home", ""):
            reply = await it.order("pose", name=name)
            assert reply["error"]["code"] == "bad-target", reply
        # The page names a pose; it cannot give a target with it.
        reply = await it.order("pose", name="home", target={"f0.x_mm": 1.0})
        assert reply["error"]["code"] == "bad-request"


async def test_a_pose_is_saved_as_teaching_does_it(served: PanelProcess, running: Running) -> None:
    async with leading(served) as it:
        reply = await it.order("save_pose", name="here", robots=["f0"])
        assert reply["result"]["messages"] == [], reply
        await it.until(lambda page: "here" in _poses(page))
        saved = _poses(it)["here"]
        assert saved["saved"].endswith("contid panel, fingers.yaml")
        robots = it.newest["frame"]["robots"]
        values = [saved["target"][f"f0.{axis}_mm"] for axis in ("left", "right")]
        assert values == pytest.approx(robots["f0"]["measured"], abs=0.1)
        text = (running.folder / "fingers.poses.yaml").read_text()
        assert "# kept" in text
        assert list(yaml.safe_load(text)["poses"]) == ["home", "bent", "far", "foreign", "here"]
        reply = await it.order("save_pose", name="here")
        assert "has a pose 'here' already" in reply["error"]["message"]
        assert (await it.order("save_pose", name="here", replace=True))["ok"]
        await it.until(lambda page: len(_poses(page)["here"]["target"]) == 4)
        for name in ("two words", "", "../x", "a" * 65):
            assert "is no name of a pose" in (await it.order("save_pose", name=name))["error"]["message"]
        assert (await it.order("save_pose", name="x", robots=["f9"]))["error"]["code"] == "unknown-robot"
        assert (await it.order("release"))["ok"]
    # What the panel saved, the command uses.
    done = contid_in(running.folder, "move", "--pose", "here", "--socket", str(running.socket))
    assert done.returncode == 0, done.stderr


async def test_a_file_that_changes_or_is_wrong_is_shown(served: PanelProcess, running: Running) -> None:
    path: Path = running.folder / "fingers.poses.yaml"
    async with leading(served) as it:
        path.write_text("contid_poses: 1\nposes:\n  one: {target: {f0.x_mm: 50, f0.y_mm: 75}}\n")
        await it.until(lambda page: list(_poses(page)) == ["one"])
        assert (await it.order("pose", name="home"))["error"]["code"] == "bad-target"
        path.write_text("contid_poses: 1\nposes: [\n")
        await it.until(lambda page: page.newest["poses"]["problem"])
        assert "fingers.poses.yaml" in it.newest["poses"]["problem"]
        assert (await it.order("pose", name="one"))["error"]["code"] == "bad-target"
        assert not (await it.order("save_pose", name="one", replace=True))["ok"]
        path.unlink()
        await it.until(lambda page: not page.newest["poses"]["problem"])
        assert _poses(it) == {}
        assert (await it.order("save_pose", name="one"))["ok"]
        await it.until(lambda page: list(_poses(page)) == ["one"])
