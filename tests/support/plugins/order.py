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
#: Files that take half a minute and more on a busy machine with two cores, the longest first.
LONGEST: Final = (
    "tests/docs/test_examples.py", "extras/fit/tests/test_load.py", "tests/test_quality.py",
    "tests/contract/test_contract.py", "extras/panel/tests/test_first_visit.py",
    "extras/fleet/tests/test_namespaces.py", "extras/panel/tests/page/test_page_moves.py",
    "extras/panel/tests/page/test_page_stop.py", "extras/fit/tests/test_contact.py",
    "extras/fleet/tests/test_router.py", "extras/panel/tests/page/test_page_questions.py",
    "extras/panel/tests/page/test_page_jog.py", "extras/panel/tests/page/test_page_accessible.py",
    "extras/view/tests/test_viewer_process.py", "extras/view/tests/test_view.py",
    "tests/docs/test_feetech.py", "tests/cli/test_streams.py", "tests/remote/test_waiting.py",
    "extras/fleet/tests/test_faults.py", "extras/fleet/tests/test_bridge.py",
    "extras/panel/tests/page/test_page_lease.py", "extras/panel/tests/page/test_page_numbers.py",
    "extras/panel/tests/test_expiry.py", "extras/panel/tests/test_serving.py",
    "extras/panel/tests/test_security.py", "tests/clearance/test_avoid.py",
    "tests/sense/test_squeeze.py", "tests/remote/orders/test_stopping.py",
    "extras/fleet/tests/test_client.py", "tests/remote/test_unwelcome.py", "tests/firmware/test_run.py",
    "tests/remote/test_servo.py", "tests/cli/run/test_ends.py",
    "extras/fit/tests/tendon/test_calibrate_tendon.py",
    "extras/camera/tests/test_tracker.py",
    "tests/wire/dynamixel/test_run_on_servos.py", "extras/identify/tests/test_excite.py",
    "tests/remote/orders/test_lease.py", "tests/session/test_files.py",
    "tests/wire/dynamixel/test_bench_tools.py", "extras/bringup/tests/test_bringup_command.py",
    "extras/hands/tests/test_play.py", "extras/fit/tests/tendon/test_tendon_recordings.py",
    "tests/remote/test_moving.py", "extras/fit/tests/test_load_observer.py",
    "extras/fleet/tests/test_common_start.py", "extras/camera/tests/test_command.py",
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
