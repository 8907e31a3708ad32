"""What the loop reports while no tip comes, with a room that is a list of frames."""

import time

import pytest

from contid_mocap import follow as loop
from contid_mocap.follow import Follower, FollowReport
from contid_mocap.room import RoomFrame, RoomPose
from contid_mocap.setup_file import MocapSetup
from contid_mocap.tip_tracker import RoomTipTracker

SEEN = RoomPose((0.1, 0.2, 0.3), None)


class ListedRoom:
    """Frames from poses, one a look; then none."""

    def __init__(self, *poses):
        self._poses = list(poses)
        self._number = 0

    def poll(self, timeout_s):
        time.sleep(0.02)
        if not self._poses:
            return []
        self._number += 1
        now_s = time.monotonic()
        return [RoomFrame(self._number, now_s, now_s, self._poses.pop(0))]

    def names(self):
        return ["plate", "wand"]

    def facts(self):
        return ["facts"]

    def restart(self):
        raise AssertionError("the numbers rise")

    def close(self):
        pass


@pytest.mark.parametrize(
    ("poses", "expected"),
    [
        ([], "no frame arrives"),
        ([{"tip": SEEN}], "no frame arrives"),
        ([{"tip": None}, {"tip": SEEN}], "no frame arrives"),
        ([{"plate": SEEN}] * 20, "no 'tip' among plate, wand"),
        ([{"tip": SEEN}, *[{"plate": SEEN}] * 20], "no 'tip' among plate, wand"),
        ([{"tip": None}], "'tip' is not tracked"),
    ],
)
def test_the_reason_is_of_the_time_without_a_tip(monkeypatch, poses, expected):
    monkeypatch.setattr(loop, "SILENT_S", 0.1)
    setup = MocapSetup.model_validate(
        {"contid_mocap": 1, "room": {"up": "z"}, "robots": {"arm": {"marker": "tip"}}}
    )
    lines: list[str] = []
    report = FollowReport()
    follower = Follower(lambda tips: None, lines.append)
    loop.follow(ListedRoom(*poses), RoomTipTracker(setup), follower, report, 0.25)
    assert lines[0] == f"no tip for 0.1 s: {expected}"
    assert report.measured == sum(each.get("tip") is SEEN for each in poses)
    assert report.facts == ["facts"]
