"""Settings of all tests: programs that they start receive Ctrl-C, which a shell disables for jobs
in the background; the tests of a file run on one worker, so that its fixtures are made once.
"""

import signal

import pytest

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Make each file a group of `--dist loadgroup`, unless its tests name groups themselves: those
    are long and are scheduled first, so that no worker is idle at the end.
    """
    items.sort(key=lambda item: item.get_closest_marker("xdist_group") is None)
    for item in items:
        if item.get_closest_marker("xdist_group") is None:
            item.add_marker(pytest.mark.xdist_group(str(item.path)))
