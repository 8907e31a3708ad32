"""The watch over the pose file goes on after an error."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from contid_panel import poses
from contid_panel.hub import Hub


async def test_a_folder_that_cannot_be_searched_for_a_moment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    sent: list[Any] = []
    described = {"file": str(tmp_path / "hand.yaml"), "robots": {}}
    hub = SimpleNamespace(
        watched=True, described=described, send=lambda kind, lasting, **fields: sent.append(fields)
    )
    looks = 0

    def pose_file(robot_file: Path) -> Path:
        nonlocal looks
        looks += 1
        if looks < 3:
            raise PermissionError(13, "Permission denied")
        return robot_file.with_name("hand.poses.yaml")

    monkeypatch.setattr(poses, "default_pose_file", pose_file)
    monkeypatch.setattr(poses, "PERIOD_S", 0.0)
    watching = asyncio.create_task(poses.PanelPoses(cast(Hub, hub)).watch())
    async with asyncio.timeout(60.0):
        while not sent:
            await asyncio.sleep(0.01)
    watching.cancel()
    assert sent[0]["file"] == "hand.poses.yaml"
    assert len(caplog.records) == 1
