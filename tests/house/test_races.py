"""Only a test that other processes time may fail once."""

import pytest

from tests.conftest import TIMED_BY_OTHERS, pytest_collection_modifyitems


def test_a_test_of_this_process_alone_must_pass_at_once(request: pytest.FixtureRequest) -> None:
    pytest_collection_modifyitems([request.node])
    assert request.node.get_closest_marker("flaky") is None


@pytest.mark.parametrize("marker", TIMED_BY_OTHERS)
def test_what_other_processes_time_may_fail_once(
    request: pytest.FixtureRequest, marker: str
) -> None:
    request.node.add_marker(marker)
    pytest_collection_modifyitems([request.node])
    flaky = request.node.get_closest_marker("flaky")
    assert flaky is not None
    assert flaky.kwargs == {"reruns": 1}


def test_every_such_marker_is_declared_and_told(request: pytest.FixtureRequest) -> None:
    declared = {line.split(":")[0] for line in request.config.getini("markers")}
    assert set(TIMED_BY_OTHERS) <= declared
    assert request.config.getoption("rerun_show_tracebacks")
