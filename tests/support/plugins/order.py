"""Workers get the files that take longest first, so that none is left for the end, where it runs alone.

pytest-xdist orders files by their number of tests, so that a file with one test of a minute came last. Files
whose tests share what is expensive to start go to few workers.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, Final

import pytest

ROOT: Final = Path(__file__).parents[3]
#: Files that took 13 s and more by the clock of a run with four workers on two cores, the longest first.
#: Those of `SHARING` are one; mypy (`test_quality.py`) has no cache in a new clone; the contract, whose
#: devices keep real deadlines, waits until all have started.
LONGEST: Final = (
    "extras/panel/tests/page/test_page_moves.py", "tests/test_quality.py",
    "extras/fleet/tests/test_client.py", "extras/bringup/tests/test_bringup_command.py",
    "extras/panel/tests/test_security.py",
    "tests/contract/test_contract.py", "extras/view/tests/test_viewer_process.py",
    "tests/wire/dynamixel/test_bench_tools.py", "extras/fleet/tests/test_namespaces.py",
    "extras/test_missing_packages.py", "tests/wire/dynamixel/test_adapters.py", "tests/sense/test_squeeze.py",
    "extras/fleet/tests/test_router.py", "extras/fit/tests/test_load.py", "extras/panel/tests/test_expiry.py",
    "tests/wire/dynamixel/test_run_on_servos.py", "tests/docs/test_examples.py",
    "extras/mocap/tests/test_track_command.py", "extras/fit/tests/tendon/test_calibrate_tendon.py",
    "tests/wire/dynamixel/test_turns.py", "extras/fleet/tests/test_recordings.py",
    "extras/identify/tests/test_delay_lag.py", "tests/wire/dynamixel/test_faults.py",
    "extras/panel/tests/test_serving.py", "extras/fit/tests/test_contact.py",
    "tests/wire/dynamixel/test_doctor.py", "extras/fleet/tests/test_faults.py",
    "extras/camera/tests/test_tracker.py", "extras/sessions/tests/test_exports.py",
    "extras/view/tests/test_view.py", "extras/fleet/tests/test_common_start.py",
    "tests/wire/dynamixel/test_homing_proof.py", "tests/docs/test_feetech.py", "tests/firmware/test_run.py",
    "extras/learn/tests/test_run_policy.py", "extras/fleet/tests/test_bridge.py",
    "extras/identify/tests/test_identify_command.py", "extras/reach/tests/test_planar.py",
    "tests/api/test_session.py", "extras/identify/tests/test_excite.py", "tests/studies/test_shi_paper.py",
    "tests/firmware/test_encoder_watch.py", "tests/session/test_replay.py",
    "extras/identify/tests/test_bent_sections.py", "extras/view/tests/test_foxglove.py",
    "tests/wire/dynamixel/test_lost_turn.py", "tests/remote/orders/test_stopping.py",
    "tests/clearance/test_lead_around.py", "extras/dynamics/tests/test_modes.py",
    "tests/wire/dynamixel/test_return_with_torque.py", "extras/reach/tests/test_workspace.py",
    "extras/sessions/tests/test_check.py", "extras/paths/tests/test_retime.py",
    "extras/fit/tests/test_load_observer.py", "extras/fleet/tests/test_tls.py",
    "extras/camera/tests/test_feedback.py", "tests/wire/dynamixel/test_bus.py", "tests/cli/run/test_run.py",
    "tests/test_left_behind.py", "tests/control/process/test_isolated_buses.py",
    "tests/control/tick/preflight/test_answers_that_jump.py", "tests/remote/test_waiting.py",
    "extras/panel/tests/test_first_visit.py", "extras/fleet/tests/test_feed.py",
    "extras/panel/tests/test_obstacles.py", "tests/wire/dynamixel/test_tendons.py",
    "extras/camera/tests/test_command.py", "tests/cli/test_streams.py",
    "tests/control/daemon/test_logging.py", "tests/remote/test_servo.py", "extras/panel/tests/test_orders.py",
    "extras/bringup/tests/test_servos.py", "tests/session/test_files.py",
    "extras/identify/tests/test_tabled_recording.py", "tests/control/process/test_process_time.py",
    "tests/session/test_recorder.py", "extras/fit/tests/test_sense_run.py",
    "extras/hands/tests/test_jog_virtual.py", "tests/test_reruns.py",
)  # fmt: skip


#: Folders whose tests share a browser, and the number of workers that have one.
SHARING: Final = {"extras/panel/tests/page": 1}


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Whole files to each worker, of a folder of `SHARING` to some of them."""
    if config.getvalue("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling  # type: ignore[import-untyped]

    class LoadSharers(LoadFileScheduling):  # type: ignore[misc]
        def _split_scope(self, nodeid: str) -> str:
            return sharers(nodeid.partition("::")[0])

    return LoadSharers(config, log)


def sharers(file: str) -> str:
    """The name of the files that go to one worker together with this one."""
    folder, _, name = file.rpartition("/")
    if folder not in SHARING:
        return file
    return f"{folder} {_names(folder).index(name) % SHARING[folder]}"


@cache
def _names(folder: str) -> list[str]:
    return sorted(path.name for path in (ROOT / folder).glob("test_*.py"))


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> None:
    """Keep the order of `pytest_collection_modifyitems`."""
    config.option.loadscopereorder = False


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """The longest files first, then those with most tests; within a file nothing changes."""
    if hasattr(config, "workerinput"):
        places = in_order([item.nodeid.partition("::")[0] for item in items])
        items.sort(key=lambda item: places[item.nodeid.partition("::")[0]])


def in_order(files: Sequence[str]) -> dict[str, int]:
    """The place of each file in a run, from the files of its tests."""
    known = {file: -len(LONGEST) + number for number, file in enumerate(LONGEST)}
    counts = Counter(files)
    ordered = sorted(counts, key=lambda file: (known.get(file, 0), -counts[file]))
    return {file: place for place, file in enumerate(ordered)}
