"""What every test may rely on: programs that it starts hear Ctrl-C, even when the shell that runs
the tests in the background does not; fixtures of a file are made once, since its tests run on one
worker.
"""

import signal

import pytest

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """A file is a group for `--dist loadgroup` unless its tests name groups; those are long and
    begin first, so that no worker waits at the end.
    """
    items.sort(key=lambda item: item.get_closest_marker("xdist_group") is None)
    for item in items:
        if item.get_closest_marker("xdist_group") is None:
            item.add_marker(pytest.mark.xdist_group(str(item.path)))
